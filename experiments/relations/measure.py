"""What the maps alone do in episodes of put-beside: no policy takes part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from gem_lite import language, tasks
from gem_lite.actions import PickPlace
from gem_lite.clip import Clip
from gem_lite.evaluation.rollout import Observations, rollout
from gem_lite.maps.query_maps import query_maps
from gem_lite.maps.relations import NoFreePlaceError, no_free_place
from gem_lite.maps.semantic_map import plateau_centre
from gem_lite.maps.sources import SOURCES, MapSource
from gem_lite.policies.gem_config import LITE
from gem_lite.se2 import Pose2
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.world import World


@dataclass(frozen=True)
class Played:
    """One episode: its sentence, its relation, the reward, and why no action was found (empty if one was)."""

    sentence: str
    relation: str
    reward: float
    refused: str


def map_source(model: Clip) -> MapSource:
    """The text-conditioned maps of the configuration `lite`."""
    return SOURCES.find(LITE.semantic_map)(model, LITE)


def act(source: MapSource, observations: Observations, sentence: str) -> PickPlace:
    """Pick at the centre of the pick map's highest plateau, place at that of the place map's, without a turn.

    Raises:
        NoFreePlaceError: no place is free.
    """
    scene = source.embed(observations[0].views)
    queries = language.parse(sentence)
    place_map = query_maps(source, scene, queries.place, LITE).fused
    if not place_map.any():
        raise NoFreePlaceError(no_free_place(str(queries.place)))
    pick_map = query_maps(source, scene, queries.pick, LITE).fused
    pick, place = (LITE.workspace.to_world(*plateau_centre(semantic, LITE)) for semantic in (pick_map, place_map))
    return PickPlace(Pose2(*pick), Pose2(*place))


def play(task_name: str, split: tasks.Split, episodes: int, model: Clip) -> list[Played]:
    """The first episodes of a split of a task of put-beside."""
    source = map_source(model)
    played = []
    with World() as world:
        for index in tqdm(range(episodes), desc=task_name, unit="episode"):
            task = tasks.make(task_name, split)
            refused = ""
            reward = 0.0

            def actor(environment: Environment, observations: Observations, empty: Sequence[Pose2]) -> PickPlace:
                return act(source, observations, task.instruction)  # noqa: B023 (it is called in this turn alone)

            try:
                reward = sum(
                    turn.result.reward for turn in rollout(world, task, tasks.episode_seed(split, index), actor)
                )
            except NoFreePlaceError as reason:
                refused = str(reason)
            relation, _ = language.split_relation(str(language.parse(task.instruction).place))
            played.append(Played(task.instruction, str(relation), float(np.clip(reward, 0, 1)), refused))
    return played
