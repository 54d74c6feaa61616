"""Whether today's code plays filed rows again, reward by reward: python -m experiments.speed.reproduce

For every shipped policy, the first episodes of each of its filed rows in a world are played again and compared with
the row, but for rows that were measured under earlier rules of acting. It prints a line a row, and ends with exit code
1 if a reward differs.
"""

import argparse
import itertools
import sys
from pathlib import Path

from gem_lite import clip
from gem_lite.evaluation import evaluate, results, table_poses
from gem_lite.evaluation.evaluate import Measurement
from gem_lite.policies.checkpoints import read_card


def shipped() -> dict[str, Path]:
    """The shipped checkpoints by their SHA-256."""
    return {read_card(path)["sha256"]: path for path in sorted(clip.DATA.glob("gem-*.safetensors"))}


def played_again(row: dict, checkpoint: Path, episodes: int) -> dict[str, float]:
    """Rewards by episode, as a row holds them."""
    conditions = [table_poses.Condition(row["poses"], row["shift"], row["turn"])] if "tables" in row else []
    measurement = Measurement(
        row["method"], row["task"], episodes, row["split"], row["start"], checkpoint, world=row["world"],
        tables=row.get("tables", 1), conditions=conditions, skip=row.get("skipped") or (),
    )  # fmt: skip
    return {str(episode.index): round(episode.reward, 4) for episode in evaluate.evaluate(measurement)}


def main() -> None:
    """Print a line for each row."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--episodes", type=int, default=10, help="of each row (default 10)")
    parser.add_argument("--world", default="home", help="default home")
    args = parser.parse_args()
    checkpoints = shipped()
    differing = 0
    others = (results.read_rows(results.RESULTS / f"{name}.jsonl") for name in ("shipped", "object-sorting"))
    for row in itertools.chain(results.stored_rows(), *others):
        checkpoint = checkpoints.get(row["checkpoint_sha256"])
        changed = row.get("shift", 0) or row.get("turn", 0) or row.get("subset", "all") != "all"
        if checkpoint is None or row["world"] != args.world or changed or results.is_outdated(row):
            continue
        again = played_again(row, checkpoint, args.episodes)
        wrong = [episode for episode, reward in again.items() if row["rewards"][episode] != reward]
        differing += len(wrong)
        verdict = f"differs in {', '.join(wrong)}" if wrong else "the same"
        print(f"{row['method']} on {row['task']}, {row.get('poses', 'one table')}: {verdict}", flush=True)
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
