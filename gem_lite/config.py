"""The configuration that all methods share. Each method adds its own numbers in a dataclass beside its class.

A configuration is flat: each value has one name. By its types it has two parts. `InputConfig`, and what derives from it
alone, is what a policy reads when it turns views and a sentence into its networks' inputs. `Config` adds what networks,
training and acting read. Prepared training steps are made with the first part (`Config.inputs`), and know no other.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from gem_lite.se2 import CELLS_MULTIPLE, LONGEST_SIDE, Workspace

T = TypeVar("T")


class Allowed(NamedTuple):
    """What an entry of a configuration may be: in words, as an error message says it, and as a test of a value."""

    words: str
    holds: Callable[[Any], bool]


def whole_number(low: int, high: int | None = None, *, odd: bool = False) -> Allowed:
    """A whole number from ``low`` on, or to ``high``."""
    return Allowed(
        f"{'an odd' if odd else 'a'} whole number from {low} {'on' if high is None else f'to {high}'}",
        lambda value: (
            type(value) is int and value >= low and (high is None or value <= high) and (value % 2 == 1 or not odd)
        ),
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def number(low: float, high: float) -> Allowed:
    """A number from ``low`` to ``high``, both included."""
    return Allowed(f"a number from {low} to {high}", lambda value: _is_number(value) and low <= value <= high)


def above_0(high: float) -> Allowed:
    """A number above 0, at most ``high``."""
    return Allowed(f"a number above 0 and up to {high}", lambda value: _is_number(value) and 0 < value <= high)


def each(value_allowed: Allowed, count: int) -> Allowed:
    """A tuple of ``count`` values."""
    return Allowed(
        f"{count} values, each {value_allowed.words}",
        lambda value: isinstance(value, tuple) and len(value) == count and all(map(value_allowed.holds, value)),
    )


def or_none(value_allowed: Allowed) -> Allowed:
    """A value or None."""
    return Allowed(f"{value_allowed.words}, or None", lambda value: value is None or value_allowed.holds(value))


COUNT = whole_number(1)
FLAG = Allowed("True or False", lambda value: isinstance(value, bool))
TEXT = Allowed("a text", lambda value: isinstance(value, str))
TEXTS = Allowed("a tuple of texts", lambda value: isinstance(value, tuple) and all(map(TEXT.holds, value)))
FACTORS = Allowed(
    f"up to 4 values, each {above_0(10).words}",
    lambda value: isinstance(value, tuple) and len(value) <= 4 and all(map(above_0(10).holds, value)),
)
LENGTH = above_0(LONGEST_SIDE)
"""A length on a table (m)."""
RADIUS = number(0, LONGEST_SIDE)
"""A distance on a table (m), or 0."""


def entry(default: T, allowed: Allowed, *, added: bool = False, grows: bool = False) -> T:
    """An entry of a configuration, as the default of a dataclass's field.

    Args:
        allowed: what it may be.
        added: whether it is younger than some stored rows. Then it is left out of `InputConfig.as_dict` while it has
            its default, so that configurations, and what is named after them, stay what they were.
        grows: whether it is a size of things, in metres, or in cells if it is a whole number (`Config.for_table`).
    """
    return field(default=default, metadata={"allowed": allowed, "added": added, "grows": grows})


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
class InputConfig:
    """What decides the inputs of every method's networks. A method whose inputs need more derives its own part.

    Attributes:
        table: length of the table (m); it is half as wide. Its middle is that of the default workspace.
        pixel: size of a height map's cell (m).
        parser: the name of the reader of instructions (`language.PARSERS`).
        parsing: whether the method gets two phrases, or the whole instruction twice.
        locations: whether a location word chooses among the responses of a semantic map
            (`maps.query_maps.located`), for methods whose networks or gates have one.
        location_code: whether the networks get the location words of a phrase besides its embedding
            (`language.location_code`).
        rectangle: x_min, x_max, y_min, y_max (m) of a table of another form; then ``table`` has no effect.

    Raises:
        ValueError: a value that its `entry` does not allow, a table that the pixels do not cover evenly, or a rectangle
            that is none.
    """

    table: float = entry(1.0, LENGTH)
    pixel: float = entry(0.00625, LENGTH)
    parser: str = entry("grammar", TEXT)
    parsing: bool = entry(True, FLAG)
    locations: bool = entry(True, FLAG)
    location_code: bool = entry(True, FLAG, added=True)
    rectangle: tuple[float, float, float, float] | None = entry(
        None, or_none(each(number(-1000, 1000), 4)), added=True
    )  # fmt: skip

    def __post_init__(self) -> None:
        for setting in fields(self):
            value = getattr(self, setting.name)
            allowed = setting.metadata.get("allowed")
            if allowed and not allowed.holds(value):
                raise ValueError(f"{setting.name} must be {allowed.words}, got {value!r}")
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
        """The entries as JSON holds them: tuples become lists. Those that were added are left out at their default."""
        values = {
            setting.name: getattr(self, setting.name)
            for setting in fields(self)
            if not setting.metadata.get("added") or getattr(self, setting.name) != setting.default
        }
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The inverse of `as_dict`; missing entries get their defaults.

        Raises:
            ValueError: names that this configuration does not have, or values that contradict each other.
        """
        unknown = set(values) - {setting.name for setting in fields(cls)}
        if unknown:
            raise ValueError(f"the configuration has unknown entries {sorted(unknown)}")
        entries: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in values.items()
        }
        return cls(**entries)


