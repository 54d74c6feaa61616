"""Every number that shapes a policy or its training: `lite` for two CPU cores, `paper` for a GPU."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from typing import Literal, NamedTuple, get_args

from gem_lite.se2 import Workspace

SemanticMap = Literal["multi-view", "single-view", "none"]
Kernels = Literal["steerable", "unrotated", "free"]


class Ablation(NamedTuple):
    """What one ablation of Table A2 changes in a configuration, what that means, and which methods it is for."""

    meaning: str
    changes: dict
    methods: tuple[str, ...] = ("gem",)


EVERY_METHOD = ("gem", "transporter-lan", "cliport", "cliport-grounded")
ABLATIONS = {
    "without-semantic-map": Ablation("the map is 1 everywhere", {"semantic_map": "none"}),
    "with-single-view": Ablation("the text map comes from the height map's patches", {"semantic_map": "single-view"}),
    "without-steerable-kernel": Ablation("one unrotated kernel for all angles", {"kernels": "unrotated"}),
    "with-free-kernels": Ablation("a kernel of its own for each angle, not tied by rotation", {"kernels": "free"}),
    "without-image-map": Ablation("no image-conditioned map", {"image_weight": 0.0}),
    "with-wide-patches": Ablation(
        "side views are cut into the paper's patches, twice as wide", {"patch": 40, "stride": 20}
    ),
    "without-recoloring": Ablation(
        "training shows the colours as they are", {"recolor": False}, ("gem", "cliport", "cliport-grounded")
    ),
    "without-parsing": Ablation(
        "both phrases are the whole instruction",
        {"parsing": False},
        EVERY_METHOD,
    ),
    "without-language-in-attention": Ablation("the attention U-Nets see no language", {"language_in_attention": False}),
    "with-matched-single-view": Ablation(
        "one view with patches of 87.5 mm: the paper's side-view patches have that width on the table",
        {"semantic_map": "single-view", "top_patch": 0.0875, "top_stride": 0.04375},
    ),
    "keeps-own-crop": Ablation("a step's own demonstration may answer its phrase in training", {"own_crop": True}),
    "without-rotation-augmentation": Ablation(
        "training moves scenes, but does not turn them", {"turn": False}, EVERY_METHOD
    ),
    "without-map-scaling": Ablation("training shows the maps as they are", {"map_gain": (1.0, 1.0), "map_offset": 0.0}),
    "without-conjuncts": Ablation('a phrase with "and" is one phrase', {"conjuncts": False}),
    "without-peak": Ablation("a pick may lie anywhere, wherever its map is high", {"peak_margin": None}),
    "without-empty-spots": Ablation(
        "a spot where nothing was grasped may be tried again", {"empty_radius": 0.0}, EVERY_METHOD
    ),
}
"""Endings of a method's name (A.2), in the order in which a name holds several.

