"""``gem-lite train``: train a method from demonstrations. Options can set every value of its configuration."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from cyclopts import Parameter

from gem_lite.cli.base import Clip, Import, continues, examples, make_app

if TYPE_CHECKING:
    from gem_lite.config import Config


def train(*words: Annotated[str, Parameter(allow_leading_hyphen=True)]) -> None:
    """Read the options that choose the configuration, then all of them. For a help, torch is loaded on demand alone."""

    def choose(*, method: str | None = None, preset: str = "lite", import_: Import = ()) -> tuple[str | None, str]:
        return method, preset

    chooser = make_app("gem-lite train", None, help_flags=())
    chooser.default(choose)
    _, chosen, *_ = chooser.parse_known_args(words)
    method, preset = choose(**chosen.arguments)
    if method or not {"-h", "--help"} & set(words):
        from gem_lite.policies import methods

        _, config = methods.find(method or "gem", preset)
        start.__annotations__["config"] = options(config) | None
    else:
        start.__annotations__["config"] = Annotated[None, Parameter(show=False)]
    app = make_app("gem-lite train", None, help_epilogue=examples(start))
    app.default(start)
    app(words)


APP = make_app("train", "Train a method from demonstrations.", help_flags=())
APP.default(train)


def options(config: Config) -> type:
    """A dataclass of a configuration's entries, whose defaults are the configuration's values."""
    hints = get_type_hints(type(config))
    # As a choice, a switch has a value on the command line: its default may be True.
    kinds = {name: Literal[True, False] if kind is bool else kind for name, kind in hints.items()}
    fields = [(entry.name, kinds[entry.name], getattr(config, entry.name)) for entry in dataclasses.fields(config)]
    explained = "\n".join(filter(None, map(_attributes, type(config).__mro__)))
    own = {"__doc__": f"The configuration.\n\nAttributes:\n{explained}", "__module__": __name__}
    return dataclasses.make_dataclass("Options", fields, namespace=own)


def _attributes(kind: type) -> str:
    """What a class's docstring says of its attributes: a configuration's entries are explained where they are."""
    return inspect.cleandoc(kind.__dict__.get("__doc__") or "").partition("Attributes:\n")[2].partition("\n\n")[0]


def start(
    demonstrations: Path, checkpoint: Path, /, *, method: str = "gem", preset: str = "lite",
    episodes: int | None = None, seed: int = 0, clip: Clip = None, device: Literal["cpu", "cuda"] = "cpu",
    state: Path | None = None, prepared: Path | None = None, also: tuple[Path, ...] = (),
    begin_with: Path | None = None, import_: Import = (), config: Any = None,  # noqa: ANN401 (`train` sets its type)
) -> None:  # fmt: skip
    """Train a method from demonstrations.

    A stopped training continues. With several processes (`accelerate launch
    --num_processes 4 -m gem_lite.cli train ...`), each draws its own batch.

    --config.NAME VALUE sets a value of the method's configuration:
    `gem-lite train --method gem --help` lists them. The demonstrations set
    the table's length; --config.rectangle x_min x_max y_min y_max (m) is for
    a table of your own.

    Args:
        demonstrations: folder made by `gem-lite collect`, or with your own recorded episodes (docs/your_table.md)
        checkpoint: safetensors file to write
        method: name of the method: gem-lite names lists them
        preset: the base of the configuration: lite, for two CPU cores, or paper
        episodes: number of demonstrations to use, from the first (without it: all)
        seed: seed of the weights and of the batches
        device: device of the training
        state: folder for the state to resume from (without it: runs/<name of the checkpoint>-<hash of its path>)
        prepared: cache of prepared steps that trainings share; it may be deleted when none runs (without it: kept in
            --state)
        also: more folders, of other tasks or worlds: one policy for all of them (--method gem-multi)
        begin_with: checkpoint of the same method, whose weights the training begins with (without it: random ones)

    Examples:
      gem-lite train data/demos/put-block-in-bowl-seen-colors-10 runs/gem.safetensors
      gem-lite train data/demos/put-block-in-bowl-seen-colors-10 runs/short.safetensors --config.steps 300
      gem-lite train data/foreign-demos runs/mine.safetensors --config.rectangle 0.25 0.75 -0.5 0.5
    """
    from gem_lite.policies import methods
    from gem_lite.training import train

    kind, values = methods.find(method, preset)
    if config is not None:
        changed = type(values)(**vars(config))
        if changed.table != values.table:
            raise ValueError("--config.table must be left out: the task of the demonstrations sets it")
        values = changed
    state = state or state_folder(checkpoint)
    with continues(f"the last state in {state}"):
        card = train.train_from_folder(
            demonstrations, checkpoint, kind, values, state, seed, episodes, clip, device, also, prepared, begin_with
        )
    if card:
        training = "{train_seconds:.0f} s of training {method} on {demos} demonstrations".format(**card)
        print(f"wrote {checkpoint} after {training}")


def state_folder(checkpoint: Path) -> Path:
    """The folder for a training's state: another one for each path of a checkpoint."""
    # Relative to the working folder, as runs/ itself: both may move together. Two checkpoints may have one name.
    path = os.path.relpath(checkpoint.resolve(), Path.cwd())
    return Path("runs") / f"{checkpoint.stem}-{hashlib.sha256(path.encode()).hexdigest()[:8]}"
