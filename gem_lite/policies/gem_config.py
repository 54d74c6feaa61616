"""GEM's configuration: its numbers, their values in `lite` and `paper`, and its ablations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from gem_lite.config import (
    COUNT,
    FLAG,
    MULTI_TASK,
    RADIUS,
    SHARED_ABLATIONS,
    SHARED_ENDINGS,
    TEXT,
    Ablation,
    Allowed,
    each,
    number,
    one_of,
    or_none,
    whole_number,
)
from gem_lite.maps import sources
from gem_lite.maps.patches import PatchConfig

Kernels = Literal["steerable", "unrotated", "free"]

ABLATIONS = {
    "without-semantic-map": Ablation("the map is 1 everywhere", {"semantic_map": "none"}),
    "with-single-view": Ablation("the text map comes from the height map's patches", {"semantic_map": "single-view"}),
    "without-steerable-kernel": Ablation("one unrotated kernel for all angles", {"kernels": "unrotated"}),
    "with-free-kernels": Ablation("a kernel of its own for each angle, not tied by rotation", {"kernels": "free"}),
    "without-image-map": Ablation("no image-conditioned map", {"image_weight": 0.0}),
    "with-wide-patches": Ablation(
        "side views are cut into the paper's patches, twice as wide", {"patch": 40, "stride": 20}
    ),
    "without-recoloring": Ablation("training shows the colours as they are", {"recolor": False}),
    "without-parsing": SHARED_ABLATIONS["without-parsing"],
    "without-language-in-attention": Ablation("the attention U-Nets see no language", {"language_in_attention": False}),
    "with-matched-single-view": Ablation(
        "one view with patches of 87.5 mm: the paper's side-view patches have that width on the table",
        {"semantic_map": "single-view", "top_patch": 0.0875, "top_stride": 0.04375},
    ),
    "keeps-own-crop": Ablation("a step's own demonstration may answer its phrase in training", {"own_crop": True}),
    "without-rotation-augmentation": SHARED_ABLATIONS["without-rotation-augmentation"],
    "without-map-scaling": Ablation("training shows the maps as they are", {"map_gain": (1.0, 1.0), "map_offset": 0.0}),
    "without-conjuncts": Ablation('a phrase with "and" is one phrase', {"conjuncts": False}),
    "without-locations": SHARED_ABLATIONS["without-locations"],
    "without-peak": Ablation("a pick may lie anywhere, wherever its map is high", {"peak_margin": None}),
    "without-empty-spots": SHARED_ABLATIONS["without-empty-spots"],
}
"""Endings of GEM's name (A.2), in the order in which a name holds several.

Not in the paper: ``with-free-kernels``, a fairer rival of the steerable kernel; ``with-matched-single-view``, a fairer
rival of several views; ``keeps-own-crop``, which is what the paper's training does (A.3); and the endings that switch
off our additions: narrow patches, recolouring, map scaling, conjuncts, location words, empty spots."""


@dataclass(frozen=True)
class GemConfig(PatchConfig):
    """GEM's numbers.

    Attributes:
        text_weight, image_weight: w1 and w2 of Eq. 4.
        drop_image_map: how often training hides the image-conditioned map.
        own_crop: whether training may retrieve a crop of the step's own demonstration.
        conjuncts: whether "green and blue blocks" is two phrases, whose maps are joined.
        map_gain, map_offset: training multiplies each semantic map by a factor in the range ``map_gain``, then adds an
            offset between minus and plus ``map_offset`` (`augment.rescaled`).
        recolor: whether training exchanges and scales the picture's colours (`augment.recolored`).
        peak_margin, peak_radius: a pick lies at most ``peak_radius`` (m) from a cell where its map is at most
            ``peak_margin`` below its highest value; with a margin of None it may lie anywhere.
        rotations: n, into how many rotations a kernel is lifted.
        frequency: K, the largest Fourier frequency kept.
        kernel: h, side of the dynamic kernel (pixels, odd).
        crop: side of the place module's crop at the pick (pixels, odd).
        widths: channels of the U-Net's four levels.
        kernel_widths: channels of the language kernel generator's three levels.
        fields: regular fields of the place kernel generator's layers.
        channels: channels that features and kernels share.
        semantic_map: the name of a registered map source (`gem_lite.maps.sources`).
        kernels: how one kernel becomes one for each angle.
        language_in_attention: whether the attention U-Nets get the words.
    """

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {
            **PatchConfig.PRESETS["paper"], "frequency": 16, "kernel": 33, "crop": 33, "widths": (32, 64, 128, 256),
            "kernel_widths": (32, 64, 128), "fields": 16,
        },
    }  # fmt: skip
    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {**ABLATIONS, MULTI_TASK: SHARED_ENDINGS[MULTI_TASK]}
    AFTER_PREPARATION: ClassVar[frozenset[str]] = PatchConfig.AFTER_PREPARATION | {
        "drop_image_map", "map_gain", "map_offset", "recolor", "peak_margin", "peak_radius", "rotations", "frequency",
        "kernel", "crop", "widths", "kernel_widths", "fields", "channels", "kernels", "language_in_attention",
    }  # fmt: skip
    ALLOWED: ClassVar[Mapping[str, Allowed]] = {
        **PatchConfig.ALLOWED,
        "text_weight": number(0, 10), "image_weight": number(0, 10), "drop_image_map": number(0, 1), "own_crop": FLAG,
        "conjuncts": FLAG, "map_gain": each(number(0, 10), 2), "map_offset": number(0, 10), "recolor": FLAG,
        "peak_margin": or_none(number(0, 10)), "peak_radius": RADIUS, "rotations": COUNT, "frequency": whole_number(0),
        "kernel": whole_number(1, odd=True), "crop": whole_number(1, odd=True), "widths": each(COUNT, 4),
        "kernel_widths": each(COUNT, 3), "fields": COUNT, "channels": COUNT, "semantic_map": TEXT,
        "kernels": one_of(get_args(Kernels)), "language_in_attention": FLAG,
    }  # fmt: skip

    text_weight: float = 0.8
    image_weight: float = 0.2
    drop_image_map: float = 0.3
    own_crop: bool = False
    conjuncts: bool = True
    map_gain: tuple[float, float] = (0.5, 1.2)
    map_offset: float = 0.1
    recolor: bool = True
    peak_margin: float | None = 0.1
    peak_radius: float = 0.0125
    rotations: int = 180
    frequency: int = 8
    kernel: int = 17
    crop: int = 17
    widths: tuple[int, ...] = (16, 24, 32, 48)
    kernel_widths: tuple[int, ...] = (32, 48, 64)
    fields: int = 6
    channels: int = 3
    semantic_map: str = "multi-view"
    kernels: Kernels = "steerable"
    language_in_attention: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        sources.SOURCES.find(self.semantic_map)
        if 2 * self.frequency >= self.rotations:
            raise ValueError(
                f"frequency must be below half of rotations, which is {self.rotations / 2:g}, got {self.frequency}"
            )
        if self.map_gain[0] > self.map_gain[1]:
            raise ValueError(f"map_gain must go from a smaller number to a larger one, got {self.map_gain}")


LITE = GemConfig.preset("lite")
PAPER = GemConfig.preset("paper")
