"""CLIPort (A.1.5): a semantic stream of frozen CLIP features beside a spatial one, fused on the way up.

CLIP's features are computed from the height map as one picture, once for each scene; augmentation moves these features
together with the picture. The semantic stream starts from the last features; at its next two levels, features from
inside CLIP's image tower join it (two of CLIPort's three skip connections; `ClipPortConfig.skips`). Language enters as
in CLIPort, by products over the pixels at these levels. Pick and place are Transporter's, with two streams in the place
of each U-Net.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn
from typing_extensions import override

from gem_lite.config import FLAG, LENGTH, Ablation, InputConfig, entry, whole_number
from gem_lite.language import Queries
from gem_lite.policies.base import METHODS
from gem_lite.policies.inputs import RGBD, Inputs, to_rgbd
from gem_lite.policies.networks import Pointwise, ResidualBlock, UNet, decoder_widths
from gem_lite.policies.transporter import KeyQuery, KeyQueryConfig, Rival, TopView
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import fuse_views


@dataclass(frozen=True)
class FeatureConfig(InputConfig):
    """What decides the features of CLIP that CLIPort reads.

    Attributes:
        top_patch: how much of the height map (m) is enlarged to the size of the pictures that CLIP knows.
        skips: how many of CLIP's inner features join the semantic stream, from 0 to 3. CLIPort has 3.
    """

    top_patch: float = entry(0.125, LENGTH, grows=True)
    skips: int = entry(2, whole_number(0, 3), added=True)


@dataclass(frozen=True)
class ClipPortConfig(KeyQueryConfig, FeatureConfig):
    """CLIPort's numbers. It recolours: CLIP's features keep the true colours."""

    INPUTS: ClassVar[type[InputConfig]] = FeatureConfig
    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {
        "without-recoloring": Ablation("training shows the colours as they are", {"recolor": False}),
        "with-three-skips": Ablation("all three of CLIPort's skip connections from CLIP's tower", {"skips": 3}),
        **KeyQueryConfig.ABLATIONS,
    }

    recolor: bool = entry(True, FLAG)


class Gate(nn.Module):
    """How language enters CLIPort: features of a picture times a learned projection of the words, at every pixel."""

    def __init__(self, language_dim: int, channels: int) -> None:
        super().__init__()
        self.project = nn.Linear(language_dim, channels)
        # Several products of small numbers would leave almost nothing.
        nn.init.ones_(self.project.bias)

    def forward(self, x: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``x`` (B, channels, h, w) and ``words`` (B, D) to (B, channels, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D). Without the factor, words have little effect at first.
        return x * self.project(words.shape[1] ** 0.5 * words)[:, :, None, None]


class TwoStream(nn.Module):
    """A spatial U-Net over RGB-D and a semantic decoder that takes each of its levels in by a 1 x 1 convolution.

    Args:
        semantics: channels of the semantic features that enter the decoder's first levels. They cover the picture
            with any number of cells; a level brings them to its own size.
    """

    def __init__(self, semantics: Sequence[int], outputs: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        widths = decoder_widths(config.widths)
        self.spatial = UNet(RGBD, outputs, None, config.widths)
        below = [0, *widths[:-1]]
        joined = [*semantics, *[0] * (len(widths) - len(semantics))]
        self.semantic = nn.ModuleList(ResidualBlock(b + j, w) for b, j, w in zip(below, joined, widths, strict=True))
        # The first product with the words is in the features that enter the first level.
        self.gates = nn.ModuleList(Gate(language_dim, width) for width in widths[1 : len(semantics)])
        self.lateral = nn.ModuleList(Pointwise(2 * width, width) for width in widths)
        self.out = Pointwise(widths[-1], outputs)

    def forward(self, rgbd: torch.Tensor, words: torch.Tensor, *semantics: torch.Tensor) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``words`` (B, D) and ``semantics`` (B, C_i, h_i, w_i) to (B, outputs, H, W)."""
        levels = self.spatial.decode(rgbd)
        below: list[torch.Tensor] = []  # the first level has none below it
        for level, (spatial, block, lateral) in enumerate(zip(levels, self.semantic, self.lateral, strict=True)):
            size = (spatial.shape[-2], spatial.shape[-1])
            entering = [resized(x, size) for x in (*below, *semantics[level : level + 1])]
            x = block(torch.cat(entering, dim=1))
            if 0 < level < len(semantics):
                x = self.gates[level - 1](x, words)
            below = [F.relu(lateral(torch.cat([x, spatial], dim=1)))]
        return self.spatial.out(levels[-1]) + self.out(below[0])


