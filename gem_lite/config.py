"""The configuration that all methods share. Each method adds its own numbers in a dataclass beside its class."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

from gem_lite.se2 import CELLS_MULTIPLE, LONGEST_SIDE, Workspace


class Allowed(NamedTuple):
    """What an entry of a configuration may be: in words, as an error message says it, and as a test of a value."""

    words: str
    holds: Callable[[Any], bool]


def whole_number(low: int, *, odd: bool = False) -> Allowed:
    """A whole number from ``low`` on."""
    return Allowed(
        f"{'an odd' if odd else 'a'} whole number from {low} on",
        lambda value: type(value) is int and value >= low and (value % 2 == 1 or not odd),
    )


def up_to(high: int) -> Allowed:
    """A whole number from 0 to ``high``."""
    return Allowed(f"a whole number from 0 to {high}", lambda value: type(value) is int and 0 <= value <= high)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def number(low: float, high: float) -> Allowed:
    """A number from ``low`` to ``high``, both included."""
    return Allowed(f"a number from {low} to {high}", lambda value: _is_number(value) and low <= value <= high)


def above_0(high: float) -> Allowed:
    """A number above 0, at most ``high``."""
    return Allowed(f"a number above 0 and up to {high}", lambda value: _is_number(value) and 0 < value <= high)


def each(entry: Allowed, count: int) -> Allowed:
    """A tuple of ``count`` values."""
    return Allowed(
        f"{count} values, each {entry.words}",
        lambda value: isinstance(value, tuple) and len(value) == count and all(map(entry.holds, value)),
    )


def one_of(names: Sequence[str]) -> Allowed:
    """One of some names."""
    return Allowed(f"one of {', '.join(names)}", lambda value: value in names)


def or_none(entry: Allowed) -> Allowed:
    """A value or None."""
    return Allowed(f"{entry.words}, or None", lambda value: value is None or entry.holds(value))


COUNT = whole_number(1)
FLAG = Allowed("True or False", lambda value: isinstance(value, bool))
TEXT = Allowed("a text", lambda value: isinstance(value, str))
TEXTS = Allowed("a tuple of texts", lambda value: isinstance(value, tuple) and all(map(TEXT.holds, value)))
LENGTH = above_0(LONGEST_SIDE)
"""A length on a table (m)."""
RADIUS = number(0, LONGEST_SIDE)
"""A distance on a table (m), or 0."""


class Ablation(NamedTuple):
    """One ablation (Table A2): its meaning in words, and the entries of a configuration that it changes."""

    meaning: str
    changes: Mapping[str, Any]


SHARED_ABLATIONS = {
    "without-parsing": Ablation("both phrases are the whole instruction", {"parsing": False}),
    "without-rotation-augmentation": Ablation("training moves scenes, but does not turn them", {"turn": False}),
    "without-location-code": Ablation("the networks do not get the location words, counted", {"location_code": False}),
    "without-empty-spots": Ablation("a spot where nothing was grasped may be tried again", {"empty_radius": 0.0}),
}
"""Ablations that mean something for every method."""
MULTI_TASK = "multi"
"""The ending of a method's name if its policy was trained on several tasks."""
SHARED_ENDINGS = {**SHARED_ABLATIONS, MULTI_TASK: Ablation("one policy for several tasks", {})}


