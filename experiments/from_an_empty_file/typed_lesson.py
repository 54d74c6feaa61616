"""The program that the lesson "GEM from an empty file" types: trained, or with the library's weights; test episodes."""

from __future__ import annotations

import time
import types
from pathlib import Path

import nbformat
import safetensors.torch
import torch
from torch import nn

from gem_lite import demonstrations, tasks
from gem_lite.foundations.files import DATA
from gem_lite.policies.checkpoints import read_card
from gem_lite.simulation.world import World

LESSON = Path(__file__).resolve().parents[2] / "notebooks" / "gem_from_an_empty_file.ipynb"
TAG = "mechanism"
TASK = "put-block-in-bowl-seen-colors"


def program() -> str:
    """The cells of the lesson with the tag `TAG`, joined: a program without checks and figures."""
    cells = nbformat.read(LESSON, as_version=4).cells
    return "\n\n\n".join(cell.source for cell in cells if TAG in cell.metadata.get("tags", [])) + "\n"


def load() -> types.ModuleType:
    """The `program`, executed as a module."""
    typed = types.ModuleType(LESSON.stem)
    exec(compile(program(), f"{LESSON.stem}.py", "exec", dont_inherit=True), typed.__dict__)
    return typed


def trained(typed: types.ModuleType, steps: int, seed: int, demos: int) -> tuple[nn.Module, object]:
    """The lesson's GEM after a training, and the crops of its demonstrations."""
    start = time.perf_counter()
    shown = list(demonstrations.load(DATA / "demos" / f"{TASK}-10"))[:demos]
    memory = typed.CropMemory.of(shown)
    torch.manual_seed(seed)
    gem = typed.Gem()
    losses = typed.train(gem, typed.prepare(shown, memory), steps, seed)
    print(f"{steps} steps, seed {seed}, {len(shown)} demonstrations: {time.perf_counter() - start:.0f} s")
    print(f"losses of the last step: pick {losses[-1, 0]:.2f}, place {losses[-1, 1]:.2f}")
    return gem, memory


def shipped(typed: types.ModuleType, checkpoint: Path) -> tuple[nn.Module, object]:
    """The lesson's GEM with the library's weights, and the crops that lie beside them.

    Raises:
        ValueError: a weight is missing, or there is one more.
    """
    tensors = safetensors.torch.load_file(checkpoint)
    crops = list(tensors.pop("memory.images").numpy())
    labels = read_card(checkpoint)["memory"]
    gem = typed.Gem()
    if tensors.keys() != dict(gem.named_parameters()).keys():
        raise ValueError(f"checkpoint must have the weights of the lesson's GEM and no others, got {checkpoint}")
    gem.load_state_dict(tensors, strict=False)  # e2cnn's buffers are in no file
    return gem, typed.CropMemory([one["phrase"] for one in labels], crops, [one["episode"] for one in labels])


def played(typed: types.ModuleType, gem: nn.Module, memory: object, episodes: int) -> list[float]:
    """The scores (0 to 1) of the first test episodes."""
    task = tasks.make(TASK, "test")
    with World() as world:
        return [typed.play(gem, world, task, number, memory) for number in range(episodes)]
