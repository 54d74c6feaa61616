"""The base of command lines: of ``gem-lite``, and of experiments, as in ``python -m experiments.benchmark page FILE``.

A command is a function. Its parameters are the arguments: those before ``/`` by position, those after ``*`` as
options. Its docstring is the help: the text, ``Args:``, and under ``Examples:`` command lines that work. A program is::

    if __name__ == "__main__":
        sys.exit(base.run(base.make_app("python -m experiments.benchmark", "Measure the benchmark.", page, tables)))

A command imports what it runs in its body: torch takes seconds to load, and the help needs none of it.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Group, Parameter, validators
from rich.console import Console

FAILURES = (CycloptsError, OSError, ValueError, FloatingPointError)
"""Errors whose message tells the user why a command failed. Any other error is a bug."""


def make_app(name: str, about: str | None, *commands: Callable[..., None] | App, **settings: object) -> App:
    """A program, or a group of commands in one.

    Args:
        name: as the user types it.
        about: the first line of its help.
        commands: functions, or programs as groups. The command ``several_tables`` is typed several-tables.
        settings: more arguments of `cyclopts.App`.
    """
    app = App(
        name=name, help=about, help_format="plaintext", version_flags=(), print_error=False, exit_on_error=False,
        suppress_keyboard_interrupt=False, result_action="return_value",
        default_parameter=Parameter(negative=(), consume_multiple=True),
        console=Console(soft_wrap=True),  # An example stays one line, to be copied.
        **settings,
    )  # fmt: skip
    for flag in app.help_flags:
        app[flag].show = False
    for command in commands:
        if isinstance(command, App):
            app.command(command)
        else:
            app.command(command, help_epilogue=examples(command))
    return app


def examples(command: Callable[..., None]) -> str:
    """The examples in a command's docstring, with their title, as the end of its help."""
    _, title, lines = (inspect.getdoc(command) or "").partition("Examples:\n")
    return f"{title}{lines}"


class Refused(Exception):  # noqa: N818 (no error: the command has said why)
    """The answer of a command is a refusal, and it is printed."""


def run(app: App, words: Sequence[str] | None = None) -> int:
    """Run a command line.

    Args:
        words: the arguments without the program's name; by default those of `sys.argv`.

    Returns:
        The exit code: 0; 1 if the answer is a refusal; 2 after an error, which one line on stderr explains; 130 after
        Ctrl-C.
    """
    try:
        app(words)
    except Refused:
        return 1
    except KeyboardInterrupt as stop:
        print(f"\nstopped{stop}", file=sys.stderr)
        return 130
    except FAILURES as error:
        if isinstance(error, CycloptsError):
            error.verbose = False  # The user need not read our code.
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    return 0


@contextlib.contextmanager
def continues(place: str) -> Iterator[None]:
    """In this context, Ctrl-C also says that the same command goes on, and from where."""
    try:
        yield
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt(f"; the same command goes on from {place}") from stop


# Options that several commands have.


def import_modules(_: object, names: tuple[str, ...]) -> None:
    """Import modules of the user. Raises ValueError if one does not exist."""
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # As python -m does. The script gem-lite has the script's folder there.
    for name in names:
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as error:
            raise ValueError(str(error)) from error


Import = Annotated[
    tuple[str, ...],
    Parameter(
        consume_multiple=False,
        validator=import_modules,
        help="module of yours that registers tasks, methods or others, found as python -m finds it (repeatable)",
    ),
]
"""Modules that are imported while the command line is read: the command itself has nothing to do with them."""
_ROWS = Group("Rows", validator=validators.mutually_exclusive)
File = Annotated[
    bool, Parameter(group=_ROWS, help="file the rows in data/results (without it they go to runs/results)")
]
Out = Annotated[Path | None, Parameter(group=_ROWS, help="write the rows to this file instead")]
Clip = Annotated[str | None, Parameter(help="Hugging Face name or folder of a CLIP (without it: the embedded one)")]
Split = Annotated[Literal["train", "val", "test"], Parameter(help="split of the episodes")]
World = Annotated[str, Parameter(help="looks of the world: gem-lite names lists them")]
Processes = Annotated[int | None, Parameter(help="number of episodes that run at once (without it: one per core)")]