@dataclass(frozen=True)
class Config:
    """What every method needs. The defaults are those of `lite`: for two CPU cores; `paper` is for a GPU.

    A method derives its own configuration from this one: more fields, `PRESETS` with their values in `paper`,
    `ABLATIONS`, `AFTER_PREPARATION` and `ALLOWED`.

    Attributes:
        name: the preset from which it was made.
        table: length of the table (m); it is half as wide. Its middle is that of the default workspace.
        rectangle: x_min, x_max, y_min, y_max (m) of a table of another form; then ``table`` has no effect.
        pixel: size of a height map's cell (m).
        angles: how many angles are sampled at the output.
        parser: the name of the reader of instructions (`language.PARSERS`).
        parsing: whether the method gets two phrases, or the whole instruction twice.
        locations: whether a location word chooses among the responses of a semantic map
            (`maps.query_maps.located`), for methods whose networks or gates have one.
        location_code: whether the networks get the location words of a phrase besides its embedding
            (`language.location_code`).
        empty_radius: how far (m) a pick keeps away from poses where the tool has just grasped nothing.
        turn: whether training turns scenes; it always shifts them.
        steps, batch, learning_rate: training.
        ablations: the `ABLATIONS` from which it was made (`ablated`). They become part of the method's name; the same
            values without an ablation do not.

    Raises:
        ValueError: a value that `ALLOWED` does not allow, a table that the pixels do not cover evenly, an unknown
            ablation, a value that contradicts an ablation, or a rectangle that is none.
    """

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {"pixel": 0.003125, "angles": 72, "steps": 30_000, "batch": 1, "learning_rate": 1e-4},
    }
    """The entries that each preset changes, by its name."""
    ABLATIONS: ClassVar[Mapping[str, Ablation]] = SHARED_ENDINGS
    """Endings of a method's name (A.2), in the order in which a name holds several."""
    AFTER_PREPARATION: ClassVar[frozenset[str]] = frozenset({
        "name", "angles", "empty_radius", "turn", "steps", "batch", "learning_rate", "ablations",
    })  # fmt: skip
    """The entries that the preparation of training steps does not read: names, and what only networks, training and
    acting read. Configurations that differ in these alone have the same prepared steps (`preparation`). A method whose
    preparation reads one of them leaves it out of its own set; a new field is in no set until somebody adds it."""
    ALLOWED: ClassVar[Mapping[str, Allowed]] = {
        "name": TEXT, "table": LENGTH, "pixel": LENGTH, "angles": COUNT, "parser": TEXT, "parsing": FLAG,
        "locations": FLAG, "location_code": FLAG, "empty_radius": RADIUS, "turn": FLAG, "steps": COUNT, "batch": COUNT,
        "learning_rate": above_0(1), "ablations": TEXTS, "rectangle": or_none(each(number(-1000, 1000), 4)),
    }  # fmt: skip
    """What each entry may be."""

    ACTING: ClassVar[frozenset[str]] = frozenset({"empty_radius"})
    """The entries that only rules of acting read, or that a rule also has in training: no weight depends on their form,
    so a trained policy can act with other values (`Policy.act_as`)."""
    ADDED: ClassVar[frozenset[str]] = frozenset({"rectangle", "location_code"})
    """The entries that are younger than some stored rows. They are left out of `as_dict` while they have their default,
    so that configurations, and what is named after them, stay what they were."""

    name: str = "lite"
    table: float = 1.0
    pixel: float = 0.00625
    angles: int = 36
    parser: str = "grammar"
    parsing: bool = True
    locations: bool = True
    location_code: bool = True
    empty_radius: float = 0.0125
    turn: bool = True
    steps: int = 1500
    batch: int = 2
    learning_rate: float = 1e-3
    ablations: tuple[str, ...] = ()
    rectangle: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        for name, allowed in self.ALLOWED.items():
            value = getattr(self, name)
            if not allowed.holds(value):
                raise ValueError(f"{name} must be {allowed.words}, got {value!r}")
        for ending in self.ablations:
            for key, value in self.ablation(ending).changes.items():
                if getattr(self, key) != value:
                    raise ValueError(
                        f"{ending} needs {key} = {value!r}, got {getattr(self, key)!r}: "
                        "it cannot be combined with another ablation or value of the same setting"
                    )
        if self.rectangle is not None:
            Workspace.covering(*self.rectangle, pixel=self.pixel)  # It refuses what is no rectangle.
        else:
            self._check_cells()

    def _check_cells(self) -> None:
        """Refuse a table that the pixels do not cover evenly, with the multiples of cells that networks need."""
        parts = self.table / (2 * CELLS_MULTIPLE * self.pixel)
        nearest = max(round(parts), 1)
        if abs(parts - nearest) > 1e-6:
            raise ValueError(
                f"pixel must divide a table of {self.table} m by {self.table / 2} m into multiples of {CELLS_MULTIPLE} "
                f"cells, such as {self.table / (2 * CELLS_MULTIPLE * nearest):.6g}, got {self.pixel}"
            )

    @classmethod
    def preset(cls, name: str = "lite") -> Self:
        """One of the `PRESETS`. Raises ValueError if there is none with this name."""
        if name not in cls.PRESETS:
            raise ValueError(f"preset must be one of {', '.join(cls.PRESETS)}, got {name!r}")
        return cls(name=name, **cls.PRESETS[name])

    @classmethod
    def ablation(cls, ending: str) -> Ablation:
        """One of the `ABLATIONS`. Raises ValueError if the method has none with this name."""
        if ending not in cls.ABLATIONS:
            raise ValueError(f"the ablation must be one of {', '.join(cls.ABLATIONS)}, got {ending!r}")
        return cls.ABLATIONS[ending]

    @property
    def variant(self) -> str:
        """The ending of a method's name: "" or its ablations, such as "-without-parsing"."""
        return "".join(f"-{ending}" for ending in self.ablations)

    def ablated(self, ending: str) -> Self:
        """This configuration changed by one of `ABLATIONS`, and named after it.

        Raises:
            ValueError: no such ablation, or one that contradicts another.
        """
        changes = self.ablation(ending).changes
        ablations = tuple(known for known in self.ABLATIONS if known in (*self.ablations, ending))
        return replace(self, **changes, ablations=ablations)

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that stand for every entry: SHA-256 of `as_dict` as JSON with sorted keys."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()[:12]

    @property
    def workspace(self) -> Workspace:
        """The workspace at this configuration's resolution."""
        if self.rectangle is None:
            return Workspace.of_length(self.table, self.pixel)
        return Workspace.covering(*self.rectangle, pixel=self.pixel)

    def on_table(self, length: float) -> Self:
        """This configuration for a table of another length (m), covered by as many pixels."""
        return replace(self, table=length, pixel=self.pixel * length / self.table)

    def as_dict(self) -> dict[str, Any]:
        """The entries as JSON holds them: tuples become lists. Those in `ADDED` are left out at their default."""
        defaults = {entry.name: entry.default for entry in fields(self)}
        entries = {
            key: value for key, value in asdict(self).items() if key not in self.ADDED or value != defaults[key]
        }  # fmt: skip
        return {key: list(value) if isinstance(value, tuple) else value for key, value in entries.items()}

    @property
    def preparation(self) -> dict[str, Any]:
        """The entries that decide prepared training steps, as JSON holds them: all but `AFTER_PREPARATION`."""
        return {key: value for key, value in self.as_dict().items() if key not in self.AFTER_PREPARATION}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The inverse of `as_dict`; missing entries get their defaults.

        Raises:
            ValueError: names that this configuration does not have, or values that contradict each other.
        """
        unknown = set(values) - {entry.name for entry in fields(cls)}
        if unknown:
            raise ValueError(f"the configuration has unknown entries {sorted(unknown)}")
        entries: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in values.items()
        }
        return cls(**entries)
