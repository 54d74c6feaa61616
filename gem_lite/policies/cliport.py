"""CLIPort (A.1.5): a semantic stream of frozen CLIP features beside a spatial one, fused on the way up.

CLIP's features are computed from the height map as one picture, once for each scene; augmentation moves these features
together with the picture. Language enters as in CLIPort, by products over the pixels: first with a learned convolution
of CLIP's features, then at every level of the semantic stream. Pick and place are Transporter's, with two streams in
the place of each U-Net.

`GroundedClipPort` is a stronger rival than the paper's: it multiplies words and features in the space where CLIP itself
compares pictures and words. So it need not learn which feature belongs to which word.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn
from typing_extensions import override

from gem_lite.config import SHARED_ENDINGS, Ablation
from gem_lite.language import Queries
from gem_lite.policies.base import PickPlacePolicy
from gem_lite.policies.networks import ResidualBlock, UNet, decoder_widths
from gem_lite.policies.samples import RGBD, Inputs, to_rgbd
from gem_lite.policies.transporter import KeyQuery, KeyQueryConfig
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap, fuse_views


@dataclass(frozen=True)
class ClipPortConfig(KeyQueryConfig):
    """CLIPort's numbers.

    Attributes:
        top_patch: how much of the height map (m) is enlarged to the size of the pictures that CLIP knows.
        recolor: whether training exchanges and scales the picture's colours (`augment.recolored`).
    """

    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {
        "without-recoloring": Ablation("training shows the colours as they are", {"recolor": False}),
        **SHARED_ENDINGS,
    }
    AFTER_PREPARATION: ClassVar[frozenset[str]] = KeyQueryConfig.AFTER_PREPARATION | {"recolor"}

    top_patch: float = 0.125
    recolor: bool = True


class TwoStream(nn.Module):
    """A spatial U-Net over RGB-D and a semantic decoder that takes each of its levels in by a 1 x 1 convolution."""

    def __init__(self, inputs: int, outputs: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        widths = decoder_widths(config.widths)
        self.spatial = UNet(RGBD, outputs, None, config.widths)
        self.semantic = nn.ModuleList(ResidualBlock(i, o) for i, o in zip([inputs, *widths[:-1]], widths, strict=True))
        self.gates = nn.ModuleList(nn.Linear(language_dim, width) for width in widths)
        self.lateral = nn.ModuleList(nn.Conv2d(2 * width, width, 1) for width in widths)
        self.out = nn.Conv2d(widths[-1], outputs, 1)
        for gate in self.gates:
            # Four products of small numbers would leave almost nothing.
            nn.init.ones_(cast(torch.Tensor, gate.bias))

    def forward(self, image: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``image`` (B, 4 + inputs, H, W) of RGB-D and semantic features, ``words`` (B, D) to (B, outputs, H, W)."""
        levels = self.spatial.decode(image[:, :RGBD])
        height, width = levels[0].shape[-2:]
        x = F.adaptive_avg_pool2d(image[:, RGBD:], (height, width))  # about as coarse as CLIP's cells
        for spatial, block, gate, lateral in zip(levels, self.semantic, self.gates, self.lateral, strict=True):
            x = F.interpolate(x, spatial.shape[-2:], mode="bilinear", align_corners=False)
            x = block(x) * gate(words)[:, :, None, None]
            x = F.relu(lateral(torch.cat([x, spatial], dim=1)))
        return self.spatial.out(levels[-1]) + self.out(x)


class Projection(nn.Module):
    """How language enters CLIPort: a learned convolution of CLIP's features times a learned projection of the words."""

    def __init__(self, features: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        self.conv = nn.Conv2d(features, self.outputs(config), 3, padding=1)
        self.gate = nn.Linear(language_dim, self.outputs(config))
        nn.init.ones_(self.gate.bias)

    @staticmethod
    def outputs(config: ClipPortConfig) -> int:
        """The number of output channels."""
        return 2 * config.widths[-1]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, C, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D). Without the factor, words have little effect at first.
        gates = self.gate(words.shape[1] ** 0.5 * words)
        return F.relu(self.conv(coarse)) * gates[:, :, None, None]


class Grounding(nn.Module):
    """The product of words and features in the space where CLIP compares the two, then a convolution."""

    def __init__(self, features: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        self.match = nn.Conv2d(language_dim, self.outputs(config), 1)

    @staticmethod
    def outputs(config: ClipPortConfig) -> int:
        """The number of output channels."""
        return config.widths[0]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, D, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D); the factor D brings their products to about 1.
        return F.relu(self.match(words.shape[1] * coarse * words[:, :, None, None]))


class WithSemantics(nn.Module):
    """Joins semantic features, made from CLIP's features and the words, to RGB-D, and applies a network to both."""

    def __init__(self, semantics: Projection | Grounding, network: nn.Module) -> None:
        super().__init__()
        self.semantics = semantics
        self.network = network

    def forward(
        self, rgbd: torch.Tensor, coarse: torch.Tensor, words: torch.Tensor, *network_inputs: torch.Tensor
    ) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``coarse`` (B, C, h, w), ``words`` (B, D) and further inputs to the output."""
        semantics = self.semantics(coarse, words)
        fine = F.interpolate(semantics, rgbd.shape[-2:], mode="bilinear", align_corners=False)
        return self.network(torch.cat([rgbd, fine], dim=1), words, *network_inputs)


@dataclass(frozen=True)
class DenseView:
    """CLIPort's scene: the table from above, and CLIP's features (D, h, w) of it."""

    heightmap: HeightMap
    features: torch.Tensor


class ClipPort(PickPlacePolicy[DenseView]):
    """A semantic stream from CLIP beside a spatial one: CLIPort at our size."""

    method = "cliport"
    Config = ClipPortConfig
    config: ClipPortConfig
    Semantics: type[Projection | Grounding] = Projection

    @override
    def build(self) -> tuple[WithSemantics, WithSemantics]:
        c = self.config
        words = self.clip.dim
        inputs = self.Semantics.outputs(c)
        pick = TwoStream(inputs, c.angles, words, c)
        key, query = (TwoStream(inputs, c.channels, words, c) for _ in range(2))
        place = KeyQuery(key, query, c)
        pick_semantics, place_semantics = (self.Semantics(self.clip.width, words, c) for _ in range(2))
        return WithSemantics(pick_semantics, pick), WithSemantics(place_semantics, place)

    @property
    @override
    def recolors(self) -> bool:
        return self.config.recolor  # CLIP's features keep the true colours.

    @override
    def embed(self, views: Sequence[View]) -> DenseView:
        heightmap = fuse_views(views, self.config.workspace)
        patch = round(self.config.top_patch / self.config.pixel)
        return DenseView(heightmap, self.picture_features(heightmap.rgb, patch))

    def picture_features(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        """CLIP's features (D, h, w) of a picture (H, W, 3) before they are pooled, as in CLIPort."""
        return self.clip.dense_features(picture, patch)

    @override
    def inputs(self, scene: DenseView, queries: Queries) -> Inputs:
        return Inputs(rgbd=to_rgbd(scene.heightmap), features={"clip": scene.features}, words=self.words(queries))

    @override
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        return self.pick(inputs.rgbd, inputs.features["clip"], inputs.words["pick"]).float()

    @override
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        return self.place(inputs.rgbd, inputs.features["clip"], inputs.words["place"], picks)


class GroundedClipPort(ClipPort):
    """CLIPort whose semantic stream starts from CLIP's own comparison of words and picture: a stronger rival."""

    method = "cliport-grounded"
    Semantics = Grounding

    @override
    @override
    def picture_features(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        return self.clip.embed_dense(picture, patch)
