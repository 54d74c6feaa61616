"""The pointing game: the centre of a map's highest plateau must lie on the thing that the phrase names.

Nothing is trained for it. It follows Zhang et al., "Top-down Neural Attention by Excitation Backprop" (ECCV 2016).
`pointing_scenes` makes the scenes and their phrases.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from tqdm import tqdm

from gem_lite import clip, colors, demonstrations, tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import results, statistics, workers
from gem_lite.evaluation.pointing_scenes import (
    PACKING,
    Scene,
    check_kind,
    lay_out,
    lay_out_packing,
    lay_out_shapes,
    scene_seeds,
)
from gem_lite.evaluation.results import Episode
from gem_lite.evaluation.workers import CHUNK
from gem_lite.maps import crop_memory, semantic_map
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies.gem_config import LITE, GemConfig
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.simulation.world import World

MATCHED = "matched-single-view"
"""A map from patches of the height map that are as wide as those of `WIDE` are on the table, on average."""
WIDE = "wide-patches"
"""A map of three views like "fused", from the paper's patches of 40 pixels (`embed_wide`)."""
MAPS = ("fused", WIDE, "single-view", MATCHED, "image", "blended")
"""The text-conditioned maps of three views (the configuration's patches, and `WIDE`) and of the height map alone (its
own patches, and `MATCHED`), the image-conditioned one, and Eq. 4."""
RADIUS = 0.02
"""A map is near a right body if it points at most this far (m, in x and y) from its centre: half a block."""
NEAR = f"within_{1000 * RADIUS:.0f}mm"
DEMONSTRATIONS = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
TRAINING_SCENES = 10
"""Scenes of shapes, in seen colours, whose pieces stand for ten demonstrations' picks."""
METHOD = "map-pointing"
"""The method's name in rows of what the map alone would pick (`measure_packing`)."""
IDENTITY = ("kind", "scenes", "map", "world", "clip_fingerprint", "config", "config_hash", "crops", "plateau")
"""The entries that identify a row of the results."""


@dataclass(frozen=True)
class Pointing:
    """The point at which one map pointed for one phrase.

    Attributes:
        row, col: the plateau's centre, in cells.
        distance: metres, in x and y, from that point to the nearest right body's centre.
        shown: the name of the body that is seen from above at that point, or "table".
        exact: whether it is a right body.
    """

    seed: int
    phrase: str
    map: str
    row: float
    col: float
    distance: float
    shown: str
    exact: bool

    @property
    def near(self) -> bool:
        """Whether a right body's centre lies within `RADIUS`."""
        return self.distance <= RADIUS


def play_packing(task_name: str, episodes: int, model: Clip, settings: GemConfig = LITE) -> list[Episode]:
    """The first test episodes with the text-conditioned map alone; the reward is 1 if it is near (`RADIUS`), else 0.

    `Pointing.exact` is not used: the table is seen in the middle of a ring.

    Raises:
        ValueError: another task, or less than one episode.
    """
    if task_name not in PACKING or episodes < 1:
        raise ValueError(f"needs one of {', '.join(PACKING)} and at least 1 episode, got {task_name!r}, {episodes}")
    episodes_played = []
    with World() as world:
        for index in tqdm(range(episodes), desc=f"pointing, {task_name}", unit="episode"):
            scene = lay_out_packing(world, task_name, index, settings)
            question = scene.questions[0]
            embedding = semantic_map.embed_scene(scene.views, model, settings)
            semantic = semantic_map.text_conditioned_map(embedding, question[0], model)
            pointing = point(semantic, "fused", scene, question, settings)
            episodes_played.append(Episode(index, float(pointing.near), 0, ()))
    return episodes_played


def embed_wide(views: Sequence[View], model: Clip, settings: GemConfig = LITE) -> SceneEmbedding:
    """A scene's side views in the paper's patches."""
    return semantic_map.embed_scene(views, model, settings.ablated(f"with-{WIDE}"))


