"""How often does the peak of a map lie on the thing that the phrase names? One row for each source and role.

Every source sees the same scenes, with a CLIP of its own, so that none finds pictures embedded that another one saw. No
policy takes part, and a map sees pictures and words only; the true cells only count.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import ndimage
from tqdm import tqdm

from experiments.other_eyes import proposals, scenes  # noqa: F401  (proposals registers two sources)
from gem_lite import clip
from gem_lite.evaluation import results
from gem_lite.maps.detectors import DetectorSource
from gem_lite.maps.sources import SOURCES, MapSource
from gem_lite.tasks.task import Split

USUAL = ("multi-view", "single-view", "dense", "regions")
IDENTITY = ("kind", "method", "detector", "task", "subset", "world", "split", "clip_fingerprint", "config_hash")
"""The entries that identify a row of the results."""
EQUAL = 1e-6
"""Cells at most this far below the highest are as high."""


def make_source(name: str, kind: str, detector: str, clip_name: str | None) -> MapSource:
    """A map source for the table of a kind of scenes, with a CLIP of its own.

    Raises:
        ValueError: no such source, or a detector that it refuses.
        OSError: the CLIP or the detector cannot be loaded.
    """
    source = SOURCES.find(name)
    named = detector if issubclass(source, DetectorSource) else ""
    return source(clip.load(clip_name), replace(scenes.configuration(kind), semantic_map=name, detector=named))


def check_detector(names: Sequence[str], detector: str) -> None:
    """Raise ValueError if a detector is named that none of the sources ``names`` reads."""
    if detector and not any(issubclass(SOURCES.find(name), DetectorSource) for name in names):
        raise ValueError(f"detector must be left out, because none of {', '.join(names)} reads it, got {detector!r}")


def share_on(semantic: np.ndarray, cells: np.ndarray) -> float:
    """The share of a map's highest cells that are, or lie beside, some ``cells`` (H, W) bool.

    All cells of a region are equally high, and so are the cells that the same patches cover: then each of them may be
    the peak. A map that is nowhere above 0 points at nothing.
    """
    if semantic.max() <= 0:
        return 0.0
    highest = semantic >= semantic.max() - EQUAL
    near = ndimage.binary_dilation(cells, np.ones((3, 3)))
    return float(near[highest].mean())


def measure_kind(
    kind: str, split: Split, names: Sequence[str], count: int, detector: str, clip_name: str | None
) -> list[dict]:  # fmt: skip
    """The rows of one kind of scenes: each source of ``names`` in the first ``count`` scenes of a split."""
    sources = {name: make_source(name, kind, detector, clip_name) for name in names}
    shares: dict[tuple[str, str], dict[int, float]] = defaultdict(dict)
    seconds = defaultdict(list)
    with scenes.world_of(kind) as world:
        for index in tqdm(range(count), kind, unit="scene"):
            scene = scenes.look(world, kind, split, index)
            for name, source in sources.items():
                started = time.perf_counter()
                embedded = source.embed(scene.views)
                maps = [source.map(embedded, question.phrase) for question in scene.questions]
                seconds[name].append(time.perf_counter() - started)
                for question, semantic in zip(scene.questions, maps, strict=True):
                    shares[name, question.role][index] = share_on(semantic, question.cells)
    rows = []
    for (name, role), of_scenes in shares.items():
        model = sources[name].clip
        config = sources[name].config
        rows.append({
            "kind": "other-eyes", "method": name, "detector": config.detector, "task": kind, "subset": role,
            "world": scenes.WORLDS[kind], "split": split, "clip": model.name, "clip_fingerprint": model.fingerprint,
            "config": config.name, "config_hash": config.digest,
            "seconds": round(float(np.median(seconds[name])), 3), **results.reward_entries(of_scenes),
        })  # fmt: skip
    return rows


def measure(
    names: Sequence[str],
    kinds: Sequence[str],
    split: Split,
    count: int,
    detector: str,
    clip_name: str | None,
    path: Path,
) -> list[dict]:  # fmt: skip
    """`measure_kind` for several kinds; the rows are filed in ``path``.

    Args:
        names: of sources; without one, those of `USUAL`.
        kinds: of scenes; without one, all of them.

    Raises:
        ValueError: ``count`` below 1, an unknown source or kind, a detector that no source reads, or ``path`` holds
            rows over more scenes.
        OSError: a model cannot be loaded, or ``path`` cannot be written.
    """
    if count < 1:
        raise ValueError(f"scenes must be at least 1, got {count}")
    for kind in kinds:
        if kind not in scenes.WORLDS:
            raise ValueError(f"kinds must be of {', '.join(scenes.WORLDS)}, got {kind!r}")
    check_detector(names or USUAL, detector)
    rows = []
    for kind in kinds or scenes.WORLDS:
        of_kind = measure_kind(kind, split, names or USUAL, count, detector, clip_name)
        results.file_rows(of_kind, path, IDENTITY)
        rows += of_kind
    return rows


def described(rows: Sequence[dict]) -> str:
    """The rows as a table: the share in percent, its interval, and the median seconds from pictures to maps."""
    lines = [f"{'scenes':36}{'asked':8}{'source':26}{'peak on it':>12}{'95 % interval':>18}{'seconds':>9}"]
    for row in rows:
        low, high = row["ci95"]
        interval = f"[{low}, {high}]"
        lines.append(
            f"{row['task']:36}{row['subset']:8}{row['method']:26}{row['mean']:12.1f}{interval:>18}{row['seconds']:9.2f}"
        )
    return "\n".join(lines)
