"""CLIPort (A.1.5): a semantic stream of frozen CLIP features beside a spatial one, fused on the way up.

CLIP looks at the height map as one picture, once a scene; in training its features are moved along with
the picture instead of being computed anew. Language enters as CLIPort's does, by products over the
pixels: with learned features of CLIP's, then at every level of the semantic stream. Pick and place are
Transporter's, with two streams wherever that has a U-Net.

`GroundedClipPort` is a stronger rival than the paper's: it multiplies where CLIP itself compares pictures
and words, so it need not learn which feature answers to which word.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from gem_lite.config import Config
from gem_lite.maps.semantic_map import top_grid
from gem_lite.policies.networks import ResidualBlock, UNet, decoder_widths
from gem_lite.policies.samples import RGBD, Inputs
from gem_lite.policies.transporter import KeyQuery, TopView, TransporterLan
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import fuse_views


class TwoStream(nn.Module):
    """A spatial U-Net over RGB-D and a semantic decoder that takes each of its levels in by a 1 x 1 convolution."""

    def __init__(self, inputs: int, outputs: int, language_dim: int, config: Config) -> None:
        super().__init__()
        widths = decoder_widths(config.widths)
        self.spatial = UNet(RGBD, outputs, None, config.widths)
        self.semantic = nn.ModuleList(ResidualBlock(i, o) for i, o in zip([inputs, *widths[:-1]], widths, strict=True))
        self.gates = nn.ModuleList(nn.Linear(language_dim, width) for width in widths)
        self.lateral = nn.ModuleList(nn.Conv2d(2 * width, width, 1) for width in widths)
        self.out = nn.Conv2d(widths[-1], outputs, 1)
        for gate in self.gates:
            nn.init.ones_(gate.bias)  # a product of small numbers four times over would leave nothing

    def forward(self, image: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``image`` (B, 4 + inputs, H, W) of RGB-D and semantic features, ``words`` (B, D) to (B, outputs, H, W)."""
        levels = self.spatial.decode(image[:, :RGBD])
        x = F.adaptive_avg_pool2d(image[:, RGBD:], levels[0].shape[-2:])  # about as coarse as CLIP's cells
        for spatial, block, gate, lateral in zip(levels, self.semantic, self.gates, self.lateral, strict=True):
            x = F.interpolate(x, spatial.shape[-2:], mode="bilinear", align_corners=False)
            x = block(x) * gate(words)[:, :, None, None]
            x = F.relu(lateral(torch.cat([x, spatial], dim=1)))
        return self.spatial.out(levels[-1]) + self.out(x)


class Projection(nn.Module):
    """CLIPort's way in: a learned convolution of CLIP's features, times a learned projection of the words."""

    def __init__(self, features: int, language_dim: int, config: Config) -> None:
        super().__init__()
        self.conv = nn.Conv2d(features, self.outputs(config), 3, padding=1)
        self.gate = nn.Linear(language_dim, self.outputs(config))
        nn.init.ones_(self.gate.bias)

    @staticmethod
    def outputs(config: Config) -> int:
        """How many channels come out."""
        return 2 * config.widths[-1]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, C, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D): as they are, the words would hardly be heard at first.
        gates = self.gate(words.shape[1] ** 0.5 * words)
        return F.relu(self.conv(coarse)) * gates[:, :, None, None]


class Grounding(nn.Module):
    """The product of words and features in the space where CLIP compares the two, then a convolution."""

    def __init__(self, features: int, language_dim: int, config: Config) -> None:
        super().__init__()
        self.match = nn.Conv2d(language_dim, self.outputs(config), 1)

    @staticmethod
    def outputs(config: Config) -> int:
        """How many channels come out."""
        return config.widths[0]

    def forward(self, coarse: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``coarse`` (B, D, h, w), ``words`` (B, D) to (B, outputs, h, w)."""
        # Entries of unit vectors are about 1 / sqrt(D); their products are brought back to about 1.
        return F.relu(self.match(words.shape[1] * coarse * words[:, :, None, None]))


class WithSemantics(nn.Module):
    """Joins semantic features to RGB-D, then applies a network to both."""

    def __init__(self, semantics: Projection | Grounding, network: nn.Module) -> None:
        super().__init__()
        self.semantics = semantics
        self.network = network

    def forward(self, inputs: Inputs, words: torch.Tensor, *more: torch.Tensor) -> torch.Tensor:
        """``words`` (B, D), and what the network takes ``more``, to what the network gives."""
        semantics = self.semantics(inputs.coarse, words)
        fine = F.interpolate(semantics, inputs.image.shape[-2:], mode="bilinear", align_corners=False)
        return self.network(torch.cat([inputs.image, fine], dim=1), words, *more)


class ClipPort(TransporterLan):
    """CLIPort at our size: CLIP is frozen, the streams around it are trained."""

    method = "cliport"
    Semantics: type[Projection | Grounding] = Projection

    def build(self) -> tuple[WithSemantics, WithSemantics]:
        """See `PickPlacePolicy`."""
        c, words, inputs = self.config, self.clip.dim, self.Semantics.outputs(self.config)
        pick = TwoStream(inputs, c.angles, words, c)
        place = KeyQuery(*(TwoStream(inputs, c.channels, words, c) for _ in range(2)), c)
        pick, place = (WithSemantics(self.Semantics(self.clip.width, words, c), part) for part in (pick, place))
        return pick, place

    @property
    def recolors(self) -> bool:
        """See `PickPlacePolicy`: CLIP's features keep the true colours."""
        return self.config.recolor

    def see(self, views: Sequence[View]) -> TopView:
        """See `PickPlacePolicy`."""
        heightmap = fuse_views(views, self.config.workspace)
        return TopView(heightmap, self.look(heightmap.rgb, top_grid(self.config).patch))

    def look(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        """What CLIP says of a picture's places: its features before they are pooled, as in CLIPort."""
        return self.clip.dense_features(picture, patch)

    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        """See `PickPlacePolicy`."""
        return self.pick(inputs, inputs.pick_words).float()

    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """See `PickPlacePolicy`."""
        return self.place(inputs, inputs.place_words, picks)


class GroundedClipPort(ClipPort):
    """CLIPort whose semantic stream starts from the answer of CLIP's own comparison."""

    method = "cliport-grounded"
    Semantics = Grounding

    def look(self, picture: np.ndarray, patch: int) -> torch.Tensor:
        """What CLIP says of a picture's places, where it compares them with words."""
        return self.clip.embed_dense(picture, patch)
