"""What a stranger may put into a file, and what earlier versions put there."""

import dataclasses
import hashlib
import io
import json
import struct
import zlib

import numpy as np

from gem_lite.actions import Push
from gem_lite.rgbd import png
from gem_lite.rgbd.observation import DEPTH_SCALE, depth_steps


def png_that_claims(width, height):
    """A small PNG whose header says ``width`` x ``height``, gray, 16 bits."""

    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def change_cameras(folder, change):
    """``change`` the entry of each camera in cameras.json, in place."""
    content = json.loads((folder / "cameras.json").read_text())
    for entry in content["cameras"]:
        change(entry)
    (folder / "cameras.json").write_text(json.dumps(content))


def archive(demonstration):
    """The bytes of an episode as earlier versions wrote it: an archive of arrays."""
    arrays, steps = {}, []
    for i, step in enumerate(demonstration.steps):
        for j, view in enumerate(step.observation.views):
            arrays[f"rgb-{i}-{j}"] = np.frombuffer(png.encode(view.rgb), np.uint8)
            arrays[f"depth-{i}-{j}"] = np.frombuffer(png.encode(depth_steps(view, DEPTH_SCALE)), np.uint8)
        arrays[f"trace-{i}"] = np.array(step.trace, np.float32).reshape(-1, 4)
        expert = dataclasses.asdict(step.expert)
        expert["action"] = {"kind": "push" if isinstance(step.expert.action, Push) else "pick-place"} | expert["action"]
        cameras = [dataclasses.asdict(view.camera) for view in step.observation.views]
        steps.append({"instruction": step.instruction, "expert": expert, "reward": step.reward, "cameras": cameras})
    facts = {name: getattr(demonstration, name) for name in ("task", "split", "seed", "world")}
    arrays["meta"] = np.frombuffer(json.dumps(facts | {"steps": steps}).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def archive_names(demonstrations):
    """The archives of a set of earlier versions: their SHA-256 by their names."""
    sums = {}
    for number, demonstration in enumerate(demonstrations):
        digest = hashlib.sha256(archive(demonstration)).hexdigest()
        sums[f"episode-{number:04d}-{digest[:12]}.npz"] = digest
    return sums
