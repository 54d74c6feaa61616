"""How often does the peak of a map lie on the part that the words name? No policy takes part.

The scenes are those of pick-object-part-in-brown-box on the real table, and each episode asks for each part once. The
text-conditioned map sees the words alone, the image-conditioned map sees one crop of the part from another scene, where
the object has another colour and other proportions. The blend is Eq. 4 with the configuration's weights.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from tqdm import tqdm

from experiments.clip_tabletop.withheld import LISTS, NOTHING
from gem_lite import clip, language, tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import results
from gem_lite.language import ImageQuery
from gem_lite.maps import crop_memory, semantic_map
from gem_lite.policies.gem_config import GemConfig
from gem_lite.se2 import Workspace
from gem_lite.simulation import looks
from gem_lite.simulation.grips import Surfaces
from gem_lite.simulation.world import World
from gem_lite.tasks.task import Split

TASKS = ("pick-object-part-in-brown-box-seen", "pick-object-part-in-brown-box-unseen")
IDENTITY = ("kind", "task", "object", "part", "world", "clip_fingerprint", "config_hash")
"""The entries that identify a row of the results."""
MEANS = (
    "words_on_part", "words_on_object", "crop_on_part", "crop_on_object", "blend_on_part", "blend_on_object",
    "part_of_object",
)  # fmt: skip
"""Entries of a row: the shares of scenes where a map's peak is on the part or the object, and the part's share of the
object's area from above."""


@dataclass(frozen=True)
class AskedPart:
    """A scene, the part that its sentence names, and where this part is.

    Attributes:
        noun, part: what the sentence names.
        scene: its embedding.
        crop: (S, S, 3) uint8, the part as a demonstration shows it.
        on_object, on_part: (H, W) bool, the cells whose topmost point is the object's or the part's.
    """

    noun: str
    part: str
    scene: semantic_map.SceneEmbedding
    crop: np.ndarray
    on_object: np.ndarray
    on_part: np.ndarray

    @property
    def phrase(self) -> str:
        """What the maps are asked for."""
        return f"{self.noun} {self.part}"


def owners_from_above(surfaces: Surfaces, workspace: Workspace) -> np.ndarray:
    """(H, W): the number in ``surfaces.parts`` of each cell's topmost point, -1 where there is none."""
    rising = np.argsort(surfaces.points[:, 2])
    owners = np.full(workspace.shape, -1)
    # The last of several points in a cell stays.
    owners.flat[workspace.cells(surfaces.points[rising, 0], surfaces.points[rising, 1])] = surfaces.owners[rising]
    return owners


def peak_is_on(semantic: np.ndarray, cells: np.ndarray) -> bool:
    """Whether the peak of a map (H, W), or a cell beside it, is one of some ``cells`` (H, W) bool."""
    row, col = np.unravel_index(semantic.argmax(), semantic.shape)
    return bool(cells[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2].any())


def asked_parts(
    task_name: str, split: Split, episode: int, world_name: str, model: Clip, config: GemConfig
) -> Iterator[AskedPart]:
    """Every scene of one episode, as it begins."""
    task = tasks.make(task_name, split)
    with World(style=looks.style(world_name)) as world:
        (observation,) = world.reset(task, tasks.episode_seed(split, episode))
        for _ in tqdm(range(task.max_steps), f"{split} episode {episode}", unit="scene", leave=False):
            scene = semantic_map.embed_scene(observation.views, model, config)
            goal = task.goals[0]
            part = goal.metric.part
            crop = crop_memory.cut(scene.heightmap, task.expert(world).action.pick, config.top_patch).copy()
            surfaces = Surfaces.of(world.client, world.bodies)
            owners = owners_from_above(surfaces, config.workspace)
            of_object = [number for number, (body, _) in enumerate(surfaces.parts) if body is goal.bodies[0]]
            of_part = surfaces.parts.index((goal.bodies[0], part))
            noun = str(language.parse(goal.sentence).pick).removesuffix(f" {part}")
            yield AskedPart(noun, part, scene, crop, np.isin(owners, of_object), owners == of_part)
            task.advance(world)
            (observation,) = world.observe()


