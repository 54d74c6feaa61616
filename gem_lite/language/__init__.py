"""Sentences to queries: what to pick and where to place it.

`queries` has queries and the table of parsers, `grammar` the library's own parser, `phrases` what a single phrase says
(where a thing lies, what "and" joins, what a place is beside), `word_lists` the words of both, `pictured` sentences
with pictures in the places of phrases.
"""

from gem_lite.language.grammar import EXAMPLE, parse, parse_thing
from gem_lite.language.phrases import (
    LOCATION_CODE_LENGTH,
    anchor_count,
    conjuncts,
    location_code,
    location_in_front,
    plural,
    split_location,
    split_relation,
    without_relation,
)
from gem_lite.language.pictured import Instruction, PictureSentence, read_goals, read_picture
from gem_lite.language.queries import (
    PARSERS,
    ImageQuery,
    Parser,
    Queries,
    Query,
    Question,
    Spot,
    ThingQuery,
    is_relation,
    understand,
)
from gem_lite.language.word_lists import BETWEEN, PLACING, RELATIONS, VERBS

__all__ = [
    "BETWEEN", "EXAMPLE", "LOCATION_CODE_LENGTH", "PARSERS", "PLACING", "RELATIONS", "VERBS", "ImageQuery",
    "Instruction", "Parser", "PictureSentence", "Queries", "Query", "Question", "Spot", "ThingQuery", "anchor_count",
    "conjuncts", "is_relation", "location_code", "location_in_front", "parse", "parse_thing", "plural", "read_goals",
    "read_picture", "split_location", "split_relation", "understand", "without_relation",
]  # fmt: skip
