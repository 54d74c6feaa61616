"""The pointing game (notebooks/pointing.py) in many scenes, with every kind of semantic map, and its rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
from pointing import MATCHED, NEAR, WIDE, AskedScene, Pointing, lay_out, lay_out_shapes, point, scene_of
from tqdm import tqdm

from gem_lite import clip, demonstrations, language, tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import results, statistics, workers
from gem_lite.evaluation.results import Episode
from gem_lite.foundations import colors
from gem_lite.maps import crop_memory, semantic_map
from gem_lite.maps.crop_memory import CropEntry, CropMemory
from gem_lite.maps.patches import embed_patches, top_grid
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies.gem_config import LITE
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.simulation.world import World

MAPS = ("fused", WIDE, "single-view", MATCHED, "image", "blended")
"""The text-conditioned maps of three views (the configuration's patches, and `WIDE`) and of the height map alone (its
own patches, and `MATCHED`), the image-conditioned one, and Eq. 4."""
FIRST_SCENE = 3000
"""Scene i comes from test seed ``FIRST_SCENE + i``: evaluations stay below, and calibration uses validation seeds."""
DEMONSTRATIONS = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
TRAINING_SCENES = 10
"""Scenes of shapes, in seen colours, whose pieces stand for ten demonstrations' picks."""
PACKING = ("packing-shapes-seen", "packing-shapes-unseen")
"""Tasks in whose episodes the map alone is measured like a method: what would it pick?"""
METHOD = "map-pointing"
"""The method's name in rows of what the map alone would pick (`measure_packing`)."""
IDENTITY = ("kind", "scenes", "map", "world", "clip_fingerprint", "config", "config_hash", "crops", "plateau")
"""The entries that identify a row of the results."""


def lay_out_packing(world: World, task_name: str, index: int) -> AskedScene:
    """Test episode ``index`` of one of the `PACKING` tasks, as it begins; its question is the pick's phrase."""
    task = tasks.make(task_name, "test")
    seed = tasks.episode_seed("test", index)
    views = world.reset(task, seed)[0].views
    phrase = language.parse(task.instruction).pick
    right_name = next(name for name in task.names.values() if name.lower().endswith(f" {phrase}"))
    return scene_of(world, seed, views, task.names, ((phrase, right_name),))


def play_packing(task_name: str, episodes: int, model: Clip) -> list[Episode]:
    """The first test episodes of a `PACKING` task with the text-conditioned map alone; the reward is 1 if it is near.

    `Pointing.exact` is not used: the table is seen in the middle of a ring.
    """
    episodes_played = []
    with World() as world:
        for index in tqdm(range(episodes), desc=f"pointing, {task_name}", unit="episode"):
            scene = lay_out_packing(world, task_name, index)
            question = scene.questions[0]
            embedding = semantic_map.embed_scene(scene.views, model, LITE)
            semantic = semantic_map.text_conditioned_map(embedding, question[0], model)
            pointing = point(semantic, "fused", scene, question)
            episodes_played.append(Episode(index, float(pointing.near), 0, ()))
    return episodes_played


def maps(
    embedding: SceneEmbedding, wide: SceneEmbedding, phrase: str, model: Clip, memory: CropMemory | None
) -> dict[str, np.ndarray]:
    """All `MAPS` (H, W) of a phrase by name; without "image" where retrieval finds no crop.

    Args:
        wide: the same scene in the paper's patches.
    """
    text = semantic_map.text_conditioned_map(embedding, phrase, model)
    image = semantic_map.image_conditioned_map(embedding, phrase, model, memory)
    grid = top_grid(LITE.ablated(f"with-{MATCHED}"))
    matched = replace(embedding, embed_top=partial(embed_patches, embedding.heightmap.rgb, grid, model))
    by_name = {
        "fused": text,
        WIDE: semantic_map.text_conditioned_map(wide, phrase, model),
        "single-view": semantic_map.single_view_map(embedding, phrase, model),
        MATCHED: semantic_map.single_view_map(matched, phrase, model),
        "image": image,
        "blended": semantic_map.fuse(text, image, LITE.text_weight, LITE.image_weight),
    }
    return {name: semantic for name, semantic in by_name.items() if semantic is not None}


def play_scene(scene: AskedScene, model: Clip, memory: CropMemory | None) -> list[Pointing]:
    """Let every map answer every question of a scene, which is embedded once for each size of patches."""
    embedding = semantic_map.embed_scene(scene.views, model, LITE)
    wide = semantic_map.embed_scene(scene.views, model, LITE.ablated(f"with-{WIDE}"))
    return [
        point(semantic, name, scene, question)
        for question in scene.questions
        for name, semantic in maps(embedding, wide, question[0], model, memory).items()
    ]