def measure_task(
    task_name: str, episodes: int, world_name: str, clip_name: str | None, maps: GemConfig
) -> list[dict]:  # fmt: skip
    """A row for each part of a task's objects, in ``episodes`` test scenes each; the crops are from validation."""
    model = clip.load(clip_name)
    task = tasks.make(task_name, "test")
    config = maps.for_table(task.workspace.limits, task.scale)
    crops = {asked.phrase: asked.crop for asked in asked_parts(task_name, "val", 0, world_name, model, config)}
    found = defaultdict(list)
    for episode in range(episodes):
        for asked in asked_parts(task_name, "test", episode, world_name, model, config):
            text = semantic_map.text_conditioned_map(asked.scene, asked.phrase, model)
            image = semantic_map.image_conditioned_map(asked.scene, ImageQuery(crops[asked.phrase]), model, None)
            blend = semantic_map.fuse(text, image, config.text_weight, config.image_weight)
            hits = [peak_is_on(seen, on) for seen in (text, image, blend) for on in (asked.on_part, asked.on_object)]
            found[asked.noun, asked.part].append((*hits, asked.on_part.sum() / asked.on_object.sum()))
    rows = []
    for (noun, part), shares in sorted(found.items()):
        means = dict(zip(MEANS, np.mean(shares, axis=0).round(4).tolist(), strict=True))
        rows.append({
            "kind": "part-peaks", "task": task_name, "object": noun, "part": part, "world": world_name,
            "clip": model.name, "clip_fingerprint": model.fingerprint, "config": config.name,
            "config_hash": config.digest, "top_patch": config.top_patch, "top_stride": config.top_stride,
            "text_weight": config.text_weight, "image_weight": config.image_weight, "episodes": episodes, **means,
            "date": datetime.now(UTC).date().isoformat(),
        })  # fmt: skip
    return rows


def measure(episodes: int, world_name: str, clip_name: str | None, maps: GemConfig, path: Path) -> list[dict]:
    """`measure_task` for seen and unseen objects; the rows are filed in ``path``.

    Args:
        maps: decides the crops, the patches and the weights of the blend.

    Raises:
        ValueError: ``episodes`` below 1, or ``path`` holds a row over more episodes.
        OSError: ``path`` cannot be written.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    rows = []
    for task_name in TASKS:
        of_task = measure_task(task_name, episodes, world_name, clip_name, maps)
        results.file_rows(of_task, path, IDENTITY)
        rows += of_task
    return rows


def described(rows: list[dict]) -> str:
    """The rows as a table in percent, then the means over the parts that each list withholds, and over the others.

    The last column is the part's share of the object's area.
    """
    heads = [name.split("_")[::2] for name in MEANS]
    lines = [" " * 42 + "".join(f"{word:>9}" for word in line) for line in zip(*heads, strict=True)]

    def add(title: str, chosen: list[dict]) -> None:
        values = [f"{100 * np.mean([row[name] for row in chosen]):9.0f}" for name in MEANS]
        lines.append(f"{title:42}{''.join(values)}")

    for row in rows:
        add(f"{row['object']} {row['part']}", [row])
    for withheld in LISTS.values():
        if withheld != NOTHING:
            for task_name in TASKS:
                for hidden in (False, True):
                    chosen = [
                        row for row in rows
                        if row["task"] == task_name and withheld.names(row["object"], row["part"]) == hidden
                    ]  # fmt: skip
                    state = "withheld" if hidden else "kept"
                    add(f"{withheld.name}, {task_name.rsplit('-', 1)[1]} objects, {state}: {len(chosen)} parts", chosen)
    return "\n".join(lines)
