"""Lists of names for the help: those of the library and those of imported modules."""

from __future__ import annotations

from gem_lite import tasks
from gem_lite.policies import methods
from gem_lite.simulation import worlds


def task_names() -> str:
    """Every task, one per line."""
    return "\n".join(["tasks:", *(f"  {name}" for name in tasks.names()), ""])


def world_names() -> str:
    """Every world."""
    return f"worlds:\n  {', '.join(worlds.names())}\n"


def method_names() -> str:
    """Every learned method, with the meaning of its name."""
    return methods.help_text() + "\n"
