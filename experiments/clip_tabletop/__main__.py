"""``python -m experiments.clip_tabletop pretrain | card``: make the embedded CLIP, and measure it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.clip_tabletop import card, pretrain
from gem_lite import clip


def main() -> int:
    """Read the command line and do what it says. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m experiments.clip_tabletop", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("pretrain", help="train a CLIP on captions and crops that this project renders itself")
    making.add_argument("--scenes", type=int, default=3200, help="training scenes to render (%(default)s)")
    making.add_argument("--epochs", type=int, default=7, help="passes over the crops (%(default)s)")
    making.add_argument("--seed", type=int, default=0, help="of scenes, captions and weights (%(default)s)")
    making.add_argument("--out", type=Path, default=Path("runs/clip-tabletop"), help="folder to write (%(default)s)")
    making.add_argument("--state", type=Path, default=Path("runs/pretrain_clip"), help="crops and state (%(default)s)")
    measuring = commands.add_parser("card", help="measure a CLIP on fresh scenes and write its card (some minutes)")
    measuring.add_argument("folder", type=Path, help="the CLIP, as `pretrain` writes it")
    measuring.add_argument("--training-crops", type=int, required=True, help="number of crops of its training")
    given = parser.parse_args()
    try:
        if given.command == "card":
            print(card.write(given.folder, clip.load(given.folder), given.training_crops))
        else:
            print(pretrain.pretrain(given.out, given.state, given.scenes, given.epochs, given.seed))
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; a training goes on from its last epoch with the same command", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
