"""The pointing game: zero-shot, the centre of a map's highest plateau must lie on what the phrase names.

After Zhang et al., "Top-down Neural Attention by Excitation Backprop" (ECCV 2016). `pointing_scenes` lays out what
the maps are asked about.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import torch
from tqdm import tqdm

from gem_lite import clip, colors, demonstrations, tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import results, statistics
from gem_lite.evaluation.evaluate import CHUNK, Episode
from gem_lite.evaluation.pointing_scenes import (
    KINDS,
    PACKING,
    Scene,
    check_kind,
    lay_out,
    lay_out_packing,
    lay_out_shapes,
    scene_seeds,
)
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
"""A map that points at most this far (metres, in x and y) from a right body's centre is near it: half a block."""
NEAR = f"within_{1000 * RADIUS:.0f}mm"
DEMONSTRATIONS = clip.DATA / "demos" / "put-block-in-bowl-seen-colors-10"
TRAINING_SCENES = 10
"""Scenes of shapes, in seen colours, whose pieces stand for ten demonstrations' picks."""
METHOD = "map-pointing"
"""The name of those rows."""
IDENTITY = ("kind", "scenes", "map", "world", "clip_fingerprint", "config", "config_hash", "crops", "plateau")
"""What names a row of the results."""


@dataclass(frozen=True)
class Pointing:
    """Where one map pointed for one phrase.

    Attributes:
        row, col: the plateau's centre, in cells.
        distance: metres, in x and y, from there to the nearest right body's centre.
        shown: the name of the body seen from above there, or "table".
        exact: whether that is a right body.
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
    """Where the text-conditioned map alone points in the first test episodes; 1 if within `RADIUS`, else 0.

    Not `Pointing.exact`: in the middle of a ring lies the table.

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
            episodes_played.append(
                Episode(index, float(point(semantic, "fused", scene, question, settings).near), 0, ())
            )
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
    """Where a map (H, W) points, scored against the scene's truth; ``name`` is the map's."""
    phrase, wanted = question
    row, col = semantic_map.plateau_centre(semantic, settings)
    x, y = settings.workspace.to_world(row, col)
    distance = min(float(np.hypot(x - pose.x, y - pose.y)) for pose in scene.right(wanted))
    shown = scene.names.get(int(scene.above[settings.workspace.nearest_cell(x, y)]), "table")
    return Pointing(scene.seed, phrase, name, row, col, distance, shown, shown == wanted)


def play_scene(scene: Scene, model: Clip, memory: CropMemory | None, settings: GemConfig = LITE) -> list[Pointing]:
    """Let every map answer every question of a scene, which is embedded once for each size of patches."""
    embedding = semantic_map.embed_scene(scene.views, model, settings)
    wide = embed_wide(scene.views, model, settings)
    return [
        point(semantic, name, scene, question, settings)
        for question in scene.questions
        for name, semantic in maps(embedding, wide, question[0], model, memory, settings).items()
    ]


def _run_chunk(chunk: tuple[str, list[int], str | None, CropMemory | None, GemConfig]) -> list[Pointing]:
    kind, seeds, clip_name, memory, settings = chunk
    torch.set_num_threads(1)
    model = clip.load(clip_name)
    with World() as world:
        return [
            pointing
            for seed in seeds
            for pointing in play_scene(lay_out(kind, world, seed, settings), model, memory, settings)
        ]


def play(
    kind: str, scenes: int, memory: CropMemory | None, clip_name: str | None = None,
    settings: GemConfig = LITE, processes: int | None = None,
) -> list[Pointing]:  # fmt: skip
    """Play the first ``scenes`` scenes of a kind, one process a core.

    Args:
        memory: the crops that "image" and "blended" may search; None means there are none.
        clip_name: as `clip.load` takes it, the CLIP that embedded ``memory``.

    Raises:
        ValueError: an unknown kind, or less than one scene.
    """
    check_kind(kind)
    seeds = scene_seeds(scenes)
    _ = clip.load(clip_name).calibration  # Measured here, if it must be, and not by every worker.
    chunks = [(kind, seeds[i : i + CHUNK], clip_name, memory, settings) for i in range(0, scenes, CHUNK)]
    found: list[Pointing] = []
    with (
        multiprocessing.get_context("spawn").Pool(min(processes or os.cpu_count() or 1, len(chunks))) as pool,
        tqdm(total=scenes, desc=f"pointing, {kind}", unit="scene") as bar,
    ):
        for chunk, part in zip(chunks, pool.imap(_run_chunk, chunks), strict=True):
            found += part
            bar.update(len(chunk[1]))
    return found


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


