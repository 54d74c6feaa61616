"""One process that embeds scenes and acts, and two at once, for several ways to wait: tests/benchmarks/threads.py

    python tests/benchmarks/threads.py              # about four minutes
    python tests/benchmarks/threads.py --rounds 20  # for a machine that has other work, too

Between two parallel pieces of work, OpenMP's threads first spin, then sleep. What spins takes a core from other
processes. OpenMP reads its setting once, when torch is loaded, so each setting has processes of its own. Each
embeds a scene with the embedded CLIP, then acts once by a shipped policy, again and again. Two processes
at once have half of the cores each: twice as long as alone would be a fair share.
"""

import argparse
import os
import subprocess
import sys
import time

SPIN = "GOMP_SPINCOUNT"
DEFAULT = "OpenMP's default"
SETTINGS = {
    "as gem_lite sets it": {},
    DEFAULT: {SPIN: "300000"},  # what GNU's OpenMP takes where nothing is said
    "passive": {"OMP_WAIT_POLICY": "passive", SPIN: "0"},
    **{f"{count} spins": {SPIN: str(count)} for count in (1_000, 3_000, 10_000, 30_000)},
    "one thread": {"OMP_NUM_THREADS": "1"},
}
SECONDS = 2.0
"""How long one measurement lasts."""


def work() -> None:
    """The child: for each line that comes, work for `SECONDS` and print how long one scene and act took."""
    from gem_lite import clip, semantic_map
    from gem_lite.tabletop import tasks
    from gem_lite.tabletop.world import World
    from gem_lite.train import load_policy

    policy = load_policy(clip.DATA / "gem-put-block-in-bowl.safetensors", clip.load())
    task = tasks.make("put-block-in-bowl-seen-colors", "val")
    with World() as world:
        observation = world.reset(task, tasks.episode_seed("val", 0))

    def scene_and_act() -> None:
        semantic_map.embed_scene(observation.views, policy.clip, policy.config)
        policy.act(observation, task.instruction)

    scene_and_act()
    print("ready", flush=True)
    for _ in sys.stdin:
        start = time.perf_counter()
        times = 0
        while time.perf_counter() - start < SECONDS:
            scene_and_act()
            times += 1
        print((time.perf_counter() - start) / times, flush=True)


def start(setting: dict[str, str]) -> subprocess.Popen:
    """A child with its environment; returns when it is ready."""
    child = subprocess.Popen(
        [sys.executable, __file__, "--work"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | setting,
    )  # fmt: skip
    if child.stdout.readline() != "ready\n":
        raise RuntimeError(f"a child with {setting} ended with {child.wait()} before it could work")
    return child


def measure(*children: subprocess.Popen) -> float:
    """Seconds that a scene and an act take when these children work at the same time: the slowest child's."""
    for child in children:
        child.stdin.write("work\n")
        child.stdin.flush()
    return max(float(child.stdout.readline()) for child in children)


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
    alone = dict.fromkeys(SETTINGS, float("inf"))
    both = dict.fromkeys(SETTINGS, float("inf"))
    for _ in range(args.rounds):
        for name, (first, second) in children.items():
            alone[name] = min(alone[name], measure(first))
            both[name] = min(both[name], measure(first, second))
    for first, second in children.values():
        for child in (first, second):
            child.communicate()
    print("  setting               alone   two at once   two / alone   alone / the default's")
    for name in SETTINGS:
        ratios = both[name] / alone[name], alone[name] / alone[DEFAULT]
        print(f"  {name:20s}{alone[name]:7.2f}{both[name]:14.2f}{ratios[0]:14.1f}{ratios[1]:24.2f}")
    print(f"load of the machine over the last minute: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