Not in the paper: ``with-free-kernels``, a fairer rival of the steerable kernel; ``with-matched-single-view``, a fairer
rival of several views; ``keeps-own-crop``, which is what the paper's training does (A.3); and the endings that switch
off what is ours: narrow patches, recolouring, map scaling, conjuncts, empty spots."""


@dataclass(frozen=True)
class Config:
    """A configuration. The defaults are `lite`.

    Attributes:
        table: length of the table (m); it is half as wide.
        pixel: size of a height map's cell (m).
        patch, stride: CLIP patches of the side views (pixels of a 480 x 640 view). The paper's are 40 and 20. In
            `lite` a patch is about as wide as a block, so that some patches show one of two blocks that touch.
        top_patch, top_stride: CLIP patches of the height map (m).
        text_weight, image_weight: w1 and w2 of Eq. 4.
        drop_image_map: how often training hides the image-conditioned map.
        rotations: n, into how many rotations a kernel is lifted.
        frequency: K, the largest Fourier frequency kept.
        angles: how many angles are sampled at the output.
        kernel: h, side of the dynamic kernel (pixels, odd).
        crop: side of the place module's crop at the pick (pixels, odd).
        widths: channels of the U-Net's four levels.
        kernel_widths: channels of the language kernel generator's three levels.
        fields: regular fields of the place kernel generator's layers.
        channels: channels that features and kernels share.
        query: side of the baselines' crop at the pick (pixels, one less than a multiple of 16), near GEM's crop.
        turn: whether training turns scenes; it always shifts them.
        map_gain, map_offset: training multiplies each semantic map by a factor in the range ``map_gain`` and adds up
            to ``map_offset`` to it or takes it off (`augment.rescaled`).
        own_crop: whether training may retrieve a crop of the step's own demonstration.
        conjuncts: whether "green and blue blocks" is two phrases, whose maps are joined.
        empty_radius: a pick keeps so far (m) away from where the tool has just grasped nothing.
        peak_margin, peak_radius: a pick lies at most so far (m, ``peak_radius``) from where its map is at most
            ``peak_margin`` below its highest value; with None for the margin it may lie anywhere.
        recolor: whether training exchanges and scales the picture's colours (`augment.recolored`) for methods that
            see colours through CLIP as well.
        joins: at how many levels Transporter-Lan's U-Nets are told the words, from the bottleneck up. The paper's has
            1; `lite`'s bottleneck has cells twice as wide, wider than a block, and its next level has the paper's.
        semantic_map, kernels, parsing, language_in_attention: what `ABLATIONS` switch.
        steps, batch, learning_rate: training.
        ablations: which `ABLATIONS` this configuration was made with (`ablated`). They name the method; equal values
            that were set in another way do not.
    """

    name: str = "lite"
    table: float = 1.0
    pixel: float = 0.00625
    patch: int = 20
    stride: int = 10
    top_patch: float = 0.125
    top_stride: float = 0.0625
    text_weight: float = 0.8
    image_weight: float = 0.2
    drop_image_map: float = 0.3
    own_crop: bool = False
    conjuncts: bool = True
    map_gain: tuple[float, float] = (0.5, 1.2)
    map_offset: float = 0.1
    recolor: bool = True
    turn: bool = True
    empty_radius: float = 0.0125
    peak_margin: float | None = 0.1
    peak_radius: float = 0.0125
    rotations: int = 180
    frequency: int = 8
    angles: int = 36
    kernel: int = 17
    crop: int = 17
    widths: tuple[int, ...] = (16, 24, 32, 48)
    kernel_widths: tuple[int, ...] = (32, 48, 64)
    fields: int = 6
    channels: int = 3
    query: int = 15
    joins: int = 2
    semantic_map: SemanticMap = "multi-view"
    kernels: Kernels = "steerable"
    parsing: bool = True
    language_in_attention: bool = True
    steps: int = 1500
    batch: int = 2
    learning_rate: float = 1e-3
    ablations: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for value, allowed in ((self.semantic_map, SemanticMap), (self.kernels, Kernels)):
            if value not in get_args(allowed):
                raise ValueError(f"the configuration must have one of {', '.join(get_args(allowed))}, got {value!r}")

        for ending in self.ablations:
            if ending not in ABLATIONS:
                raise ValueError(f"ablations must be of {', '.join(ABLATIONS)}, got {ending!r}")
            for key, value in ABLATIONS[ending].changes.items():
                if getattr(self, key) != value:
                    raise ValueError(
                        f"{ending} needs {key} = {value!r}, got {getattr(self, key)!r}: "
                        "it cannot be combined with another ablation or value of the same setting"
                    )

    @property
    def variant(self) -> str:
        """The ending of a method's name: "" or what is switched off, such as "-without-parsing"."""
        return "".join(f"-{ending}" for ending in self.ablations)

    def ablated(self, ending: str) -> Config:
        """The same with what one of `ABLATIONS` changes, and named after it.

        Raises:
            ValueError: no such ablation, or one that contradicts another.
        """
        if ending not in ABLATIONS:
            raise ValueError(f"ending must be one of {', '.join(ABLATIONS)}, got {ending!r}")
        ablations = tuple(known for known in ABLATIONS if known in (*self.ablations, ending))
        return replace(self, **ABLATIONS[ending].changes, ablations=ablations)

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that stand for every entry: SHA-256 of `as_dict` as JSON with sorted keys."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()[:12]

    @property
    def workspace(self) -> Workspace:
        """The workspace at this configuration's resolution."""
        return Workspace.of_length(self.table, self.pixel)

    def on_table(self, length: float) -> Config:
        """The same for a table of another length (m), covered by as many pixels."""
        return replace(self, table=length, pixel=self.pixel * length / self.table)

    def as_dict(self) -> dict:
        """As JSON holds it: tuples become lists."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}

    @classmethod
    def from_dict(cls, values: dict) -> Config:
        """The inverse of `as_dict`. Raises ValueError on names that this version does not know."""
        unknown = set(values) - set(cls.__dataclass_fields__)
        if unknown:
            raise ValueError(f"the configuration has unknown entries {sorted(unknown)}")
        return cls(**{key: tuple(value) if isinstance(value, list) else value for key, value in values.items()})


LITE = Config()
PAPER = Config(
    name="paper",
    patch=40,
    stride=20,
    pixel=0.003125,
    frequency=16,
    angles=72,
    kernel=33,
    crop=33,
    widths=(32, 64, 128, 256),
    kernel_widths=(32, 64, 128),
    fields=16,
    query=31,
    joins=1,
    steps=30_000,
    batch=1,
    learning_rate=1e-4,
)
CONFIGS = {config.name: config for config in (LITE, PAPER)}
