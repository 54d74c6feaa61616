"""The library's own parser of instructions (the noun parser of A.1.6).

Its grammar (``?``: may be missing, ``*``: any number of times, ``|``: or)::

    instruction = OPENING* verb pick place CLOSING*
                | OPENING* verb pick joint verb pronoun? place CLOSING*
                | OPENING* "align" phrase "from" list "to" list CLOSING*         the place is "... to ..."
    verb        = VERB PARTICLE?
    joint       = PARTICLE? ("," | "and" | "then")*      as in "pick the mug up, and then place it"
    pronoun     = "it" | "them"
    pick        = phrase | thing LOCATION? part
    place       = ","? PLACING phrase | ","? RELATION phrase ("and" phrase)?
    phrase      = list | DETERMINER* LEADING thing | thing LOCATION
    list        = thing | (thing ",")* thing ","? "and" thing
    thing       = DETERMINER* word word*                 with "of the ..." and "with ..." among the words
    part        = "by its ..." | "by their ..." | "by the" PART

Words in capitals are the tuples of `word_lists`. Besides:

* A phrase with a location word has it in front, however it was said: "the red block on the left" and "the leftmost red
  block" give "left red block" (`phrases`). Elsewhere such a word is refused, except in a name ("top hat"), as a noun
  ("middle of the stand") and in what "align" names.
* "red and white flashlight" is one thing (`phrases.conjuncts`). In other lists, a determiner or an adjective is after
  "and", or adjectives alone before it: another word could be a verb. A place is a list only of adjectives with one noun
  ("on the green and blue blocks"), and has no determiner of `OF_SEVERAL`.
* A relation gives one phrase in few wordings: "put it next to the mug" gives "beside mug". One thing comes after it, or
  two after "between". After a verb of `TAKING`, it could say where the thing lies, and is refused.
* An adjective or a word of `FEATURES` comes after "with".
* A word of `RESERVED`, a contraction ("that's"), an adverb in "ly", and a number before its thing are in no phrase.

What the grammar does not cover is refused, never guessed: a wrong phrase would send the robot somewhere without a
warning.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NoReturn

from gem_lite.language import phrases, word_lists
from gem_lite.language.pictured import Instruction, PictureSentence
from gem_lite.language.queries import PARSERS, Queries
from gem_lite.language.word_lists import BETWEEN, DETERMINERS, PARTICLES, PLACING, RELATIONS, SIDES, VERBS

EXAMPLE = 'for example "put the red block in the green bowl"'


def parse(instruction: Instruction) -> Queries:
    """Split an instruction into what to pick and where to place it. Its pictures are things, too.

    "put the red blocks in a green bowl" gives "red blocks" and "green bowl"; "grasp the scissors by its handle and
    place into the brown box" gives "scissors handle" and "brown box"; "put the fork between the mug and the box" gives
    "fork" and "between mug and box". Phrases are in small letters.

    Raises:
        ValueError: the instruction is empty, starts with no known verb, names no pick or no place, or has words
            that the grammar does not cover: a second clause, "from ... to ...", "near ...", "gently".
    """
    if isinstance(instruction, PictureSentence):
        return instruction.queries(parse)[0]
    if not isinstance(instruction, str) or not instruction.strip():
        raise ValueError(f"the instruction is empty; say what to pick and where to place it, {EXAMPLE}")
    return _Reader(instruction).queries()


PARSERS.register("grammar")(parse)  # not as a decorator, so that its type stays: one goal for an instruction


def parse_thing(text: str) -> str:
    """The phrase of a text that names a thing alone: "the red block on the left" gives "left red block".

    Raises:
        ValueError: the text names nothing, or more than the rule ``phrase`` of the grammar covers.
    """
    return _Reader(text).thing()


def _text(words: Iterable[str]) -> str:
    return " ".join(words).replace(" ,", ",")


class _Reader:
    """Reads an instruction from left to right; ``position`` is the next word's index."""

    def __init__(self, instruction: str) -> None:
        self.instruction = instruction
        self.words = phrases.TOKEN.findall(instruction.lower())
        self.position = 0
        self.named: set[int] = set()  # the indices of words in `NAMES_WITH_RESERVED`
        for name in (name.split() for name in word_lists.NAMES_WITH_RESERVED):
            for start in range(len(self.words)):
                if self.words[start : start + len(name)] == name:
                    self.named.update(range(start, start + len(name)))
        while closing := next((c for c in word_lists.CLOSINGS if self.words[-len(c.split()) :] == c.split()), None):
            del self.words[-len(closing.split()) :]

    def queries(self) -> Queries:
        """The rule ``instruction``."""
        while self.accept(word_lists.OPENINGS):
            pass
        verb = self.accept(VERBS)
        if not verb:
            self.refuse(f"does not begin with a known verb ({', '.join(VERBS)})")
        if verb == word_lists.ALIGNING:
            return self.alignment()
        self.accept(PARTICLES)
        pick = self.pick()
        end_of_joint = self.joint(self.position)
        if not pick:
            if not end_of_joint and not self.fits((*PLACING, *RELATIONS)):
                self.refuse_rest()
            self.refuse("names nothing to pick")
        if end_of_joint:
            self.position = end_of_joint
            self.accept(PARTICLES)
            self.accept(("it", "them"))
            self.accept(PARTICLES)
        self.accept((",",))
        wording = self.accept((*PLACING, *RELATIONS))
        if not wording:
            self.refuse_rest()
            self.refuse("names no place")
        if wording not in RELATIONS:
            return Queries(pick, self.place(), verb == word_lists.PUSHING)
        if verb in word_lists.TAKING and not end_of_joint:
            self.refuse(f"says {wording!r}, but not whether the thing lies there or is to be put there")
        return Queries(pick, self.related_place(RELATIONS[wording]), verb == word_lists.PUSHING)

    def thing(self) -> str:
        """The rule ``phrase``, and nothing else."""
        phrase = self.phrase()
        self.refuse_rest()
        if not phrase:
            self.refuse("names no thing")
        return phrase

    def pick(self) -> str:
        """The rule ``pick``; "" if nothing is named."""
        phrase = self.phrase()
        part = self.part() if phrase else ""
        if part:  # "by its left handle"
            self.check_location(phrases.split_location(f"{phrase} {part}")[1])
        return f"{phrase} {part}".strip()

    def place(self) -> str:
        """The phrase of the rule ``place``, to the end of the instruction."""
        start = self.position
        phrase = self.phrase()
        self.refuse_rest()
        if not phrase:
            self.refuse("names no place")
        if not phrases.shares_noun(phrase):
            self.refuse(f"names several places, {phrase!r}; say one place")
        if self.words[start] in word_lists.OF_SEVERAL:
            self.refuse(f"says {self.words[start]!r} of a place; say one place")
        return phrase

    def related_place(self, relation: str) -> str:
        """The phrase of a relation and of the things after it, to the end of the instruction."""
        start = self.position
        phrase = self.phrase()
        anchors = list(phrases.conjuncts(phrase)) if phrase else []
        if relation == BETWEEN and len(anchors) == 1 and self.accept(("and",)):
            anchors.append(self.phrase())
        self.refuse_rest()
        several = any(word in word_lists.OF_SEVERAL for word in self.words[start:])
        if several or not all(anchors) or len(anchors) != phrases.anchor_count(relation):
            count = "two single things" if relation == BETWEEN else "one thing"
            self.refuse(f"must name {count} after {relation!r}")
        return phrases.with_relation(relation, anchors)

    def alignment(self) -> Queries:
        """The rest of the rule with "align": the place has a start and an end."""
        thing = self.phrase()
        start = self.things() if self.accept(("from",)) else []
        end = self.things() if self.accept(("to",)) else []
        self.refuse_rest()
        if not (thing and start and end):
            self.refuse('must say what to align, and along what, as in "align the rope from left corner to right tip"')
        return Queries(thing, f"{_text(start)} to {_text(end)}")

    def phrase(self) -> str:
        """The rule ``phrase``, with the location word in front; "" if nothing is named."""
        words = self.things()
        if all(word in SIDES for word in words):
            return ""
        phrase = _text(words)
        wording = self.location()
        try:
            things = phrases.conjuncts(phrase)
        except ValueError:
            self.refuse(f"names nothing on one side of 'and' in {phrase!r}")
        located = [f"{thing} {wording}".strip() for thing in things]
        word, thing = phrases.split_location(located[0])
        if word is None or len(things) > 1:
            for each in located:
                self.check_location(each)
            return phrase
        first, *rest = thing.split()
        if first in word_lists.NO_THINGS and rest[:1] in ([], ["of"]):
            self.refuse(f"names no thing but the {word} {first} of something")
        self.check_location(thing)
        return phrases.with_location(word, thing)

    def check_location(self, thing: str) -> None:
        """Raises ValueError if a thing has a location word that is not read."""
        word = phrases.split_location(thing)[0] or phrases.stray_location(thing.split())
        if word:
            self.refuse(f"says {word!r} where it is not understood; say it once, before the name of a single thing")

    def things(self) -> list[str]:
        """The rule ``list``: its words, without the first determiner."""
        start = self.position
        thing = start  # the start of the current member of the list
        while self.position < len(self.words) and not self.stops(start, thing):
            if self.words[self.position] in ("and", ","):
                thing = self.position + 1
            self.position += 1
        words = phrases.without_determiner(self.words[start : self.position])
        if "," in words and "and" not in words[words.index(",") :]:
            self.position = start + self.words[start:].index(",")
            self.refuse_rest()
        if all(word in SIDES and word not in word_lists.PARTS for word in words):
            return []
        if words[-1] in word_lists.AT_THE_END:  # "put the chair back in the box" has two meanings.
            self.position -= 1
            self.refuse_rest()
        return words

    def stops(self, start: int, thing: int) -> bool:
        """Whether the next word does not belong to a phrase that began at ``start``."""
        word = self.words[self.position]
        before = self.words[self.position - 1] if self.position > start else ""
        after = self.words[self.position + 1] if self.position + 1 < len(self.words) else ""
        if (before == "letter" and len(word) == 1 and word.isalnum()) or self.position in self.named:
            return False
        member = phrases.without_determiner(self.words[thing : self.position])
        if word in ("and", ","):
            # Any other word after "and" could be an unknown verb: "and leave".
            begins = (
                after == "and" or after in (*DETERMINERS, *word_lists.ADJECTIVES) or phrases.adjectives_alone(member)
            )
            return not (member and begins) or self.joint(self.position) > 0
        if word in DETERMINERS:
            return bool(before) and before not in ("of", "and", ",", *DETERMINERS) and word != "one"
        if word in SIDES and after == "of" and word not in word_lists.BEFORE_OF:
            return True
        if word == "of":
            return not before or not after
        if word == "with":
            return not before or after not in (*word_lists.ADJECTIVES, *word_lists.FEATURES)
        return (word.isdigit() and not member) or phrases.is_reserved(word)

    def location(self) -> str:
        """The rule ``LOCATION``, if the words after it do not continue the same thing; "" if it is missing."""
        start = self.position
        location = self.accept(word_lists.LOCATIONS)
        ends = self.position == len(self.words) or self.words[self.position] == "," or self.joint(self.position)
        if ends or self.fits((*PLACING, *RELATIONS, "by")):
            return location
        self.position = start
        return ""

    def part(self) -> str:
        """The rule ``part``: the words of the part alone; "" if it is missing."""
        start = self.position
        owner = self.accept(("by its", "by their", "by the"))
        words = self.things() if owner else []
        if words and "and" not in self.words[: self.position] and (owner != "by the" or words[-1] in word_lists.PARTS):
            return _text(words)
        self.position = start
        return ""

    def joint(self, start: int) -> int:
        """The rules ``joint`` and ``verb`` from ``start``: the index of the word after them, 0 if they do not fit."""
        end = start
        if end < len(self.words) and self.words[end] in PARTICLES:
            end += 1
        conjunction = end
        while end < len(self.words) and self.words[end] in (",", "and", "then"):
            end += 1
        if conjunction < end < len(self.words) and self.words[end] in VERBS:
            return end + 1
        return 0

    def fits(self, options: Iterable[str]) -> str:
        """The longest of ``options`` that the next words are, or ""."""
        fitting = [o for o in options if self.words[self.position : self.position + len(o.split())] == o.split()]
        return max(fitting, key=len, default="")

    def accept(self, options: Iterable[str]) -> str:
        """As `fits`, and move on to the word after it."""
        option = self.fits(options)
        self.position += len(option.split())
        return option

    def refuse_rest(self) -> None:
        """Raises ValueError if words are left."""
        if self.position < len(self.words):
            rest = _text(self.words[self.position :])
            self.refuse(f"has leftover words {rest!r} that are not understood; say one pick and one place")

    def refuse(self, reason: str) -> NoReturn:
        """Raises ValueError with the instruction, the reason and an example."""
        raise ValueError(f"the instruction {self.instruction!r} {reason}; {EXAMPLE}")
