"""The gallery of all tasks (Fig. A10)."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite.drawing.plots import bare
from gem_lite.evaluation.gallery import ExpertStory

TABLE_PART = np.s_[150:, :]
"""The part of the front camera's picture that shows the table."""


def show_gallery(stories: Sequence[ExpertStory], columns: int = 6) -> Figure:
    """For each story its name, its first sentence, and below each other its first and its last picture."""
    rows = -(-len(stories) // columns)
    fig, axes = plt.subplots(
        2 * rows, columns, figsize=(2.3 * columns, 4.1 * rows), squeeze=False, layout="constrained"
    )  # fmt: skip
    for ax in axes.flat:
        ax.set_axis_off()
    for number, story in enumerate(stories):
        row, column = divmod(number, columns)
        sentence = "\n".join(textwrap.wrap(f'"{story.sentences[0]}"', 36))
        title = f"{story.task}\n{sentence}"
        bare(axes[2 * row, column]).imshow(story.first[TABLE_PART])
        axes[2 * row, column].set_title(title, fontsize=7)
        bare(axes[2 * row + 1, column]).imshow(story.last[TABLE_PART])
        axes[2 * row + 1, column].set_title(f"after {story.actions} actions", fontsize=7)
    return fig
