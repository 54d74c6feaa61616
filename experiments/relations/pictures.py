"""Pictures of relations: the map of a place over its table, and the table's frame."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from experiments.relations.measure import map_source
from gem_lite import language, tasks
from gem_lite.clip import Clip
from gem_lite.maps import relations
from gem_lite.maps.query_maps import query_maps
from gem_lite.maps.semantic_map import plateau_centre
from gem_lite.policies.gem_config import LITE
from gem_lite.se2 import Workspace
from gem_lite.simulation.world import World


def draw_tables(folder: Path, task_name: str, count: int, model: Clip) -> list[Path]:
    """Draw the first validation tables of a task, one picture each. A cross marks the place of the map alone."""
    source = map_source(model)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    with World() as world:
        for index in range(count):
            task = tasks.make(task_name, "val")
            (observation,) = world.reset(task, tasks.episode_seed("val", index))
            scene = source.embed(observation.views)
            place = query_maps(source, scene, language.parse(task.instruction).place, LITE).fused
            figure, axes = plt.subplots(figsize=(3.2, 5.6))
            axes.imshow(scene.heightmap.rgb)
            axes.imshow(place, cmap="autumn", vmin=0, vmax=1, alpha=0.7 * (place > 0))
            if place.any():
                row, col = plateau_centre(place, LITE)
                axes.plot(col, row, "kx")
            axes.set_title(task.instruction, fontsize=7)
            axes.axis("off")
            paths.append(folder / f"{index}.png")
            figure.savefig(paths[-1], dpi=80, bbox_inches="tight")
            plt.close(figure)
    return paths


def draw_frame(path: Path) -> None:
    """Draw the free places around one thing in the middle of a bare table, and their relations."""
    workspace = Workspace()
    rows, cols = np.indices(workspace.shape)
    x, y = workspace.to_world(rows, cols)
    thing = np.hypot(x - 0.5, y) <= 0.058
    figure, axes = plt.subplots(figsize=(3.6, 4.2))
    axes.set_facecolor("0.9")
    extent = (workspace.x_min, workspace.x_max, workspace.y_min, workspace.y_max)
    axes.imshow(np.ma.masked_equal(thing, 0), extent=extent, cmap="Greens", vmin=0, vmax=1.4)
    for relation, (step_x, step_y) in relations.DIRECTIONS.items():
        places = relations.free_places(relation, [thing], thing, workspace)
        axes.imshow(
            np.ma.masked_equal(relations.graded(places, workspace), 0), extent=extent, cmap="autumn", vmin=0, vmax=1
        )
        axes.text(0.5 + 0.14 * step_x, 0.14 * step_y, relation, ha="center", va="center", fontsize=7)
    axes.set(xlim=(0.25, 0.75), ylim=(-0.25, 0.25), xlabel="x (m)", ylabel="y (m)")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90, bbox_inches="tight")
    plt.close(figure)
