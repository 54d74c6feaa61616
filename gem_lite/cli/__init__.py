"""The command ``gem-lite``: its subcommands by name."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

try:
    from gem_lite.cli import errors
    from gem_lite.cli.command import Command, parse
except ModuleNotFoundError as missing:  # The core group alone is installed: it has no commands.
    sys.exit(f"gem-lite needs {missing.name}, which the group table brings: pip install 'gem_lite[table]'")

# Only the module of the subcommand that runs is imported: torch and pybullet take seconds to load, and the help of a
# command should not wait for packages that the command does not use.
COMMANDS = {
    "demo": ("demo", "Demo", "run the quickstart: a sentence in, a placed block out"),
    "collect": ("collect", "Collect", "let the expert play episodes of a task, and save them"),
    "verify": ("verify", "Verify", "load saved demonstrations and check the SHA-256 of every file"),
    "train": ("train", "Train", "train a method from demonstrations"),
    "evaluate": ("evaluate", "Evaluate", "measure a policy over episodes"),
    "several-tables": ("several_tables", "SeveralTables", "measure a policy over several tables"),
    "check-cameras": ("own_table", "CheckCameras", "say what is wrong with the cameras of your own table"),
    "look": ("own_table", "Look", "show what a policy sees on your own table"),
    "clip pretrain": ("clip", "Pretrain", "train the embedded CLIP from scratch"),
    "clip card": ("clip", "Card", "measure an embedded CLIP and write its card"),
    "clip calibrate": ("clip", "Calibrate", "measure the scale of a CLIP's scores, once for each CLIP"),
    "results list": ("results", "List", "the files of results, and what they hold"),
    "results show": ("results", "Show", "the rows of a file of results"),
    "results gallery": ("pages", "Gallery", "draw the first and the last picture of every task of the benchmark"),
    "results tables": ("pages", "Tables", "draw the benchmark's tables from the stored rows"),
    "results page": ("pages", "Page", "write the tables of docs/results.md from the stored rows"),
    "results settings": ("pages", "Settings", "print what the search and the experts' rows decide for the others"),
}
"""For each subcommand: its module in this package, its class in that module, and its description."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line.

    Args:
        argv: the arguments without the program's name; by default those of `sys.argv`.

    Returns:
        The exit code: 0; 2 after an error, which one sentence on stderr explains; 130 after Ctrl-C.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    command: Command | None = None
    try:
        name, rest = split(words)
        if name not in COMMANDS:
            print(overview(name))
            return 0
        command = read(name, rest)
        command.run()
    except SystemExit as end:  # After --help, tyro ends with code 0.
        return end.code or 0
    except KeyboardInterrupt:
        print(f"\n{command.stop_message() if command else 'stopped'}", file=sys.stderr)
        return 130
    except (command or Command).failures as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return 2
    return 0


def split(words: Sequence[str]) -> tuple[str, list[str]]:
    """The name of the subcommand, which has one or two words, and the words after it.

    If the overview of a group of subcommands is to be printed, the name is that of the group; "" stands for all.

    Raises:
        ValueError: the subcommand is unknown; the message has the nearest name.
    """
    groups = {name.split()[0] for name in COMMANDS} - set(COMMANDS)
    if not words or words[0] in ("-h", "--help"):
        return "", []
    first = words[0]
    if first in COMMANDS:
        return first, list(words[1:])
    if first in groups and (len(words) == 1 or words[1] in ("-h", "--help")):
        return first, []
    name = f"{first} {words[1]}" if first in groups else first
    if name in COMMANDS:
        return name, list(words[2:])
    raise ValueError(f"gem-lite has no command {name!r}; {errors.nearest(name, list(COMMANDS), 'gem-lite')}")


def read(name: str, words: Sequence[str]) -> Command:
    """The subcommand ``name`` with its arguments.

    Raises:
        ValueError: ``words`` has an error; the message is one sentence.
        SystemExit: with code 0, after the help was printed.
    """
    module, kind, _ = COMMANDS[name]
    return parse(getattr(importlib.import_module(f"gem_lite.cli.{module}"), kind), name, words)


def overview(group: str = "") -> str:
    """The help of ``gem-lite`` or of a group of its subcommands."""
    prog = f"gem-lite {group}".strip()
    lines = [f"  {name:18s}{about}" for name, (_, _, about) in COMMANDS.items() if name.startswith(group)]
    example = next(name for name in COMMANDS if name.startswith(group))
    return "\n".join([
        f"usage: {prog} COMMAND ...", "", *lines, "", "gem-lite COMMAND --help explains a command.",
        "example:", f"  gem-lite {example} --help",
    ])  # fmt: skip
