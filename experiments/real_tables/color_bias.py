"""Do maps look for the colour or for the thing (A.4.1)? A dark screwdriver beside a bright block of the same colour.

The scenes lie on the real table: the screwdriver, the block, and two other objects of other colours, at random poses.
The same scenes are shown with the screwdriver's colour multiplied by each of `BRIGHTNESSES`. The sentence says "yellow
screwdriver". Who is at a map's peak? The maps see pictures and words only; the true cells only count.

The crop is what a demonstration would remember: a screwdriver of the same colour with other proportions, in another
scene, which has a block of this colour, too. In one demonstration it is as dark as in the scene, in another it is
bright.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from drawings import plot_real_table
from tqdm import tqdm
from typing_extensions import override

from experiments.clip_tabletop.part_peaks import owners_from_above, peak_is_on
from gem_lite import tasks
from gem_lite.clip import Clip
from gem_lite.evaluation import results
from gem_lite.foundations import colors
from gem_lite.language import ImageQuery
from gem_lite.maps import crop_memory, patches, semantic_map
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies.gem_config import GemConfig
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.simulation import looks
from gem_lite.simulation.bodies import objects, shapes
from gem_lite.simulation.environment import Environment
from gem_lite.simulation.grips import Surfaces
from gem_lite.simulation.world import World
from gem_lite.tasks import real_table
from gem_lite.tasks.goals import Goal
from gem_lite.tasks.pick_object_part import OBJECT_RADIUS
from gem_lite.tasks.spawn import FreeSpace, draw
from gem_lite.tasks.task import Task

NAMED_COLORS = ("yellow", "red", "blue", "green")
OTHER_COLORS = tuple(name for name in colors.RGB if name not in NAMED_COLORS)
BRIGHTNESSES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
"""Factors of the screwdriver's colour. The block's is 1."""
NOUN = "screwdriver"
OTHERS = 2
BLOCK = real_table.SCALE * shapes.BLOCK_SIZE
SIDES = (0.0625, 0.03)
"""Sides (m) of a crop, and of the patches that it is compared with; the first is the configuration's."""
SHOWN = ("dark", "bright")
"""The screwdriver of the demonstration: as dark as the scene's, or with the full colour."""
WEIGHTS = ((0.8, 0.2), (0.5, 0.5), (0.2, 0.8))
"""Weights of words and crop (Eq. 4); the first are the configuration's."""
WORLD = "real-table"
IDENTITY = ("kind", "method", "brightness", "world", "clip_fingerprint", "config_hash")
"""The entries that identify a row of the results."""
OUTCOMES = ("screwdriver", "block", "elsewhere")
PICTURED = (
    "words", "words without the color", "dark crop of 62.5 mm", "0.8 words + 0.2 dark crop of 62.5 mm",
    "dark crop of 30 mm", "0.8 words + 0.2 dark crop of 30 mm",
)  # fmt: skip
"""The maps of the picture."""


class ColorBias(Task):
    """A screwdriver, a block of the same colour, and two other objects. Nobody acts here, so there is no goal."""

    workspace = real_table.WORKSPACE
    scale = real_table.SCALE

    def __init__(self, color: str, brightness: float) -> None:
        super().__init__("test")
        self.color, self.brightness = color, brightness

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(real_table.AREA, rng, environment.style, real_table.GAP)
        red, green, blue, alpha = colors.rgba(self.color)
        dark = (red * self.brightness, green * self.brightness, blue * self.brightness, alpha)
        others = [name for name in objects.NAMES if name != NOUN]
        object_colors = [dark, *map(colors.rgba, draw(rng, OTHER_COLORS, OTHERS))]
        for name, rgba in zip((NOUN, *draw(rng, others, OTHERS)), object_colors, strict=True):
            variant = int(rng.integers(*objects.TEST_VARIANTS))
            pose = free.take(OBJECT_RADIUS)
            body = objects.add_object(environment.client, name, rgba, pose, variant, scale=self.scale)
            self.put(environment, body, name)
        pose = free.take(BLOCK / 2**0.5, BLOCK / 2)
        block = shapes.add_box(environment.client, (BLOCK,) * 3, (red, green, blue, alpha), pose)
        self.put(environment, block, "block")
        return []


@dataclass(frozen=True)
class Setting:
    """Which scene: the colour of screwdriver and block, the screwdriver's brightness, and the number of the layout."""

    color: str
    brightness: float
    index: int


