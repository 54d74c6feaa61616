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
    Ablation,
    Allowed,
    Config,
    InputConfig,
    each,
    entry,
    number,
    or_none,
    whole_number,
)
from gem_lite.maps import detectors, regions, sources  # noqa: F401 (the first two register sources)
from gem_lite.maps.query_maps import MapConfig

Kernels = Literal["steerable", "unrotated", "free"]
Encoder = Literal["plain", "modulated", "steerable"]
ENCODERS = Allowed(f"one of {', '.join(get_args(Encoder))}", lambda value: value in get_args(Encoder))
KERNELS = Allowed(f"one of {', '.join(get_args(Kernels))}", lambda value: value in get_args(Kernels))

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
    "with-modulated-encoder": Ablation(
        "words scale and shift every level of the attention U-Nets' decoders", {"encoder": "modulated"}
    ),
    "with-steerable-encoder": Ablation(
        "as with-modulated-encoder, and all features commute with rotations", {"encoder": "steerable"}
    ),
    "with-matched-single-view": Ablation(
        "one view with patches of 87.5 mm: the paper's side-view patches have that width on the table",
        {"semantic_map": "single-view", "top_patch": 0.0875, "top_stride": 0.04375},
    ),
    "with-part-crops": Ablation(
        "crops of 30 mm, as wide as a part on the real tables, and a patch every 7.5 mm",
        {"top_patch": 0.03, "top_stride": 0.0075},
    ),
    "with-dense-map": Ablation("each view is embedded in one pass, not patch by patch", {"semantic_map": "dense"}),
    "with-region-map": Ablation("each thing is one picture, as for a detector", {"semantic_map": "regions"}),
    "keeps-own-crop": Ablation("a step's own demonstration may answer its phrase in training", {"own_crop": True}),
    "without-rotation-augmentation": SHARED_ABLATIONS["without-rotation-augmentation"],
    "without-map-scaling": Ablation("training shows the maps as they are", {"map_gain": (1.0, 1.0), "map_offset": 0.0}),
    "without-conjuncts": Ablation('a phrase with "and" is one phrase', {"conjuncts": False}),
    "without-locations": Ablation("a location word chooses nothing on a map", {"locations": False}),
    "without-location-code": SHARED_ABLATIONS["without-location-code"],
    "without-peak": Ablation("a pick may lie anywhere, wherever its map is high", {"peak_margin": None}),
    "with-place-peak": Ablation("a place keeps to the peak of its map, if the map is decided", {"place_lead": 0.2}),
    "with-bracketing": Ablation(
        "CLIP sees the views at three exposures, and a map is that of the surest", {"more_exposures": (1.4, 2.0)}
    ),
    "without-empty-spots": SHARED_ABLATIONS["without-empty-spots"],
    "with-continued-border": Ablation(
        "beyond the border of its picture, an encoder sees the border again, not zeros", {"continued": True}
    ),
    "with-joint-choice": Ablation("pick and place are chosen together, among the 8 best picks", {"joint_picks": 8}),
}
"""Endings of GEM's name (A.2), in the order in which a name holds several.

Not in the paper: ``with-free-kernels``, a fairer rival of the steerable kernel; ``with-matched-single-view``, a fairer
rival of several views; ``with-part-crops``, whose sizes `experiments.clip_tabletop crop-search` chose;
``with-dense-map`` and ``with-region-map``, other map sources; ``keeps-own-crop``, which is what the paper's training
does (A.3); and the endings that switch off our additions: narrow patches, recolouring, map scaling, conjuncts, location
words, empty spots; two other encoders; what an encoder sees beyond its picture; and the product rule of A.1.6 over
several picks."""


@dataclass(frozen=True)
class GemConfig(Config, MapConfig):
    """GEM's numbers.

    Attributes:
        peak_margin, peak_radius: a pick lies at most ``peak_radius`` (m) from a thing on which its map is at most
            ``peak_margin`` below its highest value (`choosing.near_peak`); with a margin of None it may lie anywhere.
        place_lead: a place keeps to its map, too, but within `choosing.PLACE_REACH` times ``peak_radius``, and only if
            the map is higher by at least ``place_lead`` there than elsewhere; with None it may lie anywhere.
        drop_image_map: how often training hides the image-conditioned map.
        map_gain, map_offset: training multiplies each semantic map by a factor in the range ``map_gain``, then adds an
            offset between minus and plus ``map_offset`` (`augment.rescaled`).
        recolor: whether training exchanges and scales the picture's colours (`augment.recolored`).
        uneven_light: by what part, at most, training makes a picture brighter or darker: as a whole, towards one side,
            and towards the border (`augment.relit`); 0 leaves the light as it is.
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
        encoder: the attention U-Net: "plain" is the paper's, with words at the bottleneck; in "modulated" words scale
            and shift every level of the decoder; "steerable" does so, too, and commutes with the turns of C_8.
        continued: whether the encoders' pictures and maps go on beyond their border as they are there (replicate
            padding). With zeros, a bare table has other features at its border than in its middle.
    """

    INPUTS: ClassVar[type[InputConfig]] = MapConfig
    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {
            **Config.PRESETS["paper"], "patch": 40, "stride": 20, "frequency": 16, "kernel": 33, "crop": 33,
            "widths": (32, 64, 128, 256), "kernel_widths": (32, 64, 128), "fields": 16,
        },
    }  # fmt: skip
    ACTING: ClassVar[frozenset[str]] = Config.ACTING | {
        "conjuncts", "continued", "locations", "more_exposures", "peak_margin", "peak_radius", "place_lead",
    }  # fmt: skip
    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {**ABLATIONS, MULTI_TASK: SHARED_ENDINGS[MULTI_TASK]}

    peak_margin: float | None = entry(0.1, or_none(number(0, 10)))
    peak_radius: float = entry(0.0125, RADIUS, grows=True)
    place_lead: float | None = entry(None, or_none(number(0, 10)), added=True)
    drop_image_map: float = entry(0.3, number(0, 1))
    map_gain: tuple[float, float] = entry((0.5, 1.2), each(number(0, 10), 2))
    map_offset: float = entry(0.1, number(0, 10))
    recolor: bool = entry(True, FLAG)
    rotations: int = entry(180, COUNT)
    frequency: int = entry(8, whole_number(0))
    kernel: int = entry(17, whole_number(1, odd=True), grows=True)
    crop: int = entry(17, whole_number(1, odd=True), grows=True)
    widths: tuple[int, ...] = entry((16, 24, 32, 48), each(COUNT, 4))
    kernel_widths: tuple[int, ...] = entry((32, 48, 64), each(COUNT, 3))
    fields: int = entry(6, COUNT)
    channels: int = entry(3, COUNT)
    kernels: Kernels = entry("steerable", KERNELS)
    language_in_attention: bool = entry(True, FLAG)
    encoder: Encoder = entry("plain", ENCODERS, added=True)
    continued: bool = entry(False, FLAG, added=True)
    uneven_light: float = entry(0.0, number(0, 0.3), added=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        sources.SOURCES.find(self.semantic_map)
        if 2 * self.frequency >= self.rotations:
            raise ValueError(
                f"frequency must be below half of rotations, which is {self.rotations / 2:g}, got {self.frequency}"
            )
        if self.continued and self.encoder == "steerable":
            raise ValueError(
                'continued must be False with encoder "steerable", whose layers know zeros alone, got True'
            )
        if self.map_gain[0] > self.map_gain[1]:
            raise ValueError(f"map_gain must go from a smaller number to a larger one, got {self.map_gain}")


LITE = GemConfig.preset("lite")
PAPER = GemConfig.preset("paper")