@dataclass(frozen=True)
class Config(InputConfig):
    """What every method needs. The defaults are those of `lite`: for two CPU cores; `paper` is for a GPU.

    A method derives its own configuration from this one: more fields, `PRESETS` with their values in `paper`,
    `ABLATIONS`, and the class of its `INPUTS`, from which the configuration derives, too.

    Attributes:
        name: the preset from which it was made.
        angles: how many angles are sampled at the output.
        empty_radius: how far (m) a pick keeps away from poses where the tool has just grasped nothing.
        joint_picks: for how many of the best picks the best place is computed; the act with the largest product of
            both probabilities is chosen (A.1.6). With 1, the best pick comes first, and then its place.
        turn: whether training turns scenes; it always shifts them.
        steps, batch, learning_rate: training.
        ablations: the `ABLATIONS` from which it was made (`ablated`). They become part of the method's name; the same
            values without an ablation do not.

    Raises:
        ValueError: see `InputConfig`; or an unknown ablation, or a value that contradicts an ablation.
    """

    INPUTS: ClassVar[type[InputConfig]] = InputConfig
    """The part that decides the inputs of the method's networks."""
    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {"pixel": 0.003125, "angles": 72, "steps": 30_000, "batch": 1, "learning_rate": 1e-4},
    }
    """The entries that each preset changes, by its name."""
    ABLATIONS: ClassVar[Mapping[str, Ablation]] = SHARED_ENDINGS
    """Endings of a method's name (A.2), in the order in which a name holds several."""
    ACTING: ClassVar[frozenset[str]] = frozenset({"empty_radius", "joint_picks"})
    """The entries that only rules of acting read, or that a rule also has in training: no weight depends on their form,
    so a trained policy can act with other values (`Policy.act_as`)."""

    name: str = entry("lite", TEXT)
    angles: int = entry(36, COUNT)
    empty_radius: float = entry(0.0125, RADIUS, grows=True)
    joint_picks: int = entry(1, COUNT, added=True)
    turn: bool = entry(True, FLAG)
    steps: int = entry(1500, COUNT)
    batch: int = entry(2, COUNT)
    learning_rate: float = entry(1e-3, above_0(1))
    ablations: tuple[str, ...] = entry((), TEXTS)

    def __post_init__(self) -> None:
        super().__post_init__()
        for ending in self.ablations:
            for key, value in self.ablation(ending).changes.items():
                if getattr(self, key) != value:
                    raise ValueError(
                        f"{ending} needs {key} = {value!r}, got {getattr(self, key)!r}: "
                        "it cannot be combined with another ablation or value of the same setting"
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
    def inputs(self) -> InputConfig:
        """The part that decides the inputs of the networks, and no other entry."""
        return self.INPUTS(**{setting.name: getattr(self, setting.name) for setting in fields(self.INPUTS)})

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

    def for_table(self, limits: tuple[float, float, float, float], scale: float = 1.0) -> Self:
        """This configuration for another table, covered by as many pixels along y.

        Args:
            limits: x_min, x_max, y_min, y_max (m) of the table.
            scale: the size of the things on it, as a multiple of CLIPort's. Every entry that `grows` becomes the
                nearest allowed value in proportion, except those that an ablation has set.
        """
        table = self.on_table(limits[3] - limits[2])
        usual = table.workspace
        if scale == 1 and np.allclose(usual.limits, limits):
            return table
        kept = {key for ending in self.ablations for key in self.ablation(ending).changes}
        in_cells = scale * self.pixel / table.pixel
        sizes: dict[str, Any] = {}
        for setting in fields(self):
            if setting.metadata.get("grows") and setting.name not in kept:
                value = getattr(self, setting.name)
                sizes[setting.name] = value * scale
                if isinstance(value, int):
                    sizes[setting.name] = _nearest_allowed(value * in_cells, setting.metadata["allowed"])
        return replace(self, rectangle=limits, pixel=table.pixel, **sizes)

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that stand for every entry: SHA-256 of `as_dict` as JSON with sorted keys."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()[:12]


def _nearest_allowed(size: float, allowed: Allowed) -> int:
    """The whole number nearest to ``size`` that is allowed."""
    return min(filter(allowed.holds, range(1, 2 * math.ceil(size) + 32)), key=lambda value: abs(value - size))
