"""The words of the grammar and of phrases."""

from __future__ import annotations

from gem_lite.foundations import colors

ALIGNING = "align"
PUSHING = "push"
"""The verb of a sentence that asks for a push and not for a pick and place."""
PUSHES = (PUSHING, "pushing")
"""The words that ask for a push in a sentence that a language model reads."""
VERBS = (
    "pick", "put", "place", "pack", "move", "grasp", "grab", "take", "set", "drop", "stack", PUSHING, "lay", "lift",
    "bring", "transfer", "insert", ALIGNING,
)  # fmt: skip
PARTICLES = ("up", "down")
PLACING = (
    "on top of", "on the top of", "on to", "onto", "on", "upon", "atop", "down on", "down onto",
    "inside of", "inside", "in to", "into", "in", "within", "down in", "down into", "over to", "to",
)  # fmt: skip
"""Prepositions that say where to place; the longest one that fits is read."""
BETWEEN = "between"
"""The only relation to two things."""
RELATIONS = {
    **{
        wording.format(side): f"{side} of"
        for side in ("left", "right")
        for wording in (
            "{} of", "to the {} of", "on the {} of", "to the {} side of", "on the {} side of", "at the {} side of",
            "on the {}-hand side of", "to the {}-hand side of", "at the {} of",
        )
    },
    "in front of": "in front of", "behind": "behind",
    "beside": "beside", "by the side of": "beside", "at the side of": "beside", "next to": "beside",
    "alongside": "beside",
    BETWEEN: BETWEEN, "in between": BETWEEN,
}  # fmt: skip
"""Wordings that say where to place, on the table and beside a thing, and the relation that each of them means.

"On the left side of the box" is none of them: it may mean a part of the box."""
TAKING = ("pick", "grasp", "grab", "take", "lift")
"""Verbs after which a relation may say where the thing lies: "pick the mug behind the bowl"."""
OPENINGS = (",", "please", "kindly", "now", "could you", "can you", "would you", "will you")
CLOSINGS = (",", ".", "!", "?", "please", "now", "for me", "thanks", "thank you")
PARTS = (
    "handle", "grip", "brim", "rim", "body", "middle", "head", "tip", "blade", "edge", "base", "shade", "seat", "legs",
    "cap", "stem", "tines", "bristles", "neck", "tail",
)  # fmt: skip
"""Parts that "by the ..." may name; after "by the", another word could be a thing that stands there."""
FEATURES = ("stripes", "dots", "spots", "cleats", "laces", "leopard", "flowers", "letters", "wheels", "handles")
"""After "with", these words and adjectives describe a thing; other words could say how to do it: "with care"."""
DETERMINERS = (
    "the", "teh", "hte", "a", "an", "all", "both", "each", "every", "some", "any", "one", "my", "your", "our",
)  # fmt: skip
OF_SEVERAL = ("all", "both", "each", "every")
"""Determiners that no place has: a thing cannot lie in "both bowls"."""

# Location words -----------------------------------------------------------------------------------------

LOCATION_WORDS = ("left", "right", "top", "bottom", "middle")
LEADING = {
    **{wording: word for word in LOCATION_WORDS for wording in (word, f"{word}most", f"{word}-most")},
    "left-hand": "left", "right-hand": "right", "center": "middle", "centre": "middle", "central": "middle",
}  # fmt: skip
"""The location words that may stand in front of a thing, and what they mean."""
LOCATIONS = {
    "on the left": "left", "on the right": "right", "in the middle": "middle", "in the center": "middle",
    "in the centre": "middle",
}  # fmt: skip
"""What may follow a thing, and the location word that it means."""
SIDES = (*LEADING, "front", "back", "rear", "side")
"""They alone name no thing."""
BEFORE_OF = ("middle", "bottom", "center", "centre")
"""The words of `SIDES` that name a thing before "of": "middle of the stand". Others lie beside: "left of the mug"."""
NO_THINGS = ("side", "edge", "corner", "end", "half", "part", "area", "one", "ones")
"""After a location word they name a part of the table or of a thing, and no thing that could be looked for."""
_WORN = (
    "shoe", "boot", "sneaker", "sandal", "slipper", "sock", "glove", "mitten", "hand", "foot", "arm", "leg", "ear",
    "eye", "earring", "earbud", "wing",
)  # fmt: skip
_DRAWERS = ("drawer", "shelf")
NAMES = {"left": _WORN, "right": _WORN, "top": ("hat", "coat", *_DRAWERS), "bottom": _DRAWERS, "middle": _DRAWERS}
"""A location word directly before one of these nouns belongs to the name: "left shoe", "top hat"."""

# Adjectives ---------------------------------------------------------------------------------------------

SHADES = frozenset(("light", "lighter", "lightest", "dark", "darker", "darkest", "bright"))
COLORS = frozenset(
    (*colors.RGB, "azure", "scarlet", "crimson", "emerald", "tangerine", "golden", "violet", "rose", "teal",
     "turquoise", "chestnut", "snowy", "grey", "black", "jet", "lime", "magenta", "fuchsia", "silver", *SHADES)
)  # fmt: skip
PATTERNS = ("striped", "dotted", "spotted", "checkered", "chequered", "checked", "patterned", "plaid")
ADJECTIVES = COLORS | frozenset(
    (*LEADING, "front", "back", "small", "smaller", "smallest", "big", "bigger", "biggest", "large", "larger",
     "largest", "little", "tiny", "long", "short", "tall", "thin", "thick", "round", "striped")
)  # fmt: skip
"""Words that name no thing without a noun."""
ONE_COLORED = ("block",)
"""Singular nouns whose joined colours are two things all the same: "gray and red block", as the paper says."""
PAIRS = frozenset(
    ("shoes", "sneakers", "boots", "sandals", "slippers", "trainers", "socks", "gloves", "mittens", "trousers", "pants",
     "jeans", "shorts", "scissors", "pliers", "tongs", "tweezers", "shears", "headphones", "earphones", "sunglasses",
     "goggles", "spectacles", "binoculars")
)  # fmt: skip
"""Plural nouns that name one thing, which may have two colours."""
PLURALS = ("mice", "knives", "dice", "geese", "feet", "teeth", "people", "children", "men")
"""Plural nouns that do not show it by an "s"."""

