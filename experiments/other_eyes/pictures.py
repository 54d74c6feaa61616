"""Figures A1 and A6 on our scenes: the table, and its map from each source beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from drawings import plot_real_table

from experiments.other_eyes import peaks, scenes
from gem_lite.rgbd.heightmap import fuse_views

USUAL = ("multi-view", "dense", "regions")
SHOWN = {scenes.BOWLS: "", scenes.PARTS: "mug handle", scenes.TOUCHING: ""}
"""The kinds of scenes, and the phrase that a sentence must hold."""


def draw(folder: Path, index: int, names: Sequence[str], detector: str, clip_name: str | None) -> list[Path]:
    """Write a PNG of one validation scene of each kind: a row for each phrase, a column for each source.

    Args:
        index: of the episode.
        names: of sources; without one, those of `USUAL`.

    Raises:
        ValueError: a negative ``index``, an unknown source, or a detector that it refuses or that none reads.
        OSError: a model cannot be loaded, or a picture cannot be written.
    """
    if index < 0:
        raise ValueError(f"episode must be at least 0, got {index}")
    peaks.check_detector(names or USUAL, detector)
    paths = []
    for kind, phrase in SHOWN.items():
        sources = {name: peaks.make_source(name, kind, detector, clip_name) for name in names or USUAL}
        workspace = scenes.configuration(kind).workspace
        with scenes.world_of(kind) as world:
            scene = scenes.look(world, kind, "val", index, phrase)
        table = fuse_views(scene.views, workspace).rgb
        embedded = {name: source.embed(scene.views) for name, source in sources.items()}
        panels = []
        for question in scene.questions:
            panels.append((f'"{question.phrase}"\nthe table', table, None, None))
            for name, source in sources.items():
                semantic = source.map(embedded[name], question.phrase)
                panels.append((f'"{question.phrase}"\n{name}', semantic, question.cells, None))
        figure = plot_real_table.show_maps(panels, columns=1 + len(sources))
        folder.mkdir(parents=True, exist_ok=True)
        paths.append(folder / f"{kind}.png")
        figure.savefig(paths[-1], bbox_inches="tight")
        plt.close(figure)
    return paths
