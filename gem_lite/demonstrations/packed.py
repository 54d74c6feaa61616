"""Reads the episodes of earlier versions: one archive (npz) each. Nothing writes them any more."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np

from gem_lite.demonstrations.records import Demonstration, EpisodeFile, step_of
from gem_lite.foundations.files import read_json
from gem_lite.rgbd import png
from gem_lite.rgbd.observation import DEPTH_SCALE, Observation, raw_views

LARGEST = 2**30
"""An archive that unpacks to more bytes is refused: a small one may claim any size, and would fill the memory."""


def read(path: Path, content: bytes) -> Demonstration:
    """The episode in an archive. Raises ValueError if it lacks a part or has a wrong one."""
    try:
        return _read(content)
    except Exception as error:  # A file of another program can have any error.
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"the demonstration {path} lacks a part or has a wrong one: {reason}") from error


def _read(content: bytes) -> Demonstration:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > LARGEST:
        raise ValueError(f"it unpacks to {size} bytes, and at most {LARGEST} are allowed")
    arrays = np.load(io.BytesIO(content))

    def read_picture(name: str, channels: int, dtype: type) -> np.ndarray:
        return png.decode(arrays[name].tobytes(), channels, dtype, name)

    facts = read_json(arrays["meta"].tobytes(), "its description")
    steps = []
    for i, entry in enumerate(facts.pop("steps")):
        # The description of a step has the entries of today's files, in other places and under other names.
        cameras = [
            {**camera, "color": f"rgb-{i}-{j}", "depth": f"depth-{i}-{j}", "depth_scale": DEPTH_SCALE}
            for j, camera in enumerate(entry["cameras"])
        ]
        scene = json.dumps({"version": 1, "cameras": cameras})
        views = tuple(raw.view() for raw in raw_views(scene, f"step {i}", read_picture))
        expert = entry["expert"]
        action = {
            "version": 1, "sentence": entry["instruction"], "reward": entry["reward"], **expert["action"],
            "pick_symmetry": expert["pick_symmetry"], "place_symmetry": expert["place_symmetry"],
            "trace": [(x, y, yaw, bool(holding)) for x, y, yaw, holding in arrays[f"trace-{i}"].tolist()],
        }  # fmt: skip
        steps.append(step_of(json.dumps(action), f"step {i}", Observation(views)))
    episode = EpisodeFile.read(json.dumps({"version": 1, **facts}), "its description")
    return Demonstration(episode.task, episode.split, episode.seed, tuple(steps), episode.world)