# Words that are never part of a phrase ------------------------------------------------------------------

RESERVED = frozenset(
    (*VERBS, *PARTICLES, *(word for word in PLACING if " " not in word),
     "abort", "about", "above", "across", "adjacent", "after", "again", "against", "ago", "ahead", "aint", "almost",
     "along", "alongside", "already", "also", "although", "always", "am", "amid", "among", "amongst", "another",
     "anyone", "anything", "anywhere", "apart", "are", "arent", "around", "as", "asap", "aside", "at", "away",
     "backward", "backwards", "be", "because", "been", "before", "behind", "being", "below", "beneath", "beside",
     "besides", "between", "beyond", "but", "by", "called", "cancel", "cannot", "cant", "care", "caution", "centimeter",
     "centimeters", "centimetre", "centimetres", "close", "closer", "closest", "cm", "containing", "corresponding",
     "could", "couldnt", "couple", "covered", "covering", "day", "days", "degree", "degrees", "despite", "did", "didnt",
     "different", "direction", "do", "does", "doesnt", "dont", "downward", "downwards", "dozen", "during", "eight",
     "either", "else", "elsewhere", "enough", "even", "ever", "everything", "everywhere", "except", "excluding",
     "face-down", "face-up", "facing", "far", "farther", "farthest", "fast", "faster", "few", "filled", "finally",
     "first", "five", "flipped", "for", "forward", "forwards", "four", "from", "further", "furthest", "had", "half",
     "halfway", "halt", "has", "hasnt", "have", "havent", "he", "her", "here", "hers", "hidden", "high", "higher",
     "highest", "him", "his", "holding", "hour", "hours", "how", "however", "hurry", "i", "identical", "if", "im",
     "immediate", "inch", "inches", "including", "inner", "innermost", "instead", "inverted", "inward", "inwards", "is",
     "isnt", "it", "its", "itself", "ive", "just", "last", "later", "leaning", "least", "less", "let", "lets", "like",
     "located", "lower", "lowermost", "lowest", "lying", "m", "many", "matching", "may", "maybe", "me", "meter",
     "meters", "metre", "metres", "midway", "might", "millimeter", "millimeters", "millimetre", "millimetres", "mine",
     "minus", "minute", "minutes", "mm", "moment", "more", "most", "much", "must", "n", "near", "nearby", "nearer",
     "nearest", "neither", "never", "nevermind", "next", "nine", "no", "nobody", "none", "nor", "not", "nothing", "now",
     "nowhere", "off", "often", "ok", "okay", "once", "onwards", "oops", "opposite", "or", "other", "ours", "out",
     "outer", "outermost", "outside", "outward", "outwards", "over", "own", "parallel", "partway", "past", "pause",
     "per", "percent", "perhaps", "perpendicular", "placed", "please", "positioned", "pronto", "quick", "quicker",
     "quite", "rather", "rear", "resting", "rotated", "same", "second", "seconds", "seven", "several", "shall", "she",
     "should", "shouldnt", "sideways", "similar", "since", "sitting", "six", "slow", "slower", "so", "sometimes",
     "somewhere", "soon", "sorry", "standing", "still", "stop", "straight", "such", "ten", "than", "thank", "thanks",
     "that", "thats", "their", "theirs", "them", "themselves", "then", "there", "theres", "these", "they", "theyre",
     "third", "this", "those", "though", "three", "through", "till", "tilted", "time", "times", "today", "together",
     "tomorrow", "tonight", "too", "touching", "toward", "towards", "turned", "twice", "two", "under", "underneath",
     "undo", "unless", "unlike", "until", "upper", "uppermost", "upright", "upside", "upward", "upwards", "us", "using",
     "versus", "very", "via", "wait", "was", "wasnt", "we", "wearing", "week", "weeks", "well", "were", "werent",
     "what", "whatever", "whats", "when", "whenever", "where", "wherever", "whether", "which", "whichever", "while",
     "who", "whoever", "whom", "whose", "why", "will", "without", "wont", "would", "wouldnt", "yes", "yesterday", "yet",
     "you", "youre", "yours", "zero")
)  # fmt: skip
"""Besides: relations, postures, manners, times, lengths, amounts, comparisons, commands, and what else is no thing."""
NAMES_WITH_RESERVED = ("pepsi next box",)
"""Names of known things that have a word of `RESERVED`."""
AT_THE_END = (
    *(word for word in LEADING if word != "top" and word not in BEFORE_OF), "back", "flat", "hard", "deep", "home",
)  # fmt: skip
"""Behind a thing, they say how or where to put it: "put the chair back", "put the book flat"."""
NAMES_IN_LY = (
    "assembly", "belly", "butterfly", "curly", "doily", "dragonfly", "family", "fly", "holly", "jelly", "lily", "lolly",
)  # fmt: skip
"""All other words that end in "ly" count as adverbs: "gently", "carefully"."""
