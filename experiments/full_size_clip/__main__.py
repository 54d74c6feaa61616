"""What a CLIP of OpenAI's size costs on a CPU: python -m experiments.full_size_clip FOLDER.

The folder gets a ViT-B/32 with random weights and the real tokenizer. `gem-lite` then calibrates it, trains with it,
looks with it and plays an episode, each as a program of its own.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import NamedTuple

import torch
from transformers import CLIPConfig, CLIPModel, CLIPTokenizer
from transformers.convert_slow_tokenizer import bytes_to_unicode
from transformers.image_utils import OPENAI_CLIP_MEAN, OPENAI_CLIP_STD

from gem_lite.foundations.files import DATA

MERGES = 49_152 - 256 - 2
"""The number of merges in a vocabulary of 49,408 tokens. The file has more."""
DEMOS = DATA / "demos" / "put-block-in-bowl-seen-colors-10"


class Cost(NamedTuple):
    """What a program has used: seconds, seconds of processor, and the most memory (MiB)."""

    seconds: float
    processor: float
    memory: float


def tokenizer() -> CLIPTokenizer:
    """OpenAI's tokenizer, of the vocabulary that the package open-clip-torch ships."""
    path = distribution("open-clip-torch").locate_file("open_clip/bpe_simple_vocab_16e6.txt.gz")
    lines = gzip.decompress(Path(str(path)).read_bytes()).decode().split("\n")
    merges = lines[1 : 1 + MERGES]
    letters = list(bytes_to_unicode().values())
    words = letters + [letter + "</w>" for letter in letters] + [merge.replace(" ", "") for merge in merges]
    tokens = [*words, "<|startoftext|>", "<|endoftext|>"]
    numbers = {token: number for number, token in enumerate(tokens)}
    pairs = [tuple(merge.split()) for merge in merges]
    return CLIPTokenizer(vocab=numbers, merges=pairs, model_max_length=77)


def make_folder(folder: Path) -> None:
    """Save a ViT-B/32 with random weights (605 MB), its tokenizer and its preprocessing."""
    torch.manual_seed(0)
    CLIPModel(CLIPConfig()).save_pretrained(folder)  # the configuration's defaults are those of ViT-B/32
    tokenizer().save_pretrained(folder)
    preprocessing = {"size": 224, "image_mean": OPENAI_CLIP_MEAN, "image_std": OPENAI_CLIP_STD}
    (folder / "preprocessor_config.json").write_text(json.dumps(preprocessing))


def gem_lite(cache: Path, *words: str) -> Cost:
    """Run a command. The model's numbers go into ``cache``.

    Raises:
        RuntimeError: it failed; its own message stands above.
    """
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "gem_lite.cli", *words], env=os.environ | {"XDG_CACHE_HOME": str(cache)}
    )
    _, status, used = os.wait4(process.pid, 0)
    # 1: `look` refuses, as a CLIP with random weights may.
    if os.waitstatus_to_exitcode(status) not in ((0, 1) if words[0] == "look" else (0,)):
        raise RuntimeError(f"gem-lite {' '.join(words)} failed")
    return Cost(time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def commands(folder: Path, out: Path) -> dict[str, Sequence[str]]:
    """What is run, in this order."""
    clip, checkpoint = ("--clip", str(folder)), str(out / "gem.safetensors")
    training = ("--config.semantic-map", "dense", "--config.steps", "10", "--state", str(out / "state"))
    task, scene = "put-block-in-bowl-seen-colors", DATA / "foreign-scenes" / "workbench"
    return {
        "calibrate": ("clip", "calibrate", str(folder), "--scenes", "1"),
        "train": ("train", str(DEMOS), checkpoint, "--episodes", "2", *training, *clip),
        "look": ("look", str(scene), "red block", "--policy", checkpoint, "--out", str(out / "look"), *clip),
        "play": ("evaluate", "gem", task, "--checkpoint", checkpoint, "--episodes", "1", "--processes", "1",
                 "--out", str(out / "rows.jsonl"), *clip),
    }  # fmt: skip


def main() -> None:
    """Run everything, and print what each part has used."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="new folder for the model and what is made with it")
    folder = parser.parse_args().folder
    model = folder / "clip"
    model.mkdir(parents=True)
    make_folder(model)
    costs = {name: gem_lite(folder / "cache", *words) for name, words in commands(model, folder).items()}
    for name, cost in costs.items():
        print(f"{name}: {cost.seconds:.0f} s, {cost.processor:.0f} s of processor, {cost.memory:.0f} MiB")


if __name__ == "__main__":
    main()
