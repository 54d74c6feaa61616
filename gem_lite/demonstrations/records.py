"""Records of demonstrations, and the folders that hold them: a person or another program can write these, too.

An episode is a folder of its steps. A step is a scene (`Observation.load`) with one more file, ``action.json``::

    {"version": 1, "sentence": "put the red block in the blue bowl",
     "pick": {"x": 0.40, "y": 0.25, "yaw": 0.35}, "place": {"x": 0.62, "y": 0.36, "yaw": 0.35},
     "pick_symmetry": 1.5708, "place_symmetry": 0}

x and y are metres in the table's frame. yaw is the tool's turn in radians, counter-clockwise seen from above; that of
the place is the tool's final yaw. A push has ``"kind": "push"``, and ``start`` and ``end`` instead of pick and place.
These entries may be missing: the symmetries (`ExpertAction`), ``pick_table``, ``place_table`` and ``table`` (0),
``reward``, and ``trace``: rows of x, y, yaw and whether the tool holds something.

A sentence may hold pictures in the places of phrases: ``"sentence": "put {0} into {1}", "pictures": ["mug.png",
"box.png"]`` (`language.PictureSentence`). The pictures are PNG files in the step's folder;
very large ones are made smaller (`png.decode_any`).

An episode of our tasks has a file ``episode.json``, too: ``{"version": 1, "task": ..., "split": ..., "seed": ...,
"world": ...}``.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from gem_lite import language
from gem_lite.actions import Action, ExpertAction, GripperState, PickPlace, Push
from gem_lite.foundations.files import unchanged, write_together, writing
from gem_lite.foundations.forms import Form, Text, Whole
from gem_lite.language import Instruction
from gem_lite.rgbd import png
from gem_lite.rgbd.observation import DEPTH_SCALE, Observation, depth_steps
from gem_lite.se2 import Pose2

ACTION_FILE = "action.json"
EPISODE_FILE = "episode.json"
OWN_WORLD = "own"
"""The world of demonstrations that were recorded on a table outside this library."""
_FILE_NAME = r"^[^/\\\x00]+\.png$"
"""A name that contains a folder could point outside the step's."""


class PoseEntry(Form):
    """A pose in action.json."""

    x: float
    y: float
    yaw: float


class ActionFile(Form):
    """The file action.json. The poses are those of its kind of action."""

    version: Literal[1]
    sentence: Text
    pictures: tuple[Annotated[str, Field(pattern=_FILE_NAME)], ...] = ()
    kind: Literal["pick-place", "push"] = "pick-place"
    pick: PoseEntry | None = None
    place: PoseEntry | None = None
    pick_table: Whole = 0
    place_table: Whole = 0
    start: PoseEntry | None = None
    end: PoseEntry | None = None
    table: Whole = 0
    pick_symmetry: float = 0.0
    place_symmetry: float = 0.0
    reward: float | None = None
    trace: tuple[tuple[float, float, float, bool], ...] = ()

    def action(self) -> Action:
        """The action. Raises ValueError if a pose is missing."""
        if self.kind == "push":
            return Push(self._pose("start"), self._pose("end"), self.table)
        return PickPlace(self._pose("pick"), self._pose("place"), self.pick_table, self.place_table)

    def instruction(self, folder: Path) -> Instruction:
        """The sentence, with its pictures from a folder.

        Raises:
            FileNotFoundError: a picture is missing.
            ValueError: a file is no picture, or the sentence does not hold each picture once.
        """
        if not self.pictures:
            return self.sentence
        pictures = [language.read_picture(folder / name) for name in self.pictures]
        named = [dataclasses.replace(one, name=Path(one.name).stem) for one in pictures]
        return language.PictureSentence(self.sentence, tuple(named))

    def _pose(self, name: str) -> Pose2:
        entry = getattr(self, name)
        if entry is None:
            raise ValueError(f"it lacks {name}")
        return Pose2(entry.x, entry.y, entry.yaw)


class EpisodeFile(Form):
    """The file episode.json."""

    version: Literal[1]
    task: Text
    split: Text
    seed: Whole
    world: Text


