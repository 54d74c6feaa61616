"""One recorded step of a demonstration: what the cameras saw, the sentence, and what the tool did.

It is a folder that a person or another program can write: a scene (`Observation.load`) with one more file,
``action.json``::

    {"version": 1, "sentence": "put the red block in the blue bowl",
     "pick": {"x": 0.40, "y": 0.25, "yaw": 0.35}, "place": {"x": 0.62, "y": 0.36, "yaw": 0.35},
     "pick_symmetry": 1.5708, "place_symmetry": 0}

x and y are metres in the table's frame. yaw is the tool's turn in radians, counter-clockwise seen from above; that of
the place is the tool's final yaw. The two symmetries may be missing; see `ExpertAction`.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gem_lite.actions import ExpertAction, GripperState, PickPlace
from gem_lite.foundations.files import as_number, as_text, read_json, unchanged, write_together, writing
from gem_lite.rgbd.observation import DEPTH_SCALE, Observation
from gem_lite.se2 import Pose2

ACTION_FILE = "action.json"
VERSION = 1


@dataclass(frozen=True)
class Recording:
    """One step: the pictures before the action, the sentence, and the demonstrated pick and place.

    Raises:
        ValueError: the sentence is empty; the action is no pick and place, or a number of it is not finite.
    """

    observation: Observation
    sentence: str
    expert: ExpertAction

    def __post_init__(self) -> None:
        if not self.sentence.strip():
            raise ValueError("sentence is empty: say what to pick and where to place it")
        if not isinstance(self.expert.action, PickPlace):
            raise ValueError(f"the action must be a pick and place, got {self.expert.action}")
        for name in ("pick", "place"):
            pose = getattr(self.expert.action, name)
            if not all(math.isfinite(number) for number in dataclasses.astuple(pose)):
                raise ValueError(f"{name} must have finite numbers, got {pose}")

    @property
    def trace(self) -> tuple[GripperState, ...]:
        """The tool's states at the grasp and at the release, as if it had measured them."""
        action = self.expert.action
        assert isinstance(action, PickPlace)
        pick, place = action.pick, action.place
        return (
            GripperState(pick.x, pick.y, pick.yaw, False),
            GripperState(pick.x, pick.y, pick.yaw, True),
            GripperState(place.x, place.y, place.yaw, True),
            GripperState(place.x, place.y, place.yaw, False),
        )

    @classmethod
    def load(cls, folder: Path | str) -> Recording:
        """The recording in a folder of the form above.

        Raises:
            FileNotFoundError: a file is missing.
            ValueError: a file is cut off, or something in it is not allowed.
        """
        path = Path(folder) / ACTION_FILE
        if not path.exists():
            raise FileNotFoundError(f"{folder} holds no recorded step: there is no {ACTION_FILE} in it")
        with unchanged(path):
            content = read_json(path.read_bytes(), path)
            if content.get("version") != VERSION:
                raise ValueError(f"{path} must have version {VERSION}, got {content.get('version')!r}")
            missing = [key for key in ("sentence", "pick", "place") if key not in content]
            if missing:
                raise ValueError(f"{path} lacks {', '.join(missing)}")
            try:
                sentence = as_text(content["sentence"])
                action = PickPlace(_pose(content, "pick"), _pose(content, "place"))
                symmetries = [as_number(content.get(name, 0)) for name in ("pick_symmetry", "place_symmetry")]
                return cls(Observation.load(folder), sentence, ExpertAction(action, *symmetries))
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from error

    def save(self, folder: Path | str, depth_scale: float = DEPTH_SCALE) -> None:
        """Write the recording into a folder, for `load`: pictures and action together, or neither.

        Args:
            depth_scale: metres of one step of the depth pictures.

        Raises:
            ValueError: see `Observation.save`.
            OSError: a file cannot be written, or another process writes into the folder. The old files stay.
        """
        action = self.expert.action
        assert isinstance(action, PickPlace)
        contents = self.observation.contents(folder, depth_scale)
        content = {
            "version": VERSION, "sentence": self.sentence, "pick": dataclasses.asdict(action.pick),
            "place": dataclasses.asdict(action.place), "pick_symmetry": self.expert.pick_symmetry,
            "place_symmetry": self.expert.place_symmetry,
        }  # fmt: skip
        contents[Path(folder) / ACTION_FILE] = json.dumps(content, indent=1).encode()
        with writing(Path(folder)):
            write_together(contents)


def _pose(content: Mapping[str, Any], name: str) -> Pose2:
    entry = content[name]
    keys = {"x", "y", "yaw"}
    if not isinstance(entry, dict) or set(entry) != keys:
        raise ValueError(f"{name} must have x, y (metres) and yaw (radians), got {entry!r}")
    return Pose2(**{key: as_number(value) for key, value in entry.items()})