@dataclass(frozen=True)
class Scene:
    """One scene as the maps see it, and where its two things of one colour are.

    Attributes:
        embedding: of the views.
        on_screwdriver, on_block, on_things: (H, W) bool, the cells whose topmost point is theirs, or any body's.
        maps: every map of the screwdriver, (H, W) float32, by its name.
    """

    embedding: SceneEmbedding
    on_screwdriver: np.ndarray
    on_block: np.ndarray
    on_things: np.ndarray
    maps: Mapping[str, np.ndarray]

    def of_things(self, name: str) -> np.ndarray:
        """A map (H, W) where something lies; minus infinity on the bare table, from which nothing can be picked."""
        return np.where(self.on_things, self.maps[name], -np.inf)

    def outcome(self, semantic: np.ndarray) -> str:
        """What is at the peak of a map (H, W), or beside it: one of `OUTCOMES`."""
        if peak_is_on(semantic, self.on_screwdriver):
            return "screwdriver"
        if peak_is_on(semantic, self.on_block):
            return "block"
        return "elsewhere"

    @property
    def bias(self) -> float:
        """How much higher the words' map is on the block than on the screwdriver."""
        words = self.maps["words"]
        return float(words[self.on_block].max() - words[self.on_screwdriver].max())


def demonstrated(world: World, setting: Setting, config: GemConfig) -> dict[float, np.ndarray]:
    """The crops (S, S, 3) uint8 of the screwdriver in a validation scene, by their sides (m)."""
    seed = tasks.episode_seed("val", setting.index)
    (observation,) = world.reset(ColorBias(setting.color, setting.brightness), seed)
    heightmap = fuse_views(observation.views, config.workspace)
    pose, _ = world.pose(world.bodies[0])
    return {side: crop_memory.cut(heightmap, pose, side).copy() for side in SIDES}


def look(
    world: World, setting: Setting, bright: Mapping[float, np.ndarray], model: Clip, config: GemConfig
) -> Scene:  # fmt: skip
    """Lay out a test scene, look at it, and make its maps.

    Args:
        bright: what is `demonstrated` of the bright screwdriver.
    """
    shown = {"dark": demonstrated(world, setting, config), "bright": bright}
    task = ColorBias(setting.color, setting.brightness)
    (observation,) = world.reset(task, tasks.episode_seed("test", setting.index))
    embedding = semantic_map.embed_scene(observation.views, model, config)
    surfaces = Surfaces.of(world.client, world.bodies)
    owners = owners_from_above(surfaces, config.workspace)
    names = np.array([*(task.names[body.id] for body, _ in surfaces.parts), ""])  # The last one is for -1: no body.
    maps = maps_of(embedding, setting.color, shown, model, config)
    return Scene(embedding, names[owners] == NOUN, names[owners] == "block", owners >= 0, maps)


