"""What a stranger may put into a file, and what earlier versions put there."""

import dataclasses
import hashlib
import io
import json
import os
import struct
import zlib
from pathlib import Path

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


def contents(folder):
    """The bytes of all files by their paths in a folder."""
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def stop_at_write(monkeypatch, number, error, suffix=""):
    """From write or rename ``number`` on, of files whose names hold ``suffix``, no more reaches the disk.

    They are counted from 0. Then half of the content is written, and ``error`` is raised. Returns the list of calls.
    """
    calls = []

    def counted(honest):
        def call(path, *args, **kwargs):
            if suffix in Path(path).name:
                calls.append(path)
                if len(calls) > number:
                    if isinstance(args[0], bytes):
                        honest(path, args[0][: len(args[0]) // 2])
                    raise error
            return honest(path, *args, **kwargs)

        return call

    monkeypatch.setattr(Path, "write_bytes", counted(Path.write_bytes))
    monkeypatch.setattr(os, "replace", counted(os.replace))
    return calls
