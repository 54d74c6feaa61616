"""A picture of each family: what the cameras see, and what a policy makes of it."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
from drawings.plot_shared import action_map
from matplotlib.figure import Figure

from experiments.foreign_table import measuring
from experiments.foreign_tasks import playing
from experiments.foreign_tasks.families import FAMILIES
from experiments.foreign_tasks.table import TaskTable
from gem_lite import clip
from gem_lite.actions import PickPlace
from gem_lite.drawing.plots import MAP_COLORS, PICK_COLOR, PLACE_COLOR, bare, draw_from_above, draw_gripper
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.gem import GemChoice
from gem_lite.rgbd.observation import Observation


def draw_all(folder: Path) -> None:
    """Draw the first validation episode of each family, at its first sentence."""
    folder.mkdir(parents=True, exist_ok=True)
    policy = load_policy(measuring.SHIPPED, clip.load()).eval()
    with TaskTable() as table:
        for family in FAMILIES:
            task = playing.make(family, "val")
            table.begin(task, playing.SEEDS["val"][0])
            observation = measuring.seen(table)
            figure = show_choice(observation, policy.decide(observation, task.instruction))
            figure.savefig(folder / f"{family}.png")
            plt.close(figure)


def show_choice(observation: Observation, choice: GemChoice) -> Figure:
    """The cameras' pictures above; below, the table from above with the act, its heights, maps and action maps."""
    heightmap = choice.heightmap
    action = choice.action
    start, end = (action.pick, action.place) if isinstance(action, PickPlace) else (action.start, action.end)
    figure = plt.figure(figsize=(13, 9), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1, 1.6))
    views = observation.views
    for ax, view in zip(above.subplots(1, len(views)), views, strict=True):
        bare(ax, view.camera.name).imshow(view.rgb)
    axes = below.subplots(1, 6)
    draw_from_above(bare(axes[0], "from above, and the act"), heightmap)
    draw_gripper(axes[0], start, heightmap.workspace, PICK_COLOR)
    draw_gripper(axes[0], end, heightmap.workspace, PLACE_COLOR)
    bare(axes[1], "height").imshow(heightmap.height, cmap="viridis")
    panels = (("pick", choice.queries.pick, choice.pick_map), ("place", choice.queries.place, choice.place_map))
    for ax, (role, phrase, semantic) in zip(axes[2:4], panels, strict=True):
        bare(ax, f'{role}: "{phrase}"').imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
    for ax, role, logits in zip(axes[4:], ("pick", "place"), (choice.pick_logits, choice.place_logits), strict=True):
        bare(ax, f"action map of the {role}").imshow(action_map(logits), cmap="viridis")
    figure.suptitle(choice.instruction)
    return figure