def resized(x: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    """Features (B, C, h, w) at another ``size`` (H, W): interpolated if that is larger, averaged if it is smaller."""
    if x.shape[-2] > size[0]:
        return F.adaptive_avg_pool2d(x, size)
    return F.interpolate(x, size, mode="bilinear", align_corners=False) if x.shape[-2] < size[0] else x


class Projection(nn.Module):
    """CLIPort's first product: a learned convolution of CLIP's last features, gated by the words."""

    def __init__(self, features: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        self.conv = nn.Conv2d(features, self.outputs(config), 3, padding=1)
        self.gate = Gate(language_dim, self.outputs(config))

    @staticmethod
    def outputs(config: ClipPortConfig) -> int:
        """The number of output channels."""
        return 2 * config.widths[-1]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, C, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        return self.gate(F.relu(self.conv(coarse)), words)


class Grounding(nn.Module):
    """The product of words and features in the space where CLIP compares the two, then a convolution."""

    def __init__(self, features: int, language_dim: int, config: ClipPortConfig) -> None:
        super().__init__()
        self.match = nn.Conv2d(features, self.outputs(config), 1)

    @staticmethod
    def outputs(config: ClipPortConfig) -> int:
        """The number of output channels."""
        return config.widths[0]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, C, h, w), ``words`` (B, D) with CLIP's embedding (B, C) in front, to (B, outputs, h, w)."""
        size = coarse.shape[1]
        # Entries of unit vectors are about 1 / sqrt(C); the factor C brings their products to about 1.
        return F.relu(self.match(size * coarse * words[:, :size, None, None]))


class WithSemantics(nn.Module):
    """Joins semantic features, made from CLIP's features and the words, to RGB-D, and applies a network to both.

    Args:
        semantics: from CLIP's last features and the words to semantic features.
        inner: the widths of CLIP's inner features, and the widths to which they are projected.
        network: from RGB-D, the words, the picks of a place, and the semantic features of every level to the output.
    """

    def __init__(
        self, semantics: Projection | Grounding, inner: Sequence[tuple[int, int]], network: nn.Module
    ) -> None:  # fmt: skip
        super().__init__()
        self.semantics = semantics
        self.inner = nn.ModuleList(Pointwise(before, after) for before, after in inner)
        self.network = network

    def forward(self, rgbd: torch.Tensor, words: torch.Tensor, *others: torch.Tensor) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``words`` (B, D); for a place picks (B, 2); features (B, C_i, h_i, w_i); to logits."""
        first = len(others) - len(self.inner) - 1
        last, *inner = (feature.float() for feature in others[first:])
        levels = [self.semantics(last, words)]
        levels += [F.relu(project(feature)) for project, feature in zip(self.inner, inner, strict=True)]
        return self.network(rgbd, words, *others[:first], *levels)


@dataclass(frozen=True)
class DenseView(TopView):
    """CLIPort's scene: the table from above, and CLIP's features (D_i, h_i, w_i) of it, the last ones first."""

    features: tuple[torch.Tensor, ...]


@METHODS.register("cliport")
class ClipPort(Rival[DenseView]):
    """A semantic stream from CLIP beside a spatial one: CLIPort at our size."""

    Config = ClipPortConfig
    config: ClipPortConfig
    Semantics: type[Projection | Grounding] = Projection

    @override
    def build(self) -> tuple[WithSemantics, WithSemantics]:
        c = self.config
        key, query = (self._two_stream(c.channels) for _ in range(2))
        return self._with_semantics(self._two_stream(self.pick_angles)), self._with_semantics(KeyQuery(key, query, c))

    @property
    def _inner(self) -> list[tuple[int, int]]:
        """The widths of CLIP's inner features, and those to which they are projected."""
        widths = self.clip.inner_widths[: self.config.skips]
        return list(zip(widths, decoder_widths(self.config.widths)[1:], strict=False))

    def _two_stream(self, outputs: int) -> TwoStream:
        semantics = [self.Semantics.outputs(self.config), *(after for _, after in self._inner)]
        return TwoStream(semantics, outputs, self.language_dim, self.config)

    def _with_semantics(self, network: nn.Module) -> WithSemantics:
        semantics = self.Semantics(self.last_width, self.language_dim, self.config)
        return WithSemantics(semantics, self._inner, network)

    @override
    def embed(self, views: Sequence[View]) -> DenseView:
        heightmap = fuse_views(views, self.config.workspace)
        patch = round(self.config.top_patch / self.config.pixel)
        inner = self.clip.inner_features(heightmap.rgb, patch, self.config.skips)
        return DenseView(heightmap, (self.last_features(heightmap.rgb, patch), *inner))

    @property
    def last_width(self) -> int:
        """C, the number of CLIP's last features."""
        return self.clip.width

    def last_features(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        """CLIP's features (C, h, w) of a picture (H, W, 3) before they are pooled, as in CLIPort."""
        return self.clip.dense_features(picture, patch)

    @override
    def inputs(self, scene: DenseView, queries: Queries) -> Inputs:
        # In half precision, the features of a prepared step need less than 1 MB.
        features = {f"level {level}": feature.half() for level, feature in enumerate(scene.features)}
        return Inputs(rgbd=to_rgbd(scene.heightmap), features=features, words=self.words(queries))


@METHODS.register("cliport-grounded")
class GroundedClipPort(ClipPort):
    """CLIPort whose semantic stream starts from CLIP's own comparison of words and picture: a stronger rival.

    It need not learn which feature belongs to which word.
    """

    Semantics = Grounding

    @property
    @override
    def last_width(self) -> int:
        return self.clip.dim

    @override
    def last_features(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        return self.clip.embed_dense(picture, patch)
