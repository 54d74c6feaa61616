"""Drawings of the quickstart: a decision, one bowl chosen among many, answers to sentences, a film of an episode."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawings import pictures
from drawings.plot_shared import LEAST_LOGIT, action_map, draw_zoom
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image as Pillow

from gem_lite.actions import GripperState, PickPlace
from gem_lite.drawing.plots import MAP_COLORS, PICK_COLOR, PLACE_COLOR, bare, draw_gripper
from gem_lite.policies.gem import GemChoice
from gem_lite.rgbd.camera import Camera
from gem_lite.se2 import Workspace
from gem_lite.simulation.rendering import cameras_around, render
from gem_lite.simulation.world import World

DARK, LIGHT = "#202020", "white"
"""Background and text of a film."""
DPI = 72
FRAME_SIZE = 656, 270
"""Width and height of a film's frame (pixels)."""
SCREEN = slice(47, 261), slice(9, 295)
"""The rows and columns of a frame that show the camera's picture."""


def show_decision(decision: GemChoice, clip_name: str) -> Figure:
    """From phrase to action: text map, image map, blend and action map, for pick (top) and place (bottom)."""
    w = decision.heightmap.workspace
    fig, axes = plt.subplots(2, 5, figsize=(10.5, 8.4), layout="constrained")
    rows = (
        ("pick", decision.queries.pick, decision.pick_text, decision.pick_image, decision.pick_map,
         decision.pick_logits, decision.action.pick, PICK_COLOR),
        ("place", decision.queries.place, decision.place_text, decision.place_image, decision.place_map,
         decision.place_logits, decision.action.place, PLACE_COLOR),
    )  # fmt: skip
    for axs, (role, phrase, text, image, blend, logits, pose, color) in zip(axes, rows, strict=True):
        bare(axs[0], f'{role}: "{phrase}"').imshow(decision.heightmap.rgb)
        bare(axs[1], "text-conditioned map").imshow(text, cmap=MAP_COLORS, vmin=0, vmax=1)
        if image is None:
            bare(axs[2], "image-conditioned map").imshow(np.ones((*w.shape, 3)))
            axs[2].text(
                0.5, 0.5, "None\n(no crop of a\nsimilar phrase)", ha="center", va="center", transform=axs[2].transAxes
            )
        else:
            bare(axs[2], "image-conditioned map").imshow(image, cmap=MAP_COLORS, vmin=0, vmax=1)
        map_image = bare(axs[3], "blend (Eq. 4)").imshow(blend, cmap=MAP_COLORS, vmin=0, vmax=1)
        action_image = bare(axs[4], "action map, best angle").imshow(action_map(logits), cmap="viridis")
        draw_gripper(axs[0], pose, w, color)
        row, col = w.to_pixel(pose.x, pose.y)
        axs[4].plot(col, row, "o", ms=11, mfc="none", mec=color, mew=1.5)
        for ax in (axs[0], axs[4]):
            ax.set(xlim=(-0.5, w.shape[1] - 0.5), ylim=(w.shape[0] - 0.5, -0.5))
        fig.colorbar(map_image, ax=axs[3], location="bottom", shrink=0.9, label="0: typical cell, 1: typical match")
        fig.colorbar(action_image, ax=axs[4], location="bottom", shrink=0.9, label="logit - best logit")
    fig.suptitle(f'"{decision.instruction}"   (maps by {clip_name})', fontsize=11)
    return fig


def show_angles(logits: np.ndarray, cell: tuple[int, int, int], color: str, title: str) -> Figure:
    """The logits of every angle at one pixel, measured from the lowest, on a circle of directions on the table."""
    angles = 2 * np.pi * np.arange(len(logits) + 1) / len(logits)
    values = logits[:, cell[1], cell[2]]
    values = np.append(values, values[0]) - values.min()
    fig, ax = plt.subplots(figsize=(3, 3), subplot_kw={"projection": "polar"}, layout="constrained")
    ax.plot(angles, values, ".-", color=color)
    ax.plot([angles[cell[0]]] * 2, [0, values.max()], color=color, lw=3, alpha=0.4)
    ax.set_yticklabels([])
    ax.set_title(title, fontsize=9)
    return fig


