"""What one visitor of the page does: lay a table, say a sentence, look at the choice, let the simulator act.

Nothing that a visitor gives is run, opened as a path, or kept: a sentence goes to the parser, and files are read from
memory by the same rules as a folder's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.drawing import plot_own_table, plots
from gem_lite.evaluation.evaluate import is_same_table
from gem_lite.maps import places
from gem_lite.maps.refusal import refusal
from gem_lite.policies import robot_plan
from gem_lite.policies.choosing import Choice
from gem_lite.policies.gem import Gem
from gem_lite.rgbd import png
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.observation import CAMERAS_FILE, Observation, raw_views
from gem_lite.rgbd.seen import unseen_in_words
from gem_lite.simulation.world import World
from gem_lite.tasks import Task

LONGEST_SENTENCE = 300
"""A sentence has at most so many characters."""
MOST_FILES = 13
"""An upload has at most so many files: cameras.json, and two pictures of each of six cameras."""
MOST_BYTES = 30_000_000
"""The files of an upload have at most so many bytes together."""
MOST_PIXELS = 25_000_000
"""Its pictures have at most so many pixels together: six cameras with colour and depth of 1920 x 1080."""
SPLIT = "test"
"""The scenes that a visitor sees are those of this split."""


@dataclass(frozen=True)
class Shown:
    """What the page shows: a text, and a picture (H, W, 3) uint8."""

    text: str
    picture: np.ndarray


@dataclass(eq=False)
class Session:
    """One visitor's table. A policy is shared by all visitors, so only one of them may ask at a time.

    Attributes:
        policy: in evaluation mode.
    """

    policy: Gem
    _world: World | None = field(default=None, repr=False)
    _task: Task | None = field(default=None, repr=False)
    _observation: Observation | None = field(default=None, repr=False)
    _choice: Choice | None = field(default=None, repr=False)

    def lay(self, task: str, episode: int) -> Shown:
        """Lay the table of a task's episode in the simulator.

        Raises:
            ValueError: there is no such task or episode, it has another table than the policy's, or the policy cannot
                see it.
        """
        fresh = tasks.make(task, SPLIT)
        if not is_same_table(fresh.workspace, self.policy.config.workspace):
            raise ValueError(f"{task} has another table than the one that the policy was trained for")
        seed = tasks.episode_seed(SPLIT, episode)
        if self._world is None:
            self._world = World()
        (self._observation,) = self._world.reset(fresh, seed)
        self._task, self._choice = fresh, None
        return self._table(f'The task says: "{fresh.instruction}". Say this, or something else.')

    def upload(self, files: Mapping[str, bytes]) -> Shown:
        """Look at a scene of one's own: the files of a folder (docs/your_table.md), by their names.

        Raises:
            ValueError: there are too many or too large files, cameras.json is missing, or something in it is not
                allowed.
        """
        check_size(len(files), sum(len(content) for content in files.values()))
        if CAMERAS_FILE not in files:
            raise ValueError(
                f"the upload must hold {CAMERAS_FILE} and its pictures, got {', '.join(sorted(files)) or '-'}"
            )

        pixels: list[int] = []

        def picture(name: str, channels: int, kind: type) -> np.ndarray:
            if PurePath(name).name not in files:
                raise ValueError(f"{name} is missing, though {CAMERAS_FILE} names it")
            content = files[PurePath(name).name]
            pixels.append(png.pixel_count(content))
            if sum(pixels) > MOST_PIXELS:
                raise ValueError(
                    f"the pictures of an upload have at most {MOST_PIXELS / 1e6:.0f} million pixels together"
                )
            return png.decode(content, channels, kind, name)

        raw = raw_views(files[CAMERAS_FILE], CAMERAS_FILE, picture)
        self._observation = Observation(tuple(view.view() for view in raw))
        self._task, self._choice = None, None
        return self._table("Your table. The simulator cannot act here: you see what the policy would do.")

    def ask(self, sentence: str) -> Shown:
        """What the policy would do for a sentence, or why it does not.

        Raises:
            ValueError: no table is laid; the sentence is too long, or the parser refuses it.
        """
        if self._observation is None:
            raise ValueError("lay a table first")
        if len(sentence) > LONGEST_SENTENCE:
            raise ValueError(f"a sentence has at most {LONGEST_SENTENCE} characters, got {len(sentence)}")
        self._choice = None
        queries = self.policy.read(sentence)
        scene = self.policy.embed(self._observation.views)
        asked = [queries.pick, queries.place]
        maps = {str(query): self.policy.maps(scene, query).fused for query in asked}
        seen = scene.heightmap.seen
        best = {phrase: places.best_places(semantic, seen, self.policy.config) for phrase, semantic in maps.items()}
        reason = refusal(scene, asked, self.policy.source)
        if reason:
            return Shown(f"Refused: {reason}.", _picture(plot_own_table.show_look(scene.heightmap, maps, best)))
        choice = self.policy.decide_in(scene, self._observation.views, queries)
        action = choice.action if isinstance(choice.action, PickPlace) else None
        self._choice = choice if self._task is not None else None
        figure = plot_own_table.show_look(scene.heightmap, maps, best, action)
        elsewhere = robot_plan.plan(choice).forbidden_in_words() if action else []
        said = [f"Understood: {queries}.", _words(choice), *map(_sentence, elsewhere)]
        return Shown(" ".join(said), _picture(figure))

    def act(self) -> Shown:
        """Let the simulator carry out the last choice.

        Raises:
            ValueError: nothing was chosen, or the table is not simulated.
        """
        if self._choice is None or self._world is None or self._task is None:
            raise ValueError("ask first, on a simulated table; one choice is carried out once")
        step = self._world.step(self._choice.action)
        self._choice = None
        (self._observation,) = step.observations
        outcome = "" if step.outcome is None else f"Outcome: {step.outcome.value}. "
        done = "The task is done." if self._task.score(self._world) >= 0.99 else f'Next: "{self._task.instruction}".'
        return self._table(f"{outcome}Score {self._task.score(self._world):.2f}. {done}")

    def close(self) -> None:
        """End the session's world. A session can lay a table again."""
        if self._world is not None:
            self._world.close()
        self._world = self._task = self._observation = self._choice = None

    def _table(self, text: str) -> Shown:
        assert self._observation is not None
        heightmap = fuse_views(self._observation.views, self.policy.config.workspace)
        said = [text, _sentence(unseen_in_words(heightmap.seen))]
        return Shown(" ".join(filter(None, said)), _picture(plots.show_heightmap(heightmap)))


def check_size(files: int, size: int) -> None:
    """Raises ValueError if an upload has too many files or bytes."""
    if files > MOST_FILES or size > MOST_BYTES:
        raise ValueError(
            f"an upload has at most {MOST_FILES} files with {MOST_BYTES / 1e6:.0f} MB together, got {files} with "
            f"{size / 1e6:.0f} MB"
        )


def _words(choice: Choice) -> str:
    action = choice.action
    if not isinstance(action, PickPlace):
        return "It would push."
    (pick, place) = ((pose.x, pose.y, np.degrees(pose.yaw)) for pose in (action.pick, action.place))
    return "It picks at ({:.3f}, {:.3f}) m, {:.0f}°, and places at ({:.3f}, {:.3f}) m, {:.0f}°.".format(*pick, *place)


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}." if words else ""


def _picture(figure: Figure) -> np.ndarray:
    """A figure as (H, W, 3) uint8. The figure is closed."""
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]
    plt.close(figure)
    return pixels
