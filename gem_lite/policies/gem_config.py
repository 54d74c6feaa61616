"""GEM's configuration: its numbers, their values in `lite` and `paper`, and its ablations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from gem_lite.config import (
    COUNT,
    FLAG,
    MULTI_TASK,
    SHARED_ABLATIONS,
    SHARED_ENDINGS,
    Ablation,
    Allowed,
    each,
    number,
    one_of,
    whole_number,
)
from gem_lite.maps import sources
from gem_lite.maps.query_maps import MapConfig

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
    "without-locations": Ablation("a location word chooses nothing on a map", {"locations": False}),
    "without-location-code": SHARED_ABLATIONS["without-location-code"],
    "without-peak": Ablation("a pick may lie anywhere, wherever its map is high", {"peak_margin": None}),
    "without-empty-spots": SHARED_ABLATIONS["without-empty-spots"],
}
"""Endings of GEM's name (A.2), in the order in which a name holds several.

Not in the paper: ``with-free-kernels``, a fairer rival of the steerable kernel; ``with-matched-single-view``, a fairer
rival of several views; ``keeps-own-crop``, which is what the paper's training does (A.3); and the endings that switch
off our additions: narrow patches, recolouring, map scaling, conjuncts, location words, empty spots."""


@dataclass(frozen=True)
class GemConfig(MapConfig):
    """GEM's numbers.

    Attributes:
        drop_image_map: how often training hides the image-conditioned map.
        own_crop: whether training may retrieve a crop of the step's own demonstration.
        map_gain, map_offset: training multiplies each semantic map by a factor in the range ``map_gain``, then adds an
            offset between minus and plus ``map_offset`` (`augment.rescaled`).
        recolor: whether training exchanges and scales the picture's colours (`augment.recolored`).
        rotations: n, into how many rotations a kernel is lifted.
        frequency: K, the largest Fourier frequency kept.
        kernel: h, side of the dynamic kernel (pixels, odd).
        crop: side of the place module's crop at the pick (pixels, odd).
        widths: channels of the U-Net's four levels.
        kernel_widths: channels of the language kernel generator's three levels.
        fields: regular fields of the place kernel generator's layers.
        channels: channels that features and kernels share.
        kernels: how one kernel becomes one for each angle.
        language_in_attention: whether the attention U-Nets get the words.
    """

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {
            **MapConfig.PRESETS["paper"], "frequency": 16, "kernel": 33, "crop": 33, "widths": (32, 64, 128, 256),
            "kernel_widths": (32, 64, 128), "fields": 16,
        },
    }  # fmt: skip
    ACTING: ClassVar[frozenset[str]] = MapConfig.ACTING | {"conjuncts", "locations", "peak_margin", "peak_radius"}
    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {**ABLATIONS, MULTI_TASK: SHARED_ENDINGS[MULTI_TASK]}
    AFTER_PREPARATION: ClassVar[frozenset[str]] = MapConfig.AFTER_PREPARATION | {
        "drop_image_map", "map_gain", "map_offset", "recolor", "rotations", "frequency",
        "kernel", "crop", "widths", "kernel_widths", "fields", "channels", "kernels", "language_in_attention",
    }  # fmt: skip
    ALLOWED: ClassVar[Mapping[str, Allowed]] = {
        **MapConfig.ALLOWED, "drop_image_map": number(0, 1), "own_crop": FLAG, "map_gain": each(number(0, 10), 2),
        "map_offset": number(0, 10), "recolor": FLAG, "rotations": COUNT, "frequency": whole_number(0),
        "kernel": whole_number(1, odd=True), "crop": whole_number(1, odd=True), "widths": each(COUNT, 4),
        "kernel_widths": each(COUNT, 3), "fields": COUNT, "channels": COUNT,
        "kernels": one_of(get_args(Kernels)), "language_in_attention": FLAG,
    }  # fmt: skip

    drop_image_map: float = 0.3
    own_crop: bool = False
    map_gain: tuple[float, float] = (0.5, 1.2)
    map_offset: float = 0.1
    recolor: bool = True
    rotations: int = 180
    frequency: int = 8
    kernel: int = 17
    crop: int = 17
    widths: tuple[int, ...] = (16, 24, 32, 48)
    kernel_widths: tuple[int, ...] = (32, 48, 64)
    fields: int = 6
    channels: int = 3
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