def show_lead(logits: np.ndarray, things: Sequence[tuple[str, float, float]]) -> Figure:
    """How far the best place leads: the action map in full, the same cut at `LEAST_LOGIT`, and single things.

    Args:
        logits: (R, H, W).
        things: for each thing its name, its largest logit minus the best of all, and the map's value on it.
    """
    fig, axes = plt.subplots(1, 3, figsize=(9.8, 3.3), width_ratios=(1.15, 1.15, 2.6), layout="constrained")
    full = logits.max(axis=0) - logits.max()
    for ax, title, values in zip(axes, ("all logits", "cut at 20 below"), (full, action_map(logits)), strict=False):
        fig.colorbar(bare(ax, title).imshow(values, cmap="viridis"), ax=ax, label="logit - best logit")
    row, col = divmod(int(full.argmax()), full.shape[1])
    draw_zoom(axes[1], action_map(logits), row, col, _box_beside(row, len(full)))
    ax = axes[2]
    for i, (_, lead, value) in enumerate(things):
        ax.plot([lead, 0], [i, i], color="0.75", lw=1.5, zorder=1)
        ax.plot(lead, i, "s", ms=8, color=PLACE_COLOR, mec="black")
        ax.annotate(f"map {value:.2f}", (lead, i), (0, 7), textcoords="offset points", ha="center", fontsize=8)
    ax.axvline(LEAST_LOGIT, color="0.4", ls="--", lw=1)
    ax.annotate("cut", (LEAST_LOGIT, len(things) - 0.6), (-3, 0), textcoords="offset points", ha="right", fontsize=8)
    ax.set_yticks(range(len(things)), [name for name, *_ in things])
    lowest = min(lead for _, lead, _ in things)
    ax.set(ylim=(len(things) - 0.4, -0.8), xlim=(1.12 * lowest, -0.1 * lowest), xlabel="its best logit - best of all")
    ax.grid(axis="x", alpha=0.3)
    return fig


def _box_beside(row: int, height: int) -> tuple[float, float, float, float]:
    """The half of a panel of ``height`` rows that does not hold ``row``, for `draw_zoom`."""
    return (0.06, 0.05 if row < height / 2 else 0.52, 0.88, 0.44)


def show_answers(
    picture: np.ndarray, workspace: Workspace, answers: Sequence[tuple[str, PickPlace | None, str]]
) -> Figure:
    """One picture from above for each sentence, with the pick and the place that were chosen, and a note below it.

    Args:
        picture: (H, W, 3) uint8, the table from above.
        answers: for each its sentence, its action (None: the sentence was refused, the picture is dark) and the note.
    """
    fig, axes = plt.subplots(1, len(answers), figsize=(1.5 * len(answers), 4.2), layout="constrained")
    for ax, (sentence, action, note) in zip(np.atleast_1d(axes), answers, strict=True):
        bare(ax, textwrap.fill(sentence, 19)).imshow(picture if action else picture // 3)
        if action:
            draw_gripper(ax, action.pick, workspace, PICK_COLOR)
            draw_gripper(ax, action.place, workspace, PLACE_COLOR)
        else:
            ax.text(0.5, 0.5, "refused", transform=ax.transAxes, ha="center", color=LIGHT, fontsize=11)
        rows, cols = picture.shape[:2]
        ax.set(xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5))
        ax.set_xlabel(note, fontsize=8)
    return fig


class Film:
    """Takes pictures while the tool is over the table. Use it as ``world.film``.

    Attributes:
        pictures: (h, w, 3) uint8 each.
        holding: for each picture, whether the tool then held a body.

    Args:
        camera: the number of the camera that films.
        every: one picture for so many states of the tool.
        width: of a picture, in pixels.
    """

    def __init__(self, world: World, camera: int, every: int = 9, width: int = 320) -> None:
        self.world = world
        self.camera = _resized(cameras_around(world.workspace)[camera], width)
        self.every = every
        self.pictures: list[np.ndarray] = []
        self.holding: list[bool] = []

    def __call__(self, state: GripperState) -> None:
        """See `Environment.film`."""
        if len(self.world.trace) % self.every == 0 and state.x > self.world.workspace.x_min:
            self.pictures.append(self.take())
            self.holding.append(self.world.effector.held is not None)

    def take(self) -> np.ndarray:
        """(h, w, 3) uint8: a picture of the present moment."""
        return render(self.world.client, self.camera, self.world.light)[0].rgb


def _resized(camera: Camera, width: int) -> Camera:
    """The same camera with pictures of another width."""
    scale = width / camera.size[1]
    rows = [tuple(scale * value for value in row) for row in camera.intrinsics[:2]]
    return replace(camera, size=(round(scale * camera.size[0]), width), intrinsics=(*rows, camera.intrinsics[2]))


