"""The kernels of phrases as a picture, as in Figure A2."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from drawings import plot_many_tasks
from matplotlib.figure import Figure

from experiments.real_tables import kernels
from gem_lite.policies.gem import Gem
from gem_lite.steerable import disc


def draw_kernels(policy: Gem, path: Path) -> None:
    """Write a PNG: the kernels of the four phrases of Figure A2, their cosines, and those without the mean."""
    shown, tables = kernels.of_figure_a2(policy)
    inside = disc(policy.config.kernel).numpy()
    figures = [plot_many_tasks.show_phrase_kernels(kernels.FIGURE_A2, shown.numpy(), inside)]
    for key, title in (("cosine", "the kernels as they are"), ("centred_cosine", "the mean of all phrases subtracted")):
        figures.append(plot_many_tasks.show_cosines(kernels.FIGURE_A2, tables[key], title, label="cosine"))
    _write_side_by_side(figures, path)


def _write_side_by_side(figures: Sequence[Figure], path: Path) -> None:
    """Write figures beside each other, each at its own size, on white."""
    pictures = []
    for figure in figures:
        figure.canvas.draw()
        pictures.append(np.asarray(figure.canvas.buffer_rgba())[..., :3])
        plt.close(figure)
    height = max(picture.shape[0] for picture in pictures)
    padded = [
        np.pad(picture, ((0, height - picture.shape[0]), (0, 0), (0, 0)), constant_values=255) for picture in pictures
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    plt.imsave(path, np.hstack(padded))