def rate(found: Sequence[Pointing], hit: Callable[[Pointing], bool]) -> dict | None:
    """Percent of hits with their 95 % interval over scenes (`statistics.mean_and_interval`); None without any pointing.

    A scene counts as the mean of its phrases. ``by_scene`` holds it by the scene's seed.
    """
    scenes = defaultdict(list)
    for pointing in found:
        scenes[pointing.seed].append(hit(pointing))
    if not scenes:
        return None
    shares = {seed: float(np.mean(hits)) for seed, hits in scenes.items()}
    mean, interval = statistics.mean_and_interval(list(shares.values()))
    by_scene = {str(seed): round(share, 4) for seed, share in shares.items()}
    return {"mean": mean, "ci95": list(interval), "interval": statistics.INTERVAL, "by_scene": by_scene}


def result_rows(kind: str, found: Sequence[Pointing], facts: dict) -> list[dict]:
    """One row of the results per map.

    ``without_crop`` counts phrases for which there is no such map; the fused map's ``missed`` lists the
    (seed, phrase) that it was not near; ``episodes`` counts all scenes, ``scene_count`` those that the map answered.
    """
    asked, seeds = len({(p.seed, p.phrase) for p in found}), [p.seed for p in found]
    rows = []
    for name in MAPS:
        its = [p for p in found if p.map == name]
        rows.append({
            "kind": "pointing", "scenes": kind, "map": name,
            NEAR: rate(its, lambda p: p.near), "exact": rate(its, lambda p: p.exact),
            "episodes": len(set(seeds)), "scene_count": len({p.seed for p in its}),
            "phrases": len(its), "without_crop": asked - len(its),
            "missed": [[p.seed, p.phrase] for p in its if not p.near] if name == "fused" else None,
            "seeds": [min(seeds), max(seeds)], **facts, "plateau": semantic_map.PLATEAU,
            "date": datetime.now(UTC).date().isoformat(),
        })  # fmt: skip
    return rows


def main() -> None:
    """Command line: see ``python -m gem_lite.evaluation.pointing --help``."""
    parser = argparse.ArgumentParser(
        description="Play the pointing game with every kind of semantic map; prints and writes one row a map.",
        epilog="examples:\n  python -m gem_lite.evaluation.pointing --scenes 200 --kind shapes"
        "\n  python -m gem_lite.evaluation.pointing --scenes 100 --task packing-shapes-unseen",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scenes", type=int, default=200, help="how many scenes of a kind (default 200)")
    parser.add_argument("--kind", choices=KINDS, help="which scenes (default: both kinds)")
    parser.add_argument("--clip", help="Hugging Face name or folder of a CLIP (default: the embedded one)")
    parser.add_argument("--task", choices=PACKING, help="instead: the test episodes of this task, text map alone")
    results.add_output(parser)
    args = parser.parse_args()
    settings = LITE
    try:
        scene_seeds(args.scenes)
        model = clip.load(args.clip)
        facts = {**results.facts_of(None, settings), "clip": model.name, "clip_fingerprint": model.fingerprint}
        facts |= {"world": "home"}
        if args.task:
            out = results.output(args, results.family(args.task))
            facts |= {"split": "test", "start": 0}
            expected = {"method": METHOD, "task": args.task, "subset": "all", **facts, "episodes": args.scenes}
            results.check_rows([expected], out)
            found = play_packing(args.task, args.scenes, model, settings)
            row = results.result_row(METHOD, args.task, found, "all", facts)
            results.file_rows([row], out)
            print("the map points at the named piece of {task}: {mean} {ci95}, {episodes} episodes".format(**row))
            print(f"the row is in {out}")
            return
        out = results.output(args, "pointing")
        facts = {name: facts[name] for name in ("world", "clip", "clip_fingerprint", "config", "config_hash")}
        for kind in [args.kind] if args.kind else KINDS:
            memory = demonstrated_crops(kind, model, settings)
            found = play(kind, args.scenes, memory, args.clip, settings)
            rows = result_rows(kind, found, {**facts, "crops": len(memory.entries)})
            results.file_rows(rows, out, IDENTITY)
            for row in rows:
                rates = (row[key] and "{mean} {ci95}".format(**row[key]) for key in (NEAR, "exact"))
                print("{scenes}, {map}: near {}, exact {}, {phrases} phrases".format(*rates, **row), end=", ")
                print("{without_crop} more had no crop".format(**row))
        print(f"the rows are in {out}")
    except (OSError, ValueError) as error:
        parser.exit(2, f"{error}\n")


if __name__ == "__main__":
    main()