def maps(
    embedding: SceneEmbedding, wide: SceneEmbedding, phrase: str, model: Clip, memory: CropMemory | None,
    settings: GemConfig = LITE,
) -> dict[str, np.ndarray]:  # fmt: skip
    """All `MAPS` (H, W) of a phrase by name; without "image" where retrieval finds no crop.

    Args:
        wide: the same scene by `embed_wide`.
    """
    text = semantic_map.text_conditioned_map(embedding, phrase, model)
    image = semantic_map.image_conditioned_map(embedding, phrase, model, memory)
    matched = semantic_map.with_top_patches(embedding, model, settings.ablated(f"with-{MATCHED}"))
    by_name = {
        "fused": text,
        WIDE: semantic_map.text_conditioned_map(wide, phrase, model),
        "single-view": semantic_map.single_view_map(embedding, phrase, model),
        MATCHED: semantic_map.single_view_map(matched, phrase, model),
        "image": image,
        "blended": semantic_map.fuse(text, image, settings.text_weight, settings.image_weight),
    }
    return {name: semantic for name, semantic in by_name.items() if semantic is not None}


def point(
    semantic: np.ndarray, name: str, scene: Scene, question: tuple[str, str], settings: GemConfig = LITE
) -> Pointing:
    """The point at which a map (H, W) points, scored against the scene's truth; ``name`` is the map's."""
    phrase, right_name = question
    row, col = semantic_map.plateau_centre(semantic, settings)
    x, y = settings.workspace.to_world(row, col)
    distance = min(float(np.hypot(x - pose.x, y - pose.y)) for pose in scene.poses_of(right_name))
    shown = scene.names.get(int(scene.above[settings.workspace.nearest_cell(x, y)]), "table")
    return Pointing(scene.seed, phrase, name, row, col, distance, shown, shown == right_name)


def play_scene(scene: Scene, model: Clip, memory: CropMemory | None, settings: GemConfig = LITE) -> list[Pointing]:
    """Let every map answer every question of a scene, which is embedded once for each size of patches."""
    embedding = semantic_map.embed_scene(scene.views, model, settings)
    wide = embed_wide(scene.views, model, settings)
    return [
        point(semantic, name, scene, question, settings)
        for question in scene.questions
        for name, semantic in maps(embedding, wide, question[0], model, memory, settings).items()
    ]


@dataclass(frozen=True)
class Job:
    """A few scenes for one process; see `play` for what the attributes mean. ``indices`` are the scenes' seeds."""

    kind: str
    indices: Sequence[int]
    clip_name: str | None
    memory: CropMemory | None
    settings: GemConfig


def run_job(job: Job) -> list[Pointing]:
    """The scenes of a job, one after the other in one world."""
    model = clip.load(job.clip_name)
    with World() as world:
        return [
            pointing
            for seed in job.indices
            for pointing in play_scene(lay_out(job.kind, world, seed, job.settings), model, job.memory, job.settings)
        ]


def play(
    kind: str, scenes: int, memory: CropMemory | None, clip_name: str | None = None,
    settings: GemConfig = LITE, processes: int | None = None,
) -> list[Pointing]:  # fmt: skip
    """Play the first ``scenes`` scenes of a kind, one process a core.

    Args:
        memory: the crops that "image" and "blended" may search; None if there are none.
        clip_name: see `clip.load`; it must be the CLIP that embedded ``memory``.

    Raises:
        ValueError: an unknown kind, or less than one scene.
        ChildProcessError: a process was killed, see `workers.run_jobs`.
    """
    check_kind(kind)
    seeds = scene_seeds(scenes)
    _ = clip.load(clip_name).calibration  # Calibrated here, so that not every worker has to do it.
    jobs = [Job(kind, seeds[i : i + CHUNK], clip_name, memory, settings) for i in range(0, scenes, CHUNK)]
    return workers.run_jobs(run_job, jobs, lambda pointing: float(pointing.near), f"pointing, {kind}", processes)


def demonstrated_crops(kind: str, model: Clip, settings: GemConfig = LITE) -> CropMemory:
    """The crop memory for a kind of scene, from ten training episodes or scenes in the seen colours."""
    check_kind(kind)
    if kind == "bowls":
        demos = demonstrations.load(DEMONSTRATIONS)
        return CropMemory(crop_memory.demonstrated_crops(demos, settings.workspace, settings.top_patch), model)
    entries = []
    with World() as world:
        for index in range(TRAINING_SCENES):
            scene = lay_out_shapes(world, tasks.episode_seed("train", index), settings, colors.SEEN)
            heightmap = fuse_views(scene.views, settings.workspace)
            entries += [
                CropEntry(scene.names[body], crop_memory.cut(heightmap, pose, settings.top_patch), kind, index)
                for body, pose in scene.poses.items()
            ]
    return CropMemory(entries, model)


