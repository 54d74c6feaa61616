"""The base of all subcommands. Each is a typed dataclass, and its fields are its arguments."""

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
FILE_OR_OUT = tyro.conf.create_mutex_group(required=False)


@dataclass(frozen=True, kw_only=True)
class Command:
    """A subcommand: `tyro` fills its fields from the command line, and `run` does the work.

    The docstrings of the class and of its fields are the help. If the library refuses a value with a ValueError or an
    OSError, `gem_lite.cli.main` prints the message as one sentence.
    """

    examples: ClassVar[tuple[str, ...]] = ()
    """Command lines that work: the end of the help."""
    failures: ClassVar[tuple[type[Exception], ...]] = (OSError, ValueError)
    """Errors whose message tells the user why the command failed. Any other error is a bug."""

    def run(self) -> None:
        """Do the work and print the result."""
        raise NotImplementedError

    def stop_message(self) -> str:
        """The message after Ctrl-C: how to continue, if that is possible."""
        return "stopped"

    @classmethod
    def defaults(cls, words: Sequence[str]) -> Self | None:
        """Defaults that depend on the command line ``words``. None keeps the defaults of the fields."""
        return None

    @classmethod
    def more_help(cls) -> str:
        """Text of the help between the options and the examples."""
        return ""


@dataclass(frozen=True, kw_only=True)
class ImportingCommand(Command):
    """A command that can import modules outside the package. They may register tasks, methods and others."""

    import_: Annotated[UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="import", metavar="MODULE")] = ()
    """module of yours that registers tasks, methods or others, found as python -m finds it (repeatable)"""


@dataclass(frozen=True, kw_only=True)
class MeasuringCommand(ImportingCommand):
    """A command whose result is rows of a file of results."""

    file: Annotated[bool, FILE_OR_OUT] = False
    """file the rows in data/results (without it they go to runs/results)"""
    out: Annotated[Path | None, FILE_OR_OUT] = None
    """write the rows to this file instead"""


def parse(command: type[Command], name: str, words: Sequence[str]) -> Command:
    """Make a command from its command line, and import the modules of ``--import``.

    Raises:
        ValueError: ``words`` has an error; the message is one sentence.
        SystemExit: with code 0, after the help was printed.
    """
    prog = f"gem-lite {name}"
    with tyro_errors.on_parse_error(errors.refuse):
        if issubclass(command, ImportingCommand):
            import_modules(words)
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
    """The lines at the end of a command's help."""
    title = "example:" if len(command.examples) == 1 else "examples:"
    return [title, *(f"  {example}" for example in command.examples)]


def parse_known(fields: type, words: Sequence[str]) -> object:
    """Fill the dataclass ``fields`` from a command line. Other options in it are ignored."""
    known, _ = tyro.cli(fields, args=words, return_unknown_args=True, add_help=False, config=MARKERS)
    return known


def import_modules(words: Sequence[str]) -> None:
    """Import the modules that ``--import`` names in ``words``.

    Raises:
        ValueError: a module does not exist.
    """
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # As python -m does. The script gem-lite has the script's folder there.
    for module in parse_known(ImportingCommand, words).import_:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            raise ValueError(f"--import {module}: {error}") from error
