"""Error messages for bad command lines: one sentence with the given value and the allowed ones."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NoReturn

from tyro import _errors as tyro_errors  # Private, so pyproject.toml names the version; nothing public does this.

if TYPE_CHECKING:
    from tyro._arguments import ArgumentDefinition


def refuse(event: tyro_errors.ParseErrorEvent) -> NoReturn:
    """Raise the sentence for a parse error. tyro calls this function instead of printing its own message.

    Raises:
        ValueError: always; its message is the sentence.
    """
    raise ValueError(_sentence(event))


def _sentence(event: tyro_errors.ParseErrorEvent) -> str:
    match event:
        case tyro_errors.MissingArgs():
            names = [missing.arg.display_name() for missing in event.missing_arguments]
            return f"{event.prog} needs {', '.join(names)}: see {event.prog} --help"
        case tyro_errors.InvalidChoice():
            choices = ", ".join(sorted(choice for choice in event.choices if choice != "None"))  # tyro shuffles them
            return f"{event.argument.display_name()} must be one of {choices}, got {event.value!r}"
        case tyro_errors.BadValue():
            return f"{event.argument.display_name()} needs a value: {_kind(event.argument)}"
        case tyro_errors.MutexConflict():
            return f"{event.first_token} and {event.second_token} cannot be given together"
        case tyro_errors.UnrecognizedArgs():
            return f"{event.prog} takes no further {' '.join(event.tokens)!r}: see {event.prog} --help"
        case tyro_errors.InstantiationFailure(argument=None):
            return event.message
        case tyro_errors.InstantiationFailure():
            return f"{event.argument.display_name()} must be {_kind(event.argument)}: {event.message}"
        case _:
            return f"{event.prog} does not understand these arguments: see {event.prog} --help"


def _kind(argument: ArgumentDefinition) -> str:
    """The kind of value that an argument takes, such as INT."""
    return str(argument.lowered.metavar).removeprefix("{None}|")


def check_options(words: Sequence[str], command: object, prog: str) -> None:
    """Check that every option among ``words`` is a field of ``command``, a dataclass or an instance of one.

    This check comes before tyro, whose message for an unknown option can be wrong: it may report a missing value of a
    positional argument.

    Raises:
        ValueError: an option is unknown; the message has the nearest option.
    """
    known = ["--help", *options(command)]
    for word in words:
        name = word.partition("=")[0].replace("_", "-")
        if name.startswith("--") and name not in known:
            raise ValueError(f"{prog} has no option {name}; {nearest(name, known, prog)}")


def options(command: object, prefix: str = "--") -> Iterator[str]:
    """The names of all options. The names of nested options contain dots."""
    for field in dataclasses.fields(command):
        name = prefix + field.name.strip("_").replace("_", "-")
        value = getattr(command, field.name, field.default)
        if dataclasses.is_dataclass(value):
            yield from options(value, f"{name}.")
        elif not str(field.type).startswith("Positional"):
            yield name


def nearest(name: str, known: Sequence[str], prog: str) -> str:
    """The end of an error message: the known name nearest to ``name``, or a pointer to the help."""
    matches = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"the nearest: {matches[0]}" if matches else f"see {prog} --help"
