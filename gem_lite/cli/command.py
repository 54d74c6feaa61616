"""What the subcommands share: one typed dataclass each, whose fields are its arguments."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Self

import tyro
from tyro import _errors as tyro_errors
from tyro.conf import FlagCreatePairsOff, PositionalMetavarFromFieldName, UseAppendAction

from gem_lite.cli import errors

MARKERS = (FlagCreatePairsOff, PositionalMetavarFromFieldName)
WHERE_ROWS_GO = tyro.conf.create_mutex_group(required=False)


@dataclass(frozen=True, kw_only=True)
class Command:
    """A subcommand: `tyro` fills its fields from the command line, `run` does the work.

    The class's docstring and its fields' are the help. Bad values that only the library knows end in its ValueError
    or OSError, which `gem_lite.cli.main` prints as one sentence.
    """

    examples: ClassVar[tuple[str, ...]] = ()
    """Command lines that work: the end of the help."""
    failures: ClassVar[tuple[type[Exception], ...]] = (OSError, ValueError)
    """What says in one sentence why the command cannot do its work; anything else is an error of the program."""

    def run(self) -> None:
        """Do what the command is for, and print what came of it."""
        raise NotImplementedError

    def after_stop(self) -> str:
        """What to say after Ctrl-C: how to go on, if that is possible."""
        return "stopped"

    @classmethod
    def defaults(cls, words: Sequence[str]) -> Self | None:
        """An instance with the defaults that depend on ``words``, the command line; None for those of the fields."""
        return None

    @classmethod
    def more_help(cls) -> str:
        """What the help says between the options and the examples."""
        return ""


@dataclass(frozen=True, kw_only=True)
class Outside(Command):
    """A command that takes names which modules outside the package may add."""

    import_: Annotated[UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="import", metavar="MODULE")] = ()
    """module of yours that registers tasks, methods or others, found as python -m finds it (repeatable)"""


@dataclass(frozen=True, kw_only=True)
class Filed(Outside):
    """A command whose outcome is rows of results."""

    file: Annotated[bool, WHERE_ROWS_GO] = False
    """file the rows in data/results (without it they go to runs/results)"""
    out: Annotated[Path | None, WHERE_ROWS_GO] = None
    """write the rows to this file instead"""


def parse(command: type[Command], name: str, words: Sequence[str]) -> Command:
    """A command's instance from its command line; loads the modules that ``--import`` names.

    Raises:
        ValueError: what is wrong with the words, in one sentence.
        SystemExit: with code 0, after the help was asked for and printed.
    """
    prog = f"gem-lite {name}"
    with tyro_errors.on_parse_error(errors.refuse):
        if issubclass(command, Outside):
            load_outside(words)
        defaults = command.defaults(words)
        errors.check_options(words, defaults or command, prog)
        start = {} if defaults is None else {"default": defaults}
        try:
            return tyro.cli(command, prog=prog, args=words, config=MARKERS, **start)
        except SystemExit as end:
            if not end.code:
                print("\n".join([*filter(None, [command.more_help()]), *example_lines(command)]))
            raise


def example_lines(command: type[Command]) -> list[str]:
    """The end of a command's help."""
    title = "example:" if len(command.examples) == 1 else "examples:"
    return [title, *(f"  {example}" for example in command.examples)]


def first_look(part: type, words: Sequence[str]) -> object:
    """The few fields of the dataclass ``part`` from a command line that holds more."""
    known, _ = tyro.cli(part, args=words, return_unknown_args=True, add_help=False, config=MARKERS)
    return known


def load_outside(words: Sequence[str]) -> None:
    """Import the modules that ``--import`` names in ``words``.

    Raises:
        ValueError: no such module.
    """
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # As python -m does; the command's own script has its folder there.
    for module in first_look(Outside, words).import_:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            raise ValueError(f"--import {module}: {error}") from error
