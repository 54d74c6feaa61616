"""The loop that plays an episode, for demonstrations, measurements, pictures and explanations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gem_lite.actions import Action, ExpertAction, PickPlace, Push
from gem_lite.language import Instruction
from gem_lite.policies.choosing import Choice, TablesChoice
from gem_lite.rgbd.observation import Observation
from gem_lite.rgbd.tags import LocalisationError
from gem_lite.se2 import Pose2
from gem_lite.simulation.environment import Environment, Step, body_at
from gem_lite.tasks.task import Task

Observations = tuple[Observation, ...]
Chosen = Action | ExpertAction | Choice | TablesChoice
"""What an actor returns: an action, alone or with the reasons for it."""
Actor = Callable[[Environment, Observations, Sequence[Pose2]], Chosen | None]
"""Chooses an action from the environment, the observations and the empty picks; None ends the episode.

Empty picks are the poses at which the tool has grasped nothing since it last held something. Only experts read the
environment. A policy's actor reads the observations, the sentence and the empty picks."""


@dataclass(frozen=True)
class Turn:
    """One action of an episode.

    Attributes:
        observations: one for each table, before the action.
        instruction: the sentence before the action.
        decision: what the actor returned.
        placed: the ids of the bodies that lay at their targets before the action (`Task.placed`).
        picked: the id of the body that lay topmost at the pick before the action, -1 for none; None for a push.
        result: what the action changed, with its reward and whether the episode is over.
        error: why the robot could not act; empty if it could. Then the reward is 0, and the episode is over.
    """

    observations: Observations
    instruction: Instruction
    decision: Chosen
    placed: set[int]
    picked: int | None
    result: Step
    error: str = ""


def rollout(
    environment: Environment, task: Task, seed: int, actor: Actor, observations: Observations = ()
) -> Iterator[Turn]:
    """Play an episode of a task, action by action. Nobody looks after the last one.

    Args:
        observations: those of the beginning, if the episode was begun before with the same seed.
    """
    environment.begin(task, seed)
    observations = observations or environment.observe()
    empty_picks: list[Pose2] = []
    done = False
    while not done:
        instruction = task.instruction  # The action may set the next one.
        decision = actor(environment, observations, empty_picks)
        if decision is None:
            return
        action = decision if isinstance(decision, PickPlace | Push) else decision.action
        placed = task.placed(environment)
        picked = None
        if isinstance(action, PickPlace):
            picked = body_at(environment, environment.tables[action.pick_table] @ action.pick)
        error = ""
        try:
            result = environment.step(action, last_look=False)
        except LocalisationError as lost:
            error = str(lost)
            result = Step((), 0.0, True, None, ())
        if isinstance(action, PickPlace):
            empty_picks = [] if result.grasped else [*empty_picks, action.pick]
        yield Turn(observations, instruction, decision, placed, picked, result, error)
        observations = result.observations
        done = result.done
