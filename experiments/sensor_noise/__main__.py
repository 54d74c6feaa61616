"""How often a policy succeeds when its cameras err: python -m experiments.sensor_noise --help."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import torch
from sensor_errors import KINDS

from experiments.sensor_noise.curves import measure
from gem_lite import clip
from gem_lite.evaluation import results

ALL = ("none", "all", *KINDS)


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser("experiments.sensor_noise", description=__doc__.partition(":")[0])
    shipped, rows = clip.DATA / "gem-put-block-in-bowl.safetensors", results.RUNS / "sensor-errors.jsonl"
    parser.add_argument("--checkpoint", type=Path, default=shipped, help="policy to measure (%(default)s)")
    parser.add_argument("--task", default="put-block-in-bowl-seen-colors", help="name of the task (%(default)s)")
    parser.add_argument("--split", default="test", choices=("train", "val", "test"), help="of the episodes (test)")
    parser.add_argument("--world", default="home", help="looks of the world (%(default)s)")
    parser.add_argument("--episodes", type=int, default=30, help="episodes of a cell, from 0 on (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the errors (%(default)s)")
    parser.add_argument("--out", type=Path, default=rows, help="file of rows (%(default)s)")
    parser.add_argument("--kinds", nargs="+", metavar="KIND", choices=ALL, default=ALL, help=f"of {', '.join(ALL)}")
    arguments = vars(parser.parse_args())
    torch.set_num_threads(1)
    try:
        measure(**arguments)
    except (OSError, ValueError) as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()
