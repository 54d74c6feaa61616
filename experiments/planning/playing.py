"""One scene, played: who says the sentences, and what lies in the box at the end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from experiments.planning.scenes import COUNT, MEMBERS, Sorting
from gem_lite.language import Queries
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
Say = Callable[[Observation], str | Queries | None]
"""The next sentence or move, or None at the end."""
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
    acts = tuple(
        (str(said), task.plain_names.get(held, ""))
        for said, held in act_out(world, observation, sayer(world, task), policy)
    )
    seconds = time.perf_counter() - start
    right, wrong = (
        sum(task.metric.share(world, body, task.box) > INSIDE for body in bodies) for bodies in (task.right, task.wrong)
    )
    return Outcome(right, wrong, round(seconds, 1), acts)


def act_out(
    world: World, observation: Observation, say: Say, policy: Gem
) -> Iterator[tuple[str | Queries, int | None]]:  # fmt: skip
    """Act until nobody says anything more. Yields what was said, and the id of the body that was held then."""
    empty_picks: list[Pose2] = []
    while (said := say(observation)) is not None:
        action = policy.act(observation, said, empty_picks)
        result = world.step(action)
        empty_picks = [] if result.grasped else [*empty_picks, action.pick]
        yield said, result.held
        (observation,) = result.observations


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
