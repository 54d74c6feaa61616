"""The tasks by name: families with their variants, and what makes a task of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from gem_lite.registry import Registry
from gem_lite.simulation.task import Split, Task

T = TypeVar("T", bound=type[Task])
SPLITS: tuple[Split, ...] = ("train", "val", "test")


@dataclass(frozen=True)
class Variant:
    """One task of a family.

    Attributes:
        family: the family's name; its variants share one file of results.
        task: the family's class.
        arguments: what the class is given besides the split.
    """

    family: str
    task: Callable[..., Task]
    arguments: Mapping[str, Any] = field(default_factory=dict)


TASKS: Registry[Variant] = Registry("task")


def register(family: str, variants: Mapping[str, Mapping[str, object]] | None = None) -> Callable[[T], T]:
    """Register a family's class and its tasks.

        @register("put-block-in-bowl", {"seen-colors": {}, "unseen-colors": {"unseen": True}})
        class PutBlockInBowl(Task): ...

    Args:
        family: its name; a task is called family-variant.
        variants: the arguments of the class by the variant's name. Without any, the family is one task with its name.

    Raises:
        ValueError: another module has registered a task with such a name.
    """

    def add(task: T) -> T:
        named = (
            {f"{family}-{ending}": arguments for ending, arguments in variants.items()} if variants else {family: {}}
        )
        for name, arguments in named.items():
            TASKS.add(name, Variant(family, task, arguments), task.__module__)
        return task

    return add


def names() -> tuple[str, ...]:
    """The names of all tasks."""
    return TASKS.names()


def family(name: str) -> str:
    """The family of the task with a name. Raises ValueError with the nearest names if there is none."""
    return TASKS.find(name).family


def variants(family: str) -> tuple[str, ...]:
    """The names of a family's tasks; none if there is no such family."""
    return tuple(name for name in names() if TASKS.find(name).family == family)


def make(name: str, split: Split = "train") -> Task:
    """The task of that name, with the colours and shapes of ``split``.

    An "unseen" variant takes them from the unseen sets in validation and test; in training, and in every other
    task, they are the seen ones.

    Raises:
        ValueError: unknown name (the message has the nearest ones) or split.
    """
    if split not in SPLITS:
        raise ValueError(f"split must be one of {', '.join(SPLITS)}, got {split!r}")
    variant = TASKS.find(name)
    return variant.task(split, **variant.arguments)
