"""How large is a part's crop, and how much does it weigh beside the words? Measured on validation scenes, to choose.

A demonstration's crop is as wide as a patch of the height map (`top_patch`). `GemConfig`'s is wider than an object of
the real table, and shows a part with all that is around it.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from experiments.clip_tabletop import part_peaks
from gem_lite import clip, tasks
from gem_lite.evaluation import results
from gem_lite.language import ImageQuery
from gem_lite.maps import semantic_map
from gem_lite.policies.gem_config import GemConfig

TASK = "pick-object-part-in-brown-box-seen"
CROPS = (
    (0.0625, 2), (0.045, 2), (0.036, 2), (0.03, 2), (0.0225, 2), (0.015, 2), (0.036, 4), (0.03, 4), (0.0225, 4),
    (0.03, 8),
)  # fmt: skip
"""The width of a crop (m), and so many patches of the height map begin in one width. `GemConfig`'s on this table comes
first. 0.036 m is 40 pixels of the paper's picture of it."""
WEIGHTS = ((1.0, 0.0), (0.8, 0.2), (0.5, 0.5), (0.2, 0.8), (0.0, 1.0))
"""Of the text-conditioned and the image-conditioned map (Eq. 4). The paper's are 0.8 : 0.2 in its simulation, and 0.5 :
0.5 (A.1) or 0.2 : 0.8 (A.11) on its real tables."""
IDENTITY = ("kind", "task", "world", "clip_fingerprint", "top_patch", "top_stride", "text_weight", "image_weight")


def measure_crops(width: float, steps: int, episodes: int, world_name: str, clip_name: str | None) -> list[dict]:
    """A row for each of `WEIGHTS`; the crops are of validation episode 0, the scenes of those that follow."""
    model = clip.load(clip_name)
    task = tasks.make(TASK, "val")
    usual = GemConfig.preset("lite").for_table(task.workspace.limits, task.scale)
    config = replace(usual, top_patch=width, top_stride=width / steps)
    crops = {asked.phrase: asked.crop for asked in part_peaks.asked_parts(TASK, "val", 0, world_name, model, config)}
    hits = defaultdict(list)
    for episode in range(1, 1 + episodes):
        for asked in part_peaks.asked_parts(TASK, "val", episode, world_name, model, config):
            text = semantic_map.text_conditioned_map(asked.scene, asked.phrase, model)
            image = semantic_map.image_conditioned_map(asked.scene, ImageQuery(crops[asked.phrase]), model, None)
            for weights in WEIGHTS:
                fused = semantic_map.fuse(text, image, *weights)
                hits[weights].append([part_peaks.peak_is_on(fused, on) for on in (asked.on_part, asked.on_object)])
    rows = []
    for weights, of_weights in hits.items():
        on_part, on_object = np.mean(of_weights, axis=0).round(4).tolist()
        rows.append({
            "kind": "crop-search", "task": TASK, "split": "val", "world": world_name, "clip": model.name,
            "clip_fingerprint": model.fingerprint, "top_patch": width, "top_stride": width / steps,
            "text_weight": weights[0], "image_weight": weights[1], "episodes": episodes, "scenes": len(of_weights),
            "on_part": on_part, "on_object": on_object, "date": datetime.now(UTC).date().isoformat(),
        })  # fmt: skip
    return rows


def measure(episodes: int, world_name: str, clip_name: str | None, path: Path) -> list[dict]:
    """`measure_crops` for all `CROPS`; the rows are filed in ``path``.

    Raises:
        ValueError: ``episodes`` below 1, or ``path`` holds a row over more episodes.
        OSError: ``path`` cannot be written.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    rows = []
    for width, steps in CROPS:
        of_crops = measure_crops(width, steps, episodes, world_name, clip_name)
        results.file_rows(of_crops, path, IDENTITY)
        rows += of_crops
    return rows


def described(rows: list[dict]) -> str:
    """How often the peak is on the part (in brackets: on the object), in percent: crops down, weights across."""
    lines = ["width, step (mm)" + "".join(f"{text:7g}:{image:g}".ljust(14) for text, image in WEIGHTS)]
    for width, steps in CROPS:
        shares = [row for row in rows if (row["top_patch"], row["top_stride"]) == (width, width / steps)]
        cells = [f"{100 * row['on_part']:6.0f} ({100 * row['on_object']:.0f})".ljust(14) for row in shares]
        lines.append(f"{1000 * width:8g}{1000 * width / steps:8g}{''.join(cells)}")
    return "\n".join(lines)
