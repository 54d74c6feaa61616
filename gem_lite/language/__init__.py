"""Sentences to queries: what to pick and where to place it.

`queries` has queries and the table of parsers, `grammar` the library's own parser, `phrases` what a single phrase says
(where a thing lies, what "and" joins), `word_lists` the words of both.
"""

from gem_lite.language.grammar import EXAMPLE, parse, parse_thing
from gem_lite.language.phrases import LOCATION_CODE_LENGTH, conjuncts, location_code, location_in_front, split_location
from gem_lite.language.queries import PARSERS, ImageQuery, Parser, Queries, Query, Question, understand
from gem_lite.language.word_lists import PLACING, VERBS

__all__ = [
    "EXAMPLE", "LOCATION_CODE_LENGTH", "PARSERS", "PLACING", "VERBS", "ImageQuery", "Parser", "Queries", "Query",
    "Question", "conjuncts", "location_code", "location_in_front", "parse", "parse_thing", "split_location",
    "understand",
]  # fmt: skip