def episode_frames(
    decision: GemChoice, before: np.ndarray, act: Sequence[np.ndarray], after: tuple[np.ndarray, np.ndarray]
) -> list[np.ndarray]:
    """The frames of an episode's film: the sentence, the maps and action maps of pick and place, and the act.

    The first frame is from the middle of the act: readers who see one frame see what the film is about.

    Args:
        before: (h, w, 3) uint8, the camera's picture before the act.
        act: its pictures during the act.
        after: its picture after the act, and the table from above at that time.
    """
    above = decision.heightmap.rgb
    captions = ("a sentence", "what to pick?", "pick: where exactly?", "where to place?", "place: where exactly?")
    last = len(captions) - 1
    frames = []
    for stage, caption in enumerate(captions):
        frames += 4 * [_on_screen(before, show_moment(decision, above, stage, caption))]
    acting = pictures.frame(show_moment(decision, above, last, "the act"), DPI)
    frames.insert(0, _on_screen(act[len(act) // 2], acting))
    frames += [_on_screen(picture, acting) for picture in act]
    frames += 6 * [_on_screen(after[0], show_moment(decision, after[1], last + 1, "after the act"))]
    return _with_few_colors(frames)


def _on_screen(picture: np.ndarray, moment: Figure | np.ndarray) -> np.ndarray:
    """A frame with the camera's picture. To draw a whole frame for each picture would take a second more."""
    result = pictures.frame(moment, DPI) if isinstance(moment, Figure) else moment.copy()
    height, width = result[SCREEN].shape[:2]
    result[SCREEN] = np.asarray(Pillow.fromarray(picture).resize((width, height)))
    return result


def _with_few_colors(frames: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The frames in as many colours as a moving picture has. Colours of small objects stay: each octant keeps some."""
    strip = Pillow.fromarray(np.concatenate(frames))
    few = strip.quantize(pictures.COLORS, method=Pillow.Quantize.FASTOCTREE, dither=Pillow.Dither.NONE)
    return np.split(np.asarray(few.convert("RGB")), len(frames))


def show_moment(decision: GemChoice, above: np.ndarray, stage: int, caption: str) -> Figure:
    """A frame of a film: the sentence, a place for a camera's picture, the table from above, a map and an action map.

    Args:
        above: (H, W, 3) uint8, the table from above.
        stage: 0: no map yet, 1: the pick's map, 2: and its action map, 3: the place's map, 4: and its action map,
            5: as 4, without the grippers on the table.
        caption: of the camera's picture.
    """
    fig = plt.figure(figsize=(FRAME_SIZE[0] / DPI, FRAME_SIZE[1] / DPI), facecolor=DARK)
    queries = decision.queries
    phrases = {str(queries.pick): (PICK_COLOR, stage >= 1), str(queries.place): (PLACE_COLOR, stage >= 3)}
    _write(fig, decision.instruction, {phrase: color for phrase, (color, shown) in phrases.items() if shown})
    _panel(fig, 8, 288, caption)
    workspace = decision.heightmap.workspace
    top = _panel(fig, 307, 108, "from above")
    top.imshow(above)
    for pose, color, first in ((decision.action.pick, PICK_COLOR, 2), (decision.action.place, PLACE_COLOR, 4)):
        if first <= stage < 5:
            draw_gripper(top, pose, workspace, color)
    role, semantic, logits, pose, color = ("place", decision.place_map, decision.place_logits, decision.action.place,
                                           PLACE_COLOR)  # fmt: skip
    if stage < 3:
        role, semantic, logits, pose, color = ("pick", decision.pick_map, decision.pick_logits, decision.action.pick,
                                               PICK_COLOR)  # fmt: skip
    axes = [top, _panel(fig, 423, 108, f"{role}: blend"), _panel(fig, 539, 108, f"{role}: action map")]
    if stage >= 1:
        axes[1].imshow(semantic, cmap=MAP_COLORS, vmin=0, vmax=1)
    if stage in (2, 4, 5):
        axes[2].imshow(action_map(logits), cmap="viridis", vmin=LEAST_LOGIT, vmax=0)
        row, col = workspace.nearest_cell(pose.x, pose.y)
        draw_zoom(axes[2], action_map(logits), row, col, _box_beside(row, logits.shape[1]))
        axes[2].plot(col, row, "o", ms=11, mfc="none", mec=color, mew=1.8)
    for ax in axes:
        ax.set(xlim=(-0.5, workspace.shape[1] - 0.5), ylim=(workspace.shape[0] - 0.5, -0.5))
    return fig


def _panel(fig: Figure, left: float, width: float, title: str) -> Axes:
    """Axes for a picture at ``left`` (pixels), 216 pixels high, with a title above."""
    across, up = FRAME_SIZE
    ax = bare(fig.add_axes((left / across, 8 / up, width / across, 216 / up)), title)
    ax.title.set_color(LIGHT)
    ax.set_facecolor("#303030")
    return ax


def _write(fig: Figure, sentence: str, colored: dict[str, str]) -> None:
    """A sentence above the panels. The phrases in ``colored`` are written over it in their colour."""
    layers = [(sentence, LIGHT)]
    for phrase, color in colored.items():
        start = sentence.find(phrase)
        if start >= 0:
            layers.append((" " * start + phrase, color))
    for text, color in layers:
        fig.text(0.012, 0.925, text, color=color, family="monospace", weight="bold", fontsize=14)
