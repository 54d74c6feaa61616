"""The tasks by name: families and their variants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from gem_lite.foundations.registry import Registry
from gem_lite.tasks.task import Split, Task

T = TypeVar("T", bound=type[Task])
SPLITS: tuple[Split, ...] = ("train", "val", "test")


@dataclass(frozen=True)
class Variant:
    """One task of a family.

    Attributes:
        family: the name of the family. The variants of a family share one file of results.
        task: the class of the family.
        arguments: the arguments of the class besides the split.
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
        family: the name of the family. The name of a task is family-variant.
        variants: the arguments of the class by the name of the variant. Without variants, the family has one task, and
            the task has the family's name.

    Raises:
        ValueError: another module has registered a task with the same name.
    """

    def add(task: T) -> T:
        for variant, arguments in (variants or {"": {}}).items():
            name = f"{family}-{variant}" if variant else family
            TASKS.add(name, Variant(family, task, arguments), task.__module__)
        return task

    return add


def names() -> tuple[str, ...]:
    """The names of all tasks."""
    return TASKS.names()


def family(name: str) -> str:
    """The family of the task with this name. If there is none, raises ValueError with the nearest names."""
    return TASKS.find(name).family


def variants(family: str) -> tuple[str, ...]:
    """The names of the tasks of a family; empty if the family is unknown."""
    return tuple(name for name in names() if TASKS.find(name).family == family)


def make(name: str, split: Split = "train") -> Task:
    """Make the task with this name, with the colours and shapes of ``split``.

    An "unseen" variant takes them from the unseen sets in validation and test. In training, and in every other
    task, they come from the seen sets.

    Raises:
        ValueError: the name is unknown (the message has the nearest names), or the split is.
    """
    if split not in SPLITS:
        raise ValueError(f"split must be one of {', '.join(SPLITS)}, got {split!r}")
    variant = TASKS.find(name)
    return variant.task(split, **variant.arguments)
