"""The words of the grammar and of phrases."""

from __future__ import annotations

from gem_lite.foundations import colors

ALIGNING = "align"
PUSHING = "push"
"""The verb of a sentence that asks for a push and not for a pick and place."""
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
OPENINGS = (",", "please", "kindly", "now", "could you", "can you", "would you", "will you")
CLOSINGS = (",", ".", "!", "?", "please", "now", "for me", "thanks", "thank you")
PARTS = (
    "handle", "grip", "brim", "rim", "body", "middle", "head", "tip", "blade", "edge", "base", "shade", "seat", "legs",
    "cap", "stem", "tines", "bristles", "neck", "tail",
)  # fmt: skip
"""Parts that "by the ..." may name; after "by the", another word could be a thing that stands there."""
FEATURES = ("stripes", "dots", "spots", "cleats", "laces", "leopard", "flowers", "letters", "wheels", "handles")
"""After "with", these words and adjectives describe a thing; other words could say how to do it: "with care"."""
DETERMINERS = ("the", "a", "an", "all", "both", "each", "every", "some", "any", "one", "my", "your", "our")
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

_RELATIONS = (
    "about", "above", "across", "adjacent", "after", "against", "ahead", "along", "alongside", "amid", "among",
    "amongst", "around", "at", "before", "behind", "below", "beneath", "beside", "besides", "between", "beyond", "by",
    "close", "closer", "closest", "despite", "during", "far", "farther", "farthest", "for", "from", "further",
    "furthest", "like", "minus", "near", "nearby", "nearer", "nearest", "next", "off", "onwards", "opposite", "out",
    "outside", "over", "parallel", "past", "per", "perpendicular", "since", "through", "till", "touching", "toward",
    "towards", "under", "underneath", "unlike", "until", "using", "versus", "via", "without",
)  # fmt: skip
_POSTURES = (
    "called", "containing", "covered", "covering", "face-down", "face-up", "facing", "filled", "flipped", "hidden",
    "holding", "inverted", "leaning", "located", "lying", "placed", "positioned", "resting", "rotated", "sitting",
    "standing", "tilted", "turned", "upright", "upside", "wearing",
)  # fmt: skip
_MANNERS = (
    "asap", "backward", "backwards", "care", "caution", "downward", "downwards", "fast", "faster", "forward",
    "forwards", "halfway", "hurry", "immediate", "inward", "inwards", "midway", "outward", "outwards", "partway",
    "pronto", "quick", "quicker", "sideways", "slow", "slower", "upward", "upwards",
)  # fmt: skip
_TIMES_AND_LENGTHS = (
    "ago", "already", "always", "centimeter", "centimeters", "centimetre", "centimetres", "cm", "day", "days", "degree",
    "degrees", "ever", "finally", "hour", "hours", "inch", "inches", "last", "later", "m", "meter", "meters", "metre",
    "metres", "millimeter", "millimeters", "millimetre", "millimetres", "minute", "minutes", "mm", "moment", "never",
    "now", "often", "once", "percent", "second", "seconds", "sometimes", "soon", "still", "third", "time", "times",
    "today", "tomorrow", "tonight", "twice", "week", "weeks", "yesterday",
)  # fmt: skip
_AMOUNTS = (
    "couple", "dozen", "eight", "enough", "everything", "few", "five", "four", "half", "least", "less", "many", "more",
    "most", "much", "nine", "nobody", "none", "nothing", "seven", "several", "six", "ten", "three", "two", "zero",
)  # fmt: skip
_COMPARED = (
    "another", "corresponding", "different", "first", "high", "higher", "highest", "identical", "inner", "innermost",
    "lower", "lowermost", "lowest", "matching", "other", "outer", "outermost", "own", "rear", "same", "similar", "such",
    "upper", "uppermost",
)  # fmt: skip
_COMMANDS = (
    "abort", "cancel", "halt", "nevermind", "no", "ok", "okay", "oops", "pause", "sorry", "stop", "undo", "wait", "yes",
)  # fmt: skip
_OTHERS = (
    "again", "almost", "also", "although", "am", "anyone", "anything", "anywhere", "apart", "are", "as", "aside",
    "away", "be", "because", "been", "being", "but", "cannot", "could", "did", "direction", "do", "does", "either",
    "else", "elsewhere", "even", "everywhere", "except", "excluding", "had", "has", "have", "he", "her", "here", "hers",
    "him", "his", "how", "however", "i", "if", "including", "instead", "is", "it", "its", "itself", "just", "let",
    "may", "maybe", "me", "might", "mine", "must", "n", "neither", "nor", "not", "nowhere", "or", "ours", "perhaps",
    "please", "quite", "rather", "shall", "she", "should", "so", "somewhere", "straight", "than", "thank", "thanks",
    "that", "their", "theirs", "them", "themselves", "then", "there", "these", "they", "this", "those", "though",
    "together", "too", "unless", "us", "very", "was", "we", "well", "were", "what", "whatever", "when", "whenever",
    "where", "wherever", "whether", "which", "whichever", "while", "who", "whoever", "whom", "whose", "why", "will",
    "would", "yet", "you", "yours",
)  # fmt: skip
_CONTRACTIONS = (
    "aint", "arent", "cant", "couldnt", "didnt", "doesnt", "dont", "hasnt", "havent", "im", "isnt", "ive", "lets",
    "shouldnt", "thats", "theres", "theyre", "wasnt", "werent", "whats", "wont", "wouldnt", "youre",
)  # fmt: skip
RESERVED = frozenset(
    (*VERBS, *PARTICLES, *(word for word in PLACING if " " not in word), *_RELATIONS, *_POSTURES, *_MANNERS,
     *_TIMES_AND_LENGTHS, *_AMOUNTS, *_COMPARED, *_COMMANDS, *_OTHERS, *_CONTRACTIONS)
)  # fmt: skip
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
