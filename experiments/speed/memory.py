"""How much memory a training takes, by the number of demonstrations: python -m experiments.speed.memory

Demonstrations of stack-block-pyramid-seq are collected into a folder, unless they are there; a collection that was
stopped goes on. For each number of them a process of its own prepares all steps and trains for a few, and the most
memory that it had at once is printed: resident, of the process and of those that it started.
"""

import argparse
import dataclasses
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from gem_lite import clip, demonstrations
from gem_lite.evaluation import collecting
from gem_lite.policies import methods
from gem_lite.training import train

TASK = "stack-block-pyramid-seq-seen-colors"
COUNTS = (10, 50, 100)
TRAINED = 20
"""Training steps: each takes as much memory as the one before."""
GIGABYTE = 1e9


def measure(folder: Path, count: int, name: str) -> dict:
    """Prepare ``count`` demonstrations and train; how many steps they have, and the most memory (GB) so far."""
    demos = demonstrations.load(folder)[:count]
    method, settings = methods.find(name)
    policy = method(dataclasses.replace(settings, steps=TRAINED), clip.load())
    with tempfile.TemporaryDirectory() as run:
        steps = train.prepared_steps(policy, demos, Path(run))
        prepared = peak()
        train.train(policy, steps, 0, Path(run))
        stored = sum(path.stat().st_size for path in steps.folder.iterdir())
    return {"steps": len(steps), "prepared": prepared, "trained": peak(), "disk": stored / GIGABYTE}


def peak() -> float:
    """The most memory (GB) that this process and the largest of those it started had at once."""
    kibibytes = sum(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return kibibytes * 1024 / GIGABYTE


def main() -> None:
    """Print a line for each number of demonstrations."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("runs/demos/pyramid-100"), help="the set")
    parser.add_argument("--method", default="gem", help="default gem")
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="default 10 50 100")
    parser.add_argument("--alone", action="store_true", help="measure the first count in this process; print JSON")
    args = parser.parse_args()
    if args.alone:
        print(json.dumps(measure(args.folder, args.counts[0], args.method)))
        return
    if not (args.folder / "manifest.json").exists() or len(demonstrations.load(args.folder)) < max(args.counts):
        collecting.collect(TASK, max(args.counts), args.folder)
    print(
        f"{args.method}, {TRAINED} training steps\n  demos   steps   GB after preparing  GB after training  GB on disk"
    )
    for count in args.counts:
        command = [sys.executable, __file__, str(args.folder), "--method", args.method, "--counts", str(count)]
        said = subprocess.run([*command, "--alone"], check=True, stdout=subprocess.PIPE, text=True).stdout
        found = json.loads(said.splitlines()[-1])
        memory = f"{found['prepared']:21.2f}{found['trained']:19.2f}{found['disk']:12.2f}"
        print(f"  {count:5d}{found['steps']:8d}{memory}", flush=True)


if __name__ == "__main__":
    main()