def scene_seeds(scenes: int) -> list[int]:
    """The seeds of the first ``scenes`` scenes, the same for both kinds."""
    return [tasks.episode_seed("test", FIRST_SCENE + index) for index in range(scenes)]


@dataclass(frozen=True)
class Job:
    """A few scenes for one process; see `play` for what the attributes mean. ``indices`` are the scenes' seeds."""

    kind: str
    indices: Sequence[int]
    clip_name: str | None
    memory: CropMemory | None


def run_job(job: Job) -> list[Pointing]:
    """The scenes of a job, one after the other in one world."""
    model = clip.load(job.clip_name)
    with World() as world:
        scenes = (lay_out(job.kind, world, seed) for seed in job.indices)
        return [pointing for scene in scenes for pointing in play_scene(scene, model, job.memory)]


def play(
    kind: str, scenes: int, memory: CropMemory | None, clip_name: str | None = None, processes: int | None = None
) -> list[Pointing]:
    """Play the first ``scenes`` scenes of a kind, one process a core.

    Args:
        memory: the crops that "image" and "blended" may search; None if there are none.
        clip_name: see `clip.load`; it must be the CLIP that embedded ``memory``.

    Raises:
        ChildProcessError: a process was killed, see `workers.run_jobs`.
    """
    _ = clip.load(clip_name).calibration  # Calibrated here, so that not every worker has to do it.
    seeds = scene_seeds(scenes)
    jobs = [Job(kind, [seeds[i] for i in chunk], clip_name, memory) for chunk in workers.chunks(0, scenes)]
    return workers.run_jobs(run_job, jobs, f"pointing, {kind}", lambda pointing: float(pointing.near), processes)


def demonstrated_crops(kind: str, model: Clip) -> CropMemory:
    """The crop memory for a kind of scene, from ten training episodes or scenes in the seen colours."""
    if kind == "bowls":
        demos = demonstrations.load(DEMONSTRATIONS)
        return CropMemory(crop_memory.collect_crops(demos, LITE.workspace, LITE.top_patch), model)
    entries = []
    with World() as world:
        for index in range(TRAINING_SCENES):
            scene = lay_out_shapes(world, tasks.episode_seed("train", index), colors.SEEN)
            heightmap = fuse_views(scene.views, LITE.workspace)
            entries += [
                CropEntry(scene.names[body], crop_memory.cut(heightmap, pose, LITE.top_patch), kind, index)
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


def measure_scenes(kind: str, scenes: int, path: Path, clip_name: str | None = None) -> list[dict]:
    """`play` scenes of a kind with every map, and file the rows in ``path``.

    Raises:
        ValueError: ``path`` holds a row over more episodes, which is checked before playing.
        OSError: ``path`` cannot be written, which is checked before playing, too.
        ChildProcessError: a process was killed; nothing is filed then.
    """
    model = clip.load(clip_name)
    memory = demonstrated_crops(kind, model)
    facts = {
        "world": "home", "clip": model.name, "clip_fingerprint": model.fingerprint, "config": LITE.name,
        "config_hash": LITE.digest, "crops": len(memory.entries), "plateau": semantic_map.PLATEAU,
    }  # fmt: skip
    expected = [{"kind": "pointing", "scenes": kind, "map": name, "episodes": scenes, **facts} for name in MAPS]
    results.check_rows(expected, path, IDENTITY)
    rows = result_rows(kind, play(kind, scenes, memory, clip_name), facts)
    results.file_rows(rows, path, IDENTITY)
    return rows


def measure_packing(task_name: str, episodes: int, path: Path, clip_name: str | None = None) -> dict:
    """`play_packing` and file its row in ``path``. Errors are those of `measure_scenes`."""
    model = clip.load(clip_name)
    facts = {**results.policy_entries(None, LITE), "clip": model.name, "clip_fingerprint": model.fingerprint}
    facts |= {"world": "home", "split": "test", "start": 0, "skipped": []}
    expected = {"method": METHOD, "task": task_name, "subset": "all", **facts, "episodes": episodes}
    results.check_rows([expected], path)
    row = results.result_row(METHOD, task_name, play_packing(task_name, episodes, model), "all", facts)
    results.file_rows([row], path)
    return row
