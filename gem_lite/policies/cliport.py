"""CLIPort (A.1.5): a semantic stream of frozen CLIP features beside a spatial one, fused on the way up.

CLIP looks at the height map as one picture, once a scene; in training its features are moved along with
the picture instead of being computed anew. Language enters as CLIPort's does, by products over the
pixels: with learned features of CLIP's, then at every level of the semantic stream. Pick and place are
Transporter's, with two streams wherever that has a U-Net.

`GroundedClipPort` is a stronger rival than the paper's: it multiplies where CLIP itself compares pictures
and words, so it need not learn which feature answers to which word.
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

from gem_lite.config import SHARED_ABLATIONS, Ablation
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
        **SHARED_ABLATIONS,
    }

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
            # A product of small numbers four times over would leave nothing.
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
    """CLIPort's way in: a learned convolution of CLIP's features, times a learned projection of the words."""

    def __init__(self, features: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        self.conv = nn.Conv2d(features, self.outputs(config), 3, padding=1)
        self.gate = nn.Linear(language_dim, self.outputs(config))
        nn.init.ones_(self.gate.bias)

    @staticmethod
    def outputs(config: ClipPortConfig) -> int:
        """How many channels come out."""
        return 2 * config.widths[-1]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, C, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D): as they are, the words would hardly be heard at first.
        gates = self.gate(words.shape[1] ** 0.5 * words)
        return F.relu(self.conv(coarse)) * gates[:, :, None, None]


class Grounding(nn.Module):
    """The product of words and features in the space where CLIP compares the two, then a convolution."""

    def __init__(self, features: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        self.match = nn.Conv2d(language_dim, self.outputs(config), 1)

    @staticmethod
    def outputs(config: ClipPortConfig) -> int:
        """How many channels come out."""
        return config.widths[0]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, D, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D); their products are brought back to about 1.
        return F.relu(self.match(words.shape[1] * coarse * words[:, :, None, None]))


class WithSemantics(nn.Module):
    """Joins semantic features, made of CLIP's and the words, to RGB-D, then applies a network to both."""

    def __init__(self, semantics: Projection | Grounding, network: nn.Module) -> None:
        super().__init__()
        self.semantics = semantics
        self.network = network

    def forward(
        self, rgbd: torch.Tensor, coarse: torch.Tensor, words: torch.Tensor, *more: torch.Tensor
    ) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``coarse`` (B, C, h, w), ``words`` (B, D), ``more`` of the network: what it gives."""
        semantics = self.semantics(coarse, words)
        fine = F.interpolate(semantics, rgbd.shape[-2:], mode="bilinear", align_corners=False)
        return self.network(torch.cat([rgbd, fine], dim=1), words, *more)


@dataclass(frozen=True)
class DenseView:
    """What CLIPort sees before it knows any query: the table from above, and CLIP's features (D, h, w) of it."""

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
        before_pick, before_place = (self.Semantics(self.clip.width, words, c) for _ in range(2))
        return WithSemantics(before_pick, pick), WithSemantics(before_place, place)

    @property
    def recolors(self) -> bool:
        """Whether training recolours its pictures; CLIP's features keep the true colours."""
        return self.config.recolor

    @override
    def embed(self, views: Sequence[View]) -> DenseView:
        heightmap = fuse_views(views, self.config.workspace)
        return DenseView(heightmap, self.look(heightmap.rgb, round(self.config.top_patch / self.config.pixel)))

    def look(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        """What CLIP says of a picture's places: its features before they are pooled, as in CLIPort."""
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
    """CLIPort, told where CLIP finds the words: its own comparison starts the stream. Stronger than the paper's."""

    method = "cliport-grounded"
    Semantics = Grounding

    @override
    def look(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        """What CLIP says of a picture's places, where it compares them with words."""
        return self.clip.embed_dense(picture, patch)