def maps_of(
    embedding: SceneEmbedding, color: str, shown: Mapping[str, Mapping[float, np.ndarray]], model: Clip,
    config: GemConfig,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Every map of "``color`` screwdriver", (H, W) float32, by its name: of words, of crops, and their blends.

    Args:
        shown: the crops of each demonstration of `SHOWN` by their sides (m).
    """
    text = semantic_map.text_conditioned_map(embedding, f"{color} {NOUN}", model)
    maps = {"words": text, "words without the color": semantic_map.text_conditioned_map(embedding, NOUN, model)}
    for side in SIDES:
        grid = patches.top_grid(replace(config, top_patch=side, top_stride=side / 2))
        embed_top = partial(patches.embed_patches, embedding.heightmap.rgb, grid, model)
        cut = replace(embedding, embed_top=embed_top)
        for kind in SHOWN:
            image = semantic_map.image_conditioned_map(cut, ImageQuery(shown[kind][side]), model, None)
            name = f"{kind} crop of {1000 * side:g} mm"
            maps[name] = image
            for w1, w2 in WEIGHTS:
                maps[f"{w1:g} words + {w2:g} {name}"] = semantic_map.fuse(text, image, w1, w2)
    return maps


def configuration() -> GemConfig:
    """`lite` on the real table."""
    return GemConfig.preset("lite").for_table(real_table.WORKSPACE.limits, real_table.SCALE)


def measure(scenes: int, model: Clip, path: Path) -> tuple[list[dict], Setting]:
    """Look at ``scenes`` layouts in each colour and brightness.

    Returns:
        A row for each map and brightness, filed in ``path``; and the scene in which the words point at the block most
        clearly.

    Raises:
        ValueError: ``scenes`` below 1, or ``path`` holds rows over more scenes.
        OSError: ``path`` cannot be written.
    """
    if scenes < 1:
        raise ValueError(f"scenes must be at least 1, got {scenes}")
    config = configuration()
    layouts = [Setting(color, 1.0, index) for color in NAMED_COLORS for index in range(scenes)]
    outcomes: dict[tuple[str, float], dict[Setting, str]] = defaultdict(dict)
    peaks: dict[tuple[str, float], Counter[str]] = defaultdict(Counter)
    biases = {}
    with World(style=looks.style(WORLD)) as world:
        for layout in tqdm(layouts, "color-bias", unit="layout"):
            bright = demonstrated(world, layout, config)
            for brightness in BRIGHTNESSES:
                setting = replace(layout, brightness=brightness)
                scene = look(world, setting, bright, model, config)
                biases[setting] = scene.bias
                for name, semantic in scene.maps.items():
                    outcomes[name, brightness][setting] = scene.outcome(scene.of_things(name))
                    peaks[name, brightness][scene.outcome(semantic)] += 1
    rows = [
        row_of(name, brightness, of_scenes, peaks[name, brightness], model, config)
        for (name, brightness), of_scenes in outcomes.items()
    ]
    results.file_rows(rows, path, IDENTITY)
    return rows, max(biases, key=biases.__getitem__)


def row_of(
    name: str, brightness: float, outcomes: Mapping[Setting, str], peaks: Counter[str], model: Clip, config: GemConfig
) -> dict:
    """The row of a map at one brightness. Its mean is the share of scenes in which the screwdriver is the highest.

    ``on`` counts, for each colour, the things that are highest, in the order of `OUTCOMES`. ``peak_on`` counts what is
    at the peak of the whole map, which may lie on the bare table. A reward is the mean over the colours of one layout.
    """
    counts = {
        color: Counter(what for setting, what in outcomes.items() if setting.color == color) for color in NAMED_COLORS
    }
    rewards = defaultdict(list)
    for setting, what in outcomes.items():
        rewards[setting.index].append(float(what == NOUN))
    return {
        "kind": "color-bias", "method": name, "task": "color-bias", "subset": f"brightness {brightness:g}",
        "brightness": brightness, "world": WORLD, "clip": model.name, "clip_fingerprint": model.fingerprint,
        "config": config.name, "config_hash": config.digest,
        "on": {color: [count[what] for what in OUTCOMES] for color, count in counts.items()},
        "peak_on": [peaks[what] for what in OUTCOMES],
        **results.reward_entries({index: float(np.mean(values)) for index, values in rewards.items()}),
    }  # fmt: skip


def described(rows: list[dict]) -> str:
    """How often each of `OUTCOMES` is highest: a line for each map, a column for each brightness.

    The last lines are those of the words, colour by colour.
    """
    by_map: dict[str, dict[float, dict]] = defaultdict(dict)
    for row in rows:
        by_map[row["method"]][row["brightness"]] = row

    def line(title: str, cells: list) -> str:
        return f"{title:40}" + "".join(f"{'/'.join(map(str, cell)):>12}" for cell in cells)

    lines = [f"highest: {'/'.join(OUTCOMES)}", line("brightness of the screwdriver", [[b] for b in BRIGHTNESSES])]
    for name, of_map in by_map.items():
        lines.append(line(name, [np.sum(list(of_map[b]["on"].values()), axis=0) for b in BRIGHTNESSES]))
    for color in NAMED_COLORS:
        lines.append(line(f"words, {color}", [by_map["words"][b]["on"][color] for b in BRIGHTNESSES]))
    return "\n".join(lines)


def draw_scene(setting: Setting, model: Clip, path: Path) -> None:
    """Write a PNG of one scene and its maps."""
    config = configuration()
    with World(style=looks.style(WORLD)) as world:
        bright = demonstrated(world, replace(setting, brightness=1.0), config)
        scene = look(world, setting, bright, model, config)
    table = scene.embedding.heightmap.rgb
    panels = [(f"{setting.color} {NOUN},\nbrightness {setting.brightness:g}", table, None, None)]
    for name in PICTURED:
        highest = divmod(int(scene.of_things(name).argmax()), config.workspace.shape[1])
        panels.append((name.replace(" + ", "\n+ "), scene.maps[name], scene.on_screwdriver, highest))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = plot_real_table.show_maps(panels, columns=len(panels))
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)