@dataclass(frozen=True)
class DemonstrationStep:
    """One step of an episode. Every map, label and crop can be computed from it.

    Attributes:
        observation: the pictures before the action.
        instruction: the sentence, with or without pictures.
        expert: the expert's action.
        trace: the states of the gripper during the action. Without any, those of a pick and place are the grasp and
            the release where the action says, as if the tool had measured them.
        reward: the change of the task's score, in [-1, 1]; None if nobody measured it.

    Raises:
        ValueError: the instruction is empty, or a pose of the action is not finite.
    """

    observation: Observation
    instruction: Instruction
    expert: ExpertAction
    trace: tuple[GripperState, ...] = ()
    reward: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.instruction, str) and not self.instruction.strip():
            raise ValueError("the sentence is empty: say what to pick and where to place it")
        action = self.expert.action
        for name, pose in vars(action).items():
            if isinstance(pose, Pose2) and not all(math.isfinite(number) for number in dataclasses.astuple(pose)):
                raise ValueError(f"{name} must have finite numbers, got {pose}")
        if not self.trace and isinstance(action, PickPlace):
            states = [(action.pick, False), (action.pick, True), (action.place, True), (action.place, False)]
            trace = tuple(GripperState(pose.x, pose.y, pose.yaw, holding) for pose, holding in states)
            object.__setattr__(self, "trace", trace)

    @property
    def phrases(self) -> language.Queries:
        """The instruction, parsed by the library's grammar. Raises ValueError if the grammar does not cover it."""
        return language.parse(self.instruction)

    @classmethod
    def load(cls, folder: Path | str) -> DemonstrationStep:
        """The step in a folder of the form above.

        Raises:
            FileNotFoundError: a file is missing.
            ValueError: a file is cut off, or something in it is not allowed.
        """
        path = Path(folder) / ACTION_FILE
        if not path.exists():
            raise FileNotFoundError(f"{folder} holds no recorded step: there is no {ACTION_FILE} in it")
        with unchanged(path):
            return step_of(path.read_bytes(), path, Observation.load(folder), Path(folder))

    def save(self, folder: Path | str, depth_scale: float = DEPTH_SCALE) -> None:
        """Write the step into a folder, for `load`: pictures and action together, or neither.

        Args:
            depth_scale: metres of one step of the depth pictures.

        Raises:
            ValueError: see `Observation.save`.
            OSError: a file cannot be written, or another process writes into the folder. The old files stay.
        """
        contents = self.contents(folder, depth_scale)
        with writing(Path(folder)):
            write_together(contents)

    def contents(self, folder: Path | str, depth_scale: float = DEPTH_SCALE) -> dict[Path, bytes]:
        """The files that `save` writes, and what they hold; action.json is the last."""
        expert = self.expert
        kind = "push" if isinstance(expert.action, Push) else "pick-place"
        pictures: dict[str, bytes] = {}
        sentence = self.instruction
        if isinstance(sentence, language.PictureSentence):
            pictures = {f"picture-{i}.png": png.encode(one.picture) for i, one in enumerate(sentence.pictures)}
            sentence = sentence.text
        content = {
            "version": 1, "sentence": sentence, "kind": kind, **dataclasses.asdict(expert.action),
            "pick_symmetry": expert.pick_symmetry, "place_symmetry": expert.place_symmetry, "reward": self.reward,
            "trace": self.trace,
        }  # fmt: skip
        if pictures:
            content["pictures"] = [*pictures]
        contents = self.observation.contents(folder, depth_scale)
        contents |= {Path(folder) / name: picture for name, picture in pictures.items()}
        contents[Path(folder) / ACTION_FILE] = json.dumps(content, indent=1).encode()
        return contents


def step_of(
    content: bytes | str, path: object, observation: Observation, folder: Path = Path()
) -> DemonstrationStep:  # fmt: skip
    """The step with the content of a file action.json, which ``path`` names.

    Args:
        folder: holds the sentence's pictures.

    Raises:
        FileNotFoundError: a picture is missing.
        ValueError: the content is not allowed.
    """
    file = ActionFile.read(content, path)
    trace = tuple(GripperState(*state) for state in file.trace)
    try:
        expert = ExpertAction(file.action(), file.pick_symmetry, file.place_symmetry)
        return DemonstrationStep(observation, file.instruction(folder), expert, trace, file.reward)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


@dataclass(frozen=True)
class Demonstration:
    """One expert episode; ``world`` is the name of its world, see `gem_lite.simulation.looks`, or `OWN_WORLD`."""

    task: str
    split: str
    seed: int
    steps: tuple[DemonstrationStep, ...]
    world: str = "home"

    @classmethod
    def load(cls, folder: Path | str) -> Demonstration:
        """The episode in a folder: its steps are the subfolders, in the order of their names (`natural_order`).

        Without a file episode.json, the episode is one of another table: the name of the folder above is the task's,
        and it is taken as solved, each step as an equal part of that. Depth is `quantized`.

        Raises:
            FileNotFoundError: there is no such folder, no step in it, or a step lacks a file.
            ValueError: see `DemonstrationStep.load`.
        """
        folder = Path(folder).resolve()
        if not folder.is_dir():
            raise FileNotFoundError(f"{folder} is no folder")
        parts = sorted((part for part in folder.iterdir() if part.is_dir() and not is_hidden(part)), key=natural_order)
        if not parts:
            raise FileNotFoundError(f"{folder} holds no recorded episode: there is no folder of a step in it")
        steps = []
        for part in parts:
            step = DemonstrationStep.load(part)
            reward = 1 / len(parts) if step.reward is None else step.reward
            steps.append(dataclasses.replace(step, observation=quantized(step.observation), reward=reward))
        path = folder / EPISODE_FILE
        if not path.exists():
            return cls(folder.parent.name, "train", 0, tuple(steps), OWN_WORLD)
        facts = EpisodeFile.read(path.read_bytes(), path)
        return cls(facts.task, facts.split, facts.seed, tuple(steps), facts.world)

    def contents(self, folder: Path) -> dict[Path, bytes]:
        """The files that hold the episode in a folder, for `load`."""
        contents: dict[Path, bytes] = {}
        for number, step in enumerate(self.steps, start=1):
            contents |= step.contents(folder / f"step-{number}")
        facts = {name: getattr(self, name) for name in ("task", "split", "seed", "world")}
        contents[folder / EPISODE_FILE] = json.dumps({"version": 1, **facts}, indent=1).encode()
        return contents


def is_hidden(path: Path) -> bool:
    """Whether a name begins with a dot, as those of the folders that JupyterLab makes: no episode or step has it."""
    return path.name.startswith(".")


def natural_order(path: Path) -> list[tuple[int, str]]:
    """A key that sorts names as people do: step-2 before step-10."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def quantized(observation: Observation) -> Observation:
    """The observation with its depth in the steps of `DEPTH_SCALE`. Raises ValueError: see `depth_steps`."""
    depths = [depth_steps(view, DEPTH_SCALE) * np.float32(DEPTH_SCALE) for view in observation.views]
    pairs = zip(observation.views, depths, strict=True)
    return Observation(tuple(dataclasses.replace(view, depth=depth) for view, depth in pairs))
