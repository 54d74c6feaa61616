"""Where do acts go wrong? Policies are asked at every step of an expert's episode, here and in our simulator.

The expert acts, so that no step suffers from an error before it, and all policies are asked about the same scenes. The
true poses score their acts; they see the cameras' pictures and the sentence.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from tqdm import tqdm

from experiments.foreign_table import measuring
from experiments.foreign_tasks import families, playing
from experiments.foreign_tasks.table import TaskTable
from gem_lite import tasks
from gem_lite.actions import Push
from gem_lite.config import InputConfig
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies.base import Policy
from gem_lite.policies.gem import Gem, GemChoice
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_off
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.world import World
from gem_lite.tasks.goals import Goal, target_pose
from gem_lite.tasks.task import Split, Task

OUR_TASKS = {
    "assembling-kits": "assembling-kits-seq-seen-colors", "stack-block-pyramid": "stack-block-pyramid-seq-seen-colors",
    "towers-of-hanoi": "towers-of-hanoi-seq-seen-colors", "separating-piles": "separating-piles-seen-colors",
}  # fmt: skip
"""By family: the task of our simulator with the same goals."""
THING_REACH = 0.04
"""A pick at most this far (m) from a thing's middle is meant for it."""
REACH, SQUARE_REACH = 0.03, 0.07
"""A place, or a map's peak, at most this far (m) from a target is meant for it; the second is for the piles' squares,
whose outline is bright on the map."""
AT_BORDER = 0.03
"""What ends at most this far (m) from the table's border ends at the border."""


@dataclass(frozen=True)
class ActScore:
    """How far one act of a policy is right.

    Attributes:
        thing: the pick is near the middle of the named thing (`THING_REACH`). It may still hold another thing, or none.
        map_peak: the highest value of the place's semantic map is at the right target.
        target: the place is meant for the right target.
        exact: the thing would come to lie within the task's tolerances, if it moved as the tool does.
        border: the place, or the push, ends at the table's border.
    """

    thing: bool
    map_peak: bool
    target: bool
    exact: bool
    border: bool


def distance(first: Pose2, second: Pose2) -> float:
    """Between two poses, in metres."""
    return math.hypot(first.x - second.x, first.y - second.y)


def score(environment: Environment | TaskTable, goal: Goal, choice: GemChoice) -> ActScore:
    """Score a policy's choice for a goal that is not reached, by the true poses."""
    body, target = goal.next_move(environment)
    goal_pose = target_pose(environment, target)
    row, column = np.unravel_index(int(choice.place_map.argmax()), choice.place_map.shape)
    workspace = choice.heightmap.workspace
    peak = distance(Pose2(*workspace.to_world(row, column)), goal_pose)
    end = choice.action.end if isinstance(choice.action, Push) else choice.action.place
    sides = (end.x - workspace.x_min, workspace.x_max - end.x, end.y - workspace.y_min, workspace.y_max - end.y)
    border = min(sides) <= AT_BORDER
    if isinstance(choice.action, Push):
        nearest = min(distance(choice.action.start, environment.pose(cube)[0]) for cube in goal.bodies)
        in_square = distance(end, goal_pose) < SQUARE_REACH
        return ActScore(nearest < THING_REACH, peak < SQUARE_REACH, in_square, in_square, border)
    body_pose = environment.pose(body)[0]
    moved = choice.action.place @ choice.action.pick.inverse() @ body_pose
    offset = goal_pose.inverse() @ moved
    thing = distance(choice.action.pick, body_pose) < THING_REACH
    near = math.hypot(offset.x, offset.y)
    turned = angle_off(offset.yaw, goal.metric.symmetry)
    exact = thing and near < families.TOLERANCE and turned < families.YAW_TOLERANCE
    return ActScore(thing, peak < REACH, near < REACH, exact, border)


def ask(
    policies: Sequence[Policy], observation: Observation, task: Task, environment: Environment | TaskTable
) -> list[ActScore]:  # fmt: skip
    """The score of what each policy would do now. Policies that look in the same way share what CLIP computes."""
    goal = next(goal for goal in task.goals if goal.sentence == task.instruction)
    scenes: dict[InputConfig, SceneEmbedding] = {}
    scores = []
    for policy in policies:
        inputs = policy.config.inputs
        if inputs not in scenes:
            scenes[inputs] = policy.embed(observation.views)
        choice = policy.decide_in(scenes[inputs], observation.views, policy.read(task.instruction))
        scores.append(score(environment, goal, choice))
    return scores


def foreign_acts(family: str, policies: Sequence[Policy], episodes: int, split: Split) -> Iterator[list[ActScore]]:
    """The scores at all steps of an expert's first episodes of a split, on the table of another simulator."""
    task = playing.make(family, split)
    with TaskTable() as table:
        for index in range(episodes):
            table.begin(task, playing.SEEDS[split][index])
            for _ in range(task.max_steps):
                expert = task.expert(table)
                if expert is None:
                    break
                yield ask(policies, measuring.seen(table), task, table)
                table.act(expert.action)
                task.advance(table)


def our_acts(family: str, policies: Sequence[Policy], episodes: int, split: Split) -> Iterator[list[ActScore]]:
    """As `foreign_acts`, of the same family in our simulator."""
    task = tasks.make(OUR_TASKS[family], split)
    with World() as world:
        for index in range(episodes):
            observations = world.reset(task, tasks.episode_seed(split, index))
            for _ in range(task.max_steps):
                expert = task.expert(world)
                if expert is None:
                    break
                yield ask(policies, observations[0], task, world)
                observations = world.step(expert.action).observations


def with_and_without(checkpoints: Sequence[Path], endings: Sequence[str]) -> dict[str, Policy]:
    """The policies of checkpoints by the names of their files; with endings, each once more by these rules.

    Raises:
        ValueError: two files have the same name, or a policy is none of GEM or has no maps.
    """
    ways_of_acting = [(), endings] if endings else [()]
    policies: dict[str, Policy] = {}
    for path in checkpoints:
        for rules in ways_of_acting:
            name = "-".join([path.stem, *rules])
            policy = playing.load(path, rules)
            if not isinstance(policy, Gem) or policy.config.semantic_map == "none":
                raise ValueError(f"{path} must hold a policy of GEM with maps, got {policy.name}")
            if name in policies:
                raise ValueError(f"the checkpoints must have different names, got {name} twice")
            policies[name] = policy
    return policies


def report(checkpoints: Sequence[Path], family: str, episodes: int, split: Split, endings: Sequence[str]) -> None:
    """Print how many acts of each policy are right, in both simulators."""
    playing.make(family, split)
    measuring.check_count("episodes", episodes)
    policies = with_and_without(checkpoints, endings)
    for simulator, acts in (("MuJoCo", foreign_acts), ("ours", our_acts)):
        made = tqdm(acts(family, list(policies.values()), episodes, split), simulator, unit="act")
        scores = np.array([[astuple(act) for act in of_step] for of_step in made])  # (acts, policies, parts)
        for name, shares in zip(policies, 100 * scores.mean(axis=0), strict=True):
            parts = ", ".join(f"{part.name} {share:.0f}" for part, share in zip(fields(ActScore), shares, strict=True))
            print(f"{name}, {family}, {simulator}, {len(scores)} acts: {parts}")
