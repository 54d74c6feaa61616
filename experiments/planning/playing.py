"""One scene, played: who says the sentences, and what lies in the box at the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from experiments.planning.scenes import COUNT, MEMBERS, Sorting
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.maps.sources import MapSource
from gem_lite.planning import goals
from gem_lite.planning.naming import NamedThing, named_things
from gem_lite.planning.planner import Belongs, Namer, Planner
from gem_lite.policies.gem import Gem
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.environment import body_at
from gem_lite.simulation.world import World

INSIDE = 0.5
"""A thing is packed if more than this share of its volume is in the box."""
Say = Callable[[Observation], str | None]
"""The next sentence, or None at the end."""
Sayer = Callable[[World, Sorting], Say]
"""Makes who says the sentences of a scene."""


@dataclass(frozen=True)
class Outcome:
    """What a scene ended with. ``acts`` has the name of what was picked, "" for nothing, after each sentence."""

    right: int
    wrong: int
    seconds: float
    acts: tuple[tuple[str, str], ...]


def play(world: World, task: Sorting, seed: int, policy: Gem, sayer: Sayer) -> Outcome:
    """Play a scene until nobody says a sentence.

    Args:
        sayer: makes who says the sentences, when the scene lies there.
    """
    (observation,) = world.reset(task, seed)
    start = time.perf_counter()
    next_sentence = sayer(world, task)
    empty_picks: list[Pose2] = []
    acts = []
    while (sentence := next_sentence(observation)) is not None:
        action = policy.act(observation, sentence, empty_picks)
        result = world.step(action)
        empty_picks = [] if result.grasped else [*empty_picks, action.pick]
        acts.append((sentence, task.plain_names.get(result.held, "")))
        (observation,) = result.observations
    seconds = time.perf_counter() - start
    right, wrong = (
        sum(task.metric.share(world, body, task.box) > INSIDE for body in bodies) for bodies in (task.right, task.wrong)
    )
    return Outcome(right, wrong, round(seconds, 1), tuple(acts))


def truly_belong(names: Sequence[str], kind: str) -> list[bool]:
    """The belonging of `MEMBERS`."""
    return [name in MEMBERS[kind] for name in names]


def true_namer(world: World, task: Sorting) -> Namer:
    """Gives things their true names, which only the simulator knows."""

    def namer(scene: SceneEmbedding, names: Sequence[str], source: MapSource) -> list[NamedThing]:
        seen = named_things(scene, names, source)
        true = [task.plain_names.get(body_at(world, Pose2(thing.x, thing.y)), thing.name) for thing in seen]
        return [
            NamedThing(name, thing.x, thing.y, thing.score, thing.mask) for name, thing in zip(true, seen, strict=True)
        ]

    return namer


def planning(policy: Gem, belongs: Belongs, true_names: bool = False) -> Sayer:
    """A planner says the sentences."""

    def sayer(world: World, task: Sorting) -> Say:
        namer = true_namer(world, task) if true_names else named_things
        return Planner(goals.read(task.instruction), belongs, objects.NAMES, policy.source, namer=namer).next

    return sayer


def repeating(world: World, task: Sorting) -> Say:
    """The vague instruction itself, once for each thing that belongs."""
    sentences = iter([task.instruction] * COUNT)
    return lambda observation: next(sentences, None)
