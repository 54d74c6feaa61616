"""Play the pointing game with every kind of semantic map: python -m experiments.pointing --help."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pointing import KINDS

from experiments.pointing.measure import PACKING, measure_packing, measure_scenes
from gem_lite import tasks
from gem_lite.cli.results import described_pointing
from gem_lite.evaluation import results


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser("experiments.pointing", description=__doc__.partition(":")[0])
    parser.add_argument("--scenes", type=int, default=200, help="scenes of a kind, or episodes (%(default)s)")
    parser.add_argument("--kind", choices=KINDS, help="kind of the scenes (without it: both)")
    parser.add_argument("--task", choices=PACKING, help="its test episodes, with the text-conditioned map alone")
    parser.add_argument("--clip", help="Hugging Face name or folder of a CLIP (without it: the embedded one)")
    parser.add_argument("--out", type=Path, help="file of rows (without it: in runs/results)")
    arguments = parser.parse_args()
    if arguments.scenes < 1:
        parser.error(f"--scenes must be at least 1, got {arguments.scenes}")
    try:
        if arguments.task:
            path = arguments.out or results.RUNS / f"{tasks.family(arguments.task)}.jsonl"
            row = measure_packing(arguments.task, arguments.scenes, path, arguments.clip)
            print("the map points at the named piece of {task}: {mean} {ci95}, {episodes} episodes".format(**row))
        else:
            path = arguments.out or results.RUNS / "pointing.jsonl"
            for kind in [arguments.kind] if arguments.kind else KINDS:
                for row in measure_scenes(kind, arguments.scenes, path, arguments.clip):
                    print(described_pointing(row))
        print(f"the rows are in {path}")
    except (OSError, ValueError) as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()
