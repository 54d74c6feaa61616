"""``gem-lite plan``: a vague goal in a simulated scene becomes a plan, and a policy carries it out."""

from __future__ import annotations

from pathlib import Path

from gem_lite.cli.base import Clip, Split, World
from gem_lite.cli.own_table import SHIPPED


def plan(
    goal: str, /, *, task: str = "packing-google-objects-seq-seen", episode: int = 0, split: Split = "test",
    policy: Path = SHIPPED, model: str = "smollm2", world: World = "home", clip: Clip = None,
) -> None:  # fmt: skip
    """Plan a vague goal, and act it out in a simulated scene.

    The planner sees what the policy sees, camera views. Prints each step
    and what became of it, then what is missing and what failed.

    Args:
        goal: such as "pick all toys and place them into the brown box", "swap the mug and the fork", or two goals
            with "and"
        task: whose scene; its own sentences are not used
        episode: index of the scene in the split
        policy: checkpoint of a GEM
        model: smollm2, or the folder or Hugging Face name of a causal language model

    Examples:
      gem-lite plan "pick all toys and place them into the brown box"
    """
    from gem_lite import clip as clips
    from gem_lite import tasks
    from gem_lite.evaluation.evaluate import check_table
    from gem_lite.language import models
    from gem_lite.planning import goals
    from gem_lite.planning.belonging import Belonging
    from gem_lite.planning.planner import Planner
    from gem_lite.policies import checkpoints, gem
    from gem_lite.simulation import looks
    from gem_lite.simulation.bodies import objects
    from gem_lite.simulation.world import World as Table

    asked = goals.read(goal)
    scene = tasks.make(task, split)
    acting = checkpoints.load_policy(policy, clips.load(clip))
    if not isinstance(acting, gem.Gem):
        raise ValueError(f"{policy} must be a checkpoint of gem, got {acting.name}: the planner looks at its maps")
    check_table(policy, acting.config.workspace, scene.workspace, task)
    planner = Planner(asked, Belonging(models.load(model)), objects.NAMES, acting.source, acting.parser)
    with Table(style=looks.style(world)) as table:
        (observation,) = table.reset(scene, tasks.episode_seed(split, episode))
        empty_picks = []
        while (instruction := planner.next(observation)) is not None:
            print(f"{len(planner.plan.steps)}. {instruction}", flush=True)
            action = acting.act(observation, instruction, empty_picks)
            result = table.step(action)
            empty_picks = [] if result.grasped else [*empty_picks, action.pick]
            (observation,) = result.observations
    done = sum(step.done is True for step in planner.plan.steps)
    for problem in (*planner.plan.missing, *planner.plan.failed):
        print(problem)
    print(f"{len(planner.plan.steps)} steps; {done} of them were done, as the cameras see it")
