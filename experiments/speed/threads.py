"""One process that embeds scenes and acts, and two at once, for several ways to wait.

    python -m experiments.speed.threads              # about four minutes
    python -m experiments.speed.threads --rounds 20  # for a machine that has other work, too

Between two parallel pieces of work, OpenMP's threads first spin, then sleep. What spins takes a core from other
processes. OpenMP reads its setting once, when torch is loaded, so each setting has processes of its own. Each
embeds a scene with the embedded CLIP, then acts once by a shipped policy, again and again. Two processes
at once have half of the cores each: twice as long as alone would be a fair share. The processor's seconds count
what all threads burn, spinning too; other work on the machine changes them less than it changes the clock.
"""

import argparse
import os
import subprocess
import sys
import time

import numpy as np

SPIN = "GOMP_SPINCOUNT"
DEFAULT = "OpenMP's default"
SETTINGS = {
    "as gem_lite sets it": {},
    DEFAULT: {SPIN: "300000"},  # what GNU's OpenMP takes where nothing is said
    "passive": {"OMP_WAIT_POLICY": "passive", SPIN: "0"},
    **{f"{count} spins": {SPIN: str(count)} for count in (1_000, 10_000)},
    "one thread": {"OMP_NUM_THREADS": "1"},
}
SECONDS = 2.0
"""How long one measurement lasts."""


def work() -> None:
    """The child: for each line that comes, work; print how long one scene and act took, by clock and by processor."""
    from gem_lite import clip, tasks
    from gem_lite.maps import semantic_map
    from gem_lite.policies.checkpoints import load_policy
    from gem_lite.simulation.world import World

    policy = load_policy(clip.DATA / "gem-put-block-in-bowl.safetensors", clip.load())
    task = tasks.make("put-block-in-bowl-seen-colors", "val")
    with World() as world:
        (observation,) = world.reset(task, tasks.episode_seed("val", 0))

    def scene_and_act() -> None:
        semantic_map.embed_scene(observation.views, policy.clip, policy.config)
        policy.act(observation, task.instruction)

    scene_and_act()
    print("ready", flush=True)
    for _ in sys.stdin:
        start = time.perf_counter()
        processor = time.process_time()
        times = 0
        while time.perf_counter() - start < SECONDS:
            scene_and_act()
            times += 1
        print((time.perf_counter() - start) / times, (time.process_time() - processor) / times, flush=True)


def start(setting: dict[str, str]) -> subprocess.Popen:
    """A child with its environment; returns when it is ready."""
    child = subprocess.Popen(
        [sys.executable, __file__, "--work"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | setting,
    )  # fmt: skip
    if child.stdout.readline() != "ready\n":
        raise RuntimeError(f"a child with {setting} ended with {child.wait()} before it could work")
    return child


def measure(*children: subprocess.Popen) -> np.ndarray:
    """(2,): seconds by the clock and by the processor that a scene and act take when these children work at the
    same time, the slowest child's."""
    for child in children:
        child.stdin.write("work\n")
        child.stdin.flush()
    return np.max([[float(word) for word in child.stdout.readline().split()] for child in children], axis=0)


def main() -> None:
    """Print a line for each setting."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="measurements of each setting, in turn (default 5)")
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.work:
        work()
        return
    print(f"{os.cpu_count()} cores; seconds that one scene and act take, fastest of {args.rounds} rounds", flush=True)
    children = {name: (start(setting), start(setting)) for name, setting in SETTINGS.items()}
    alone = {name: np.full(2, np.inf) for name in SETTINGS}
    both = {name: np.full(2, np.inf) for name in SETTINGS}
    for _ in range(args.rounds):
        for name, (first, second) in children.items():
            alone[name] = np.minimum(alone[name], measure(first))
            both[name] = np.minimum(both[name], measure(first, second))
    for several in children.values():
        for child in several:
            child.communicate()
    print("                        by the clock                                     by the processor")
    print("  setting               alone  two at once  two / alone  alone / default's   alone  two at once")
    for name in SETTINGS:
        (clock, processor), (clock_of_two, processor_of_two) = alone[name], both[name]
        print(
            f"  {name:20s}{clock:7.2f}{clock_of_two:13.2f}{clock_of_two / clock:13.1f}"
            f"{clock / alone[DEFAULT][0]:19.2f}{processor:8.2f}{processor_of_two:13.2f}"
        )
    print(f"load of the machine over the last minute: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
