"""The spans of a sentence that may name a thing: runs of its own words.

A reader that chooses among spans cannot invent a thing. Spans are found by closed classes of words alone: articles,
prepositions, pronouns, conjunctions, auxiliary verbs and common adverbs. All other words are open: nouns, adjectives,
verbs. So no noun need be known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gem_lite.language import word_lists
from gem_lite.language.phrases import TOKEN, plain_apostrophes

Span = tuple[int, int]
"""The words from the first index on, up to the second."""

ARTICLES = (frozenset(word_lists.DETERMINERS) - {*word_lists.OF_SEVERAL, "any", "one"}) | frozenset(
    ("this", "that", "these", "those", "his", "her", "its", "their", "th", "yer")
)
"""Articles and what may stand in their place."""
PLACING = frozenset(word for word in (*word_lists.PLACING, *word_lists.RELATIONS) if " " not in word) | frozenset(
    ("at", "across", "over", "against", "under", "beneath", "underneath", "near", "next", "of", "tot", "by", "towards",
     "toward", "around", "through", "along")
)  # fmt: skip
"""Words that may stand before a place. "of" ends "on top of", "in front of"."""
PREPOSITIONS = PLACING | frozenset(
    ("from", "off", "out", "with", "for", "about", "as", "like", "without", "until", "before", "after", "during",
     "than", "among", "amongst", "above", "below", "past", "via", "per")
)  # fmt: skip
RELATIVES = frozenset(
    ("that", "that's", "who's", "which", "who", "whose", "where", "you", "i", "we", "she", "he", "they", "my")
)
"""Words that begin a clause about a thing: "the pen that writes", "the scarf she knitted"."""
CONTINUING = RELATIVES | frozenset(
    ("of", "with", "for", "from", "on", "by", "in", "without", "at", "to", "under", "near", "over", "and")
)
"""Words after which a span may go on."""
PRONOUNS = frozenset(
    ("i", "you", "he", "she", "it", "we", "they", "me", "him", "us", "them", "who", "which", "whose", "what", "there",
     "here", "one", "ones", "mine", "yours", "someone", "somebody", "something", "anything", "everything", "nothing",
     "where", "how", "why", "when", "it'd", "that's", "it's", "there's", "here's")
)  # fmt: skip
CONJUNCTIONS = frozenset(
    ("and", "or", "but", "so", "then", "because", "while", "if", "nor", "either", "neither", "since", "though",
     "although", "unless", "whether")
)  # fmt: skip
AUXILIARIES = frozenset(
    ("is", "are", "was", "were", "be", "been", "being", "am", "do", "does", "did", "has", "have", "had", "having",
     "can", "could", "will", "would", "shall", "should", "may", "might", "must", "ought", "goes", "go", "went", "going",
     "belongs", "belong", "lives", "needs", "need", "want", "wants", "let's", "let", "i'm", "i'd", "i've", "i'll",
     "we'd", "we're", "we'll", "you're", "don't")
)  # fmt: skip
ADVERBS = frozenset(
    ("not", "never", "no", "please", "pls", "plz", "now", "just", "kindly", "back", "away", "up", "down", "also",
     "too", "very", "quickly", "gently", "carefully", "thanks", "thank", "ok", "okay", "hey", "hi", "hello", "oi",
     "sorry", "well", "yes", "straight", "already", "pronto", "asap", "quick", "instead", "again", "here", "there",
     "right", "all", "every", "each", "any", "both", "half")
)  # fmt: skip
"""Besides adverbs, what is said around a request, and words for amounts."""
CLOSED = ARTICLES | PREPOSITIONS | PRONOUNS | CONJUNCTIONS | AUXILIARIES | ADVERBS
ENDING = frozenset(
    ("it", "me", "there", "up", "down", "away", "here", "him", "you", "them", "back", "in", "on", "out", "off")
)
"""Closed words at which a clause about a thing may end: "the potato that rolled away"."""
LONGEST = 9
"""A span with a clause has at most this number of words."""


@dataclass(frozen=True)
class Sentence:
    """A sentence as words.

    Attributes:
        text: as it was said.
        words: in small letters; each sign is a word.
        places: where each word begins and ends in the text.
    """

    text: str
    words: tuple[str, ...]
    places: tuple[Span, ...]

    @classmethod
    def read(cls, text: str) -> Sentence:
        """Cut a text into words."""
        matches = list(TOKEN.finditer(text))
        words = tuple(plain_apostrophes(match.group().lower()) for match in matches)
        return cls(text, words, tuple(match.span() for match in matches))

    def said(self, span: Span) -> str:
        """The text of a span, as it was said."""
        return self.text[self.places[span[0]][0] : self.places[span[1] - 1][1]]

    def word(self, index: int) -> str:
        """A word; "" outside the sentence."""
        return self.words[index] if 0 <= index < len(self.words) else ""

    def is_sign(self, index: int) -> bool:
        """Whether there is no word at an index, but a sign, or an end of the sentence."""
        return not self.word(index)[:1].isalnum()

    def is_open(self, index: int) -> bool:
        """Whether a word is of no closed class. "can" is open in "watering can", "back" in "the back of"."""
        word = self.word(index)
        if word == "can" and self.word(index - 1) == "can":  # the second one of "the watering can can go"
            return False
        if word == "can":
            return self.is_open(index - 1) and not self.is_open(index + 1) and self.word(index + 1) not in PRONOUNS
        if word == "left" and self.word(index + 1) == "of":
            return False
        if word in ("back", "top", "front") and self.word(index + 1) == "of":
            return self.word(index - 1) in ARTICLES
        return word[:1].isalnum() and word not in CLOSED


def spans(sentence: Sentence) -> list[Span]:
    """The spans that may name a thing.

    A span begins with an open word: the first of a run, or the second one, since the first may be a verb. It ends where
    the run does, or goes on with "of ...", "with ...", "that ...".
    """
    found = []
    for start in range(len(sentence.words)):
        if not sentence.is_open(start):
            continue
        after_determiner = sentence.word(start - 2) in ARTICLES
        if sentence.is_open(start - 1) and (sentence.is_open(start - 2) or after_determiner):
            continue
        found += [(start, end) for end in _ends(sentence, start)]
    return found


def _ends(sentence: Sentence, start: int) -> Iterator[int]:
    """Where spans that begin at ``start`` may end."""
    run = start
    while sentence.is_open(run):
        run += 1
    yield run
    if run - start > 1 and sentence.word(start - 1) in ARTICLES and not sentence.is_sign(run):
        yield run - 1  # The last word may be a verb: "to the workbench carry the hammer".
    if sentence.word(run) not in CONTINUING and not sentence.word(run - 1).endswith("ing"):
        return
    for end in range(run + 1, min(len(sentence.words), start + LONGEST) + 1):
        if sentence.is_sign(end - 1):
            return
        of_a_run = sentence.is_open(end - 1)
        if (of_a_run and not sentence.is_open(end)) or sentence.word(end - 1) in ENDING:
            yield end