def rate(pointings: Sequence[Pointing], hit: Callable[[Pointing], bool]) -> dict | None:
    """Percent of hits with their 95 % interval over scenes (`statistics.mean_and_interval`); None without any pointing.

    A scene counts as the mean of its phrases; ``by_scene`` holds this mean by the scene's seed.
    """
    scenes = defaultdict(list)
    for pointing in pointings:
        scenes[pointing.seed].append(hit(pointing))
    if not scenes:
        return None
    shares = {seed: float(np.mean(hits)) for seed, hits in scenes.items()}
    mean, interval = statistics.mean_and_interval(list(shares.values()))
    by_scene = {str(seed): round(share, 4) for seed, share in shares.items()}
    return {"mean": mean, "ci95": list(interval), "interval": statistics.INTERVAL, "by_scene": by_scene}


def result_rows(kind: str, pointings: Sequence[Pointing], facts: dict) -> list[dict]:
    """One row of the results for each map.

    ``without_crop`` counts the phrases for which there is no such map. ``missed``, for the fused map, lists each
    (seed, phrase) that it was not near. ``episodes`` counts all scenes, ``scene_count`` those with a map.
    """
    phrase_count = len({(p.seed, p.phrase) for p in pointings})
    seeds = [p.seed for p in pointings]
    rows = []
    for name in MAPS:
        of_map = [p for p in pointings if p.map == name]
        rows.append({
            "kind": "pointing", "scenes": kind, "map": name,
            NEAR: rate(of_map, lambda p: p.near), "exact": rate(of_map, lambda p: p.exact),
            "episodes": len(set(seeds)), "scene_count": len({p.seed for p in of_map}),
            "phrases": len(of_map), "without_crop": phrase_count - len(of_map),
            "missed": [[p.seed, p.phrase] for p in of_map if not p.near] if name == "fused" else None,
            "seeds": [min(seeds), max(seeds)], "plateau": semantic_map.PLATEAU, **facts,
            "date": datetime.now(UTC).date().isoformat(),
        })  # fmt: skip
    return rows


def measure_scenes(
    kind: str, scenes: int, path: Path, clip_name: str | None = None, settings: GemConfig = LITE
) -> list[dict]:
    """`play` scenes of a kind with every map, and file the rows in ``path``.

    Raises:
        ValueError: see `play`, or ``path`` holds a row over more episodes, which is checked before playing.
        OSError: ``path`` cannot be written, which is checked before playing, too.
        ChildProcessError: a process was killed; nothing is filed then.
    """
    scene_seeds(scenes)
    model = clip.load(clip_name)
    memory = demonstrated_crops(kind, model, settings)
    facts = results.facts_of(None, settings)
    facts = {
        "world": "home", "clip": model.name, "clip_fingerprint": model.fingerprint, "config": facts["config"],
        "config_hash": facts["config_hash"], "crops": len(memory.entries), "plateau": semantic_map.PLATEAU,
    }  # fmt: skip
    expected = [{"kind": "pointing", "scenes": kind, "map": name, "episodes": scenes, **facts} for name in MAPS]
    results.check_rows(expected, path, IDENTITY)
    rows = result_rows(kind, play(kind, scenes, memory, clip_name, settings), facts)
    results.file_rows(rows, path, IDENTITY)
    return rows


def measure_packing(
    task_name: str, episodes: int, path: Path, clip_name: str | None = None, settings: GemConfig = LITE
) -> dict:
    """`play_packing` and file its row in ``path``.

    Raises:
        ValueError: see `play_packing`, or ``path`` holds a row over more episodes, which is checked before playing.
        OSError: ``path`` cannot be written, which is checked before playing, too.
    """
    model = clip.load(clip_name)
    facts = {**results.facts_of(None, settings), "clip": model.name, "clip_fingerprint": model.fingerprint}
    facts |= {"world": "home", "split": "test", "start": 0, "skipped": []}
    expected = {"method": METHOD, "task": task_name, "subset": "all", **facts, "episodes": episodes}
    results.check_rows([expected], path)
    row = results.result_row(METHOD, task_name, play_packing(task_name, episodes, model, settings), "all", facts)
    results.file_rows([row], path)
    return row
