"""Sentences to queries: what to pick and where to place it.

`queries` has queries and the table of parsers, `grammar` the library's own parser, `phrases` what a single phrase says
(where a thing lies, what "and" joins), `word_lists` the words of both.
"""

from gem_lite.language.grammar import EXAMPLE, parse, parse_thing
from gem_lite.language.phrases import conjuncts
from gem_lite.language.queries import PARSERS, ImageQuery, Parser, Queries, Query
from gem_lite.language.word_lists import PLACING, VERBS

__all__ = [
    "EXAMPLE", "PARSERS", "PLACING", "VERBS", "ImageQuery", "Parser", "Queries", "Query", "conjuncts", "parse",
    "parse_thing",
]  # fmt: skip
