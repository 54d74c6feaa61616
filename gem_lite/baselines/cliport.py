"""CLIPort (A.1.5): a semantic stream of frozen CLIP features beside a spatial one, fused on the way up.

CLIP looks at the height map as one picture (`Clip.embed_dense`), once a scene; in training its features
are moved along with the picture instead of being computed anew. Language enters as CLIPort's does, by
products over the pixels: with CLIP's features, then at every level of the semantic stream. Pick and place
are Transporter's, with two streams wherever that has a U-Net.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import nn

from gem_lite.baselines.transporter import KeyQuery, TopView, TransporterLan
from gem_lite.config import Config
from gem_lite.networks import ResidualBlock, UNet, decoder_widths
from gem_lite.policy import RGBD, Inputs
from gem_lite.semantic_map import top_grid
from gem_lite.tabletop.cameras import View
from gem_lite.tabletop.heightmap import fuse_views


class TwoStream(nn.Module):
    """A spatial U-Net over RGB-D and a semantic decoder that takes each of its levels in by a 1 x 1 convolution."""

    def __init__(self, outputs: int, language_dim: int, config: Config) -> None:
        super().__init__()
        widths = decoder_widths(config.widths)
        self.spatial = UNet(RGBD, outputs, None, config.widths)
        self.semantic = nn.ModuleList(
            ResidualBlock(i, o) for i, o in zip([config.widths[0], *widths[:-1]], widths, strict=True)
        )
        self.gates = nn.ModuleList(nn.Linear(language_dim, width) for width in widths)
        self.lateral = nn.ModuleList(nn.Conv2d(2 * width, width, 1) for width in widths)
        self.out = nn.Conv2d(widths[-1], outputs, 1)
        for gate in self.gates:
            nn.init.ones_(gate.bias)  # a product of small numbers four times over would leave nothing

    def forward(self, image: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``image`` (B, 4 + widths[0], H, W) of RGB-D and `Grounding`, ``words`` (B, D) to (B, outputs, H, W)."""
        levels = self.spatial.decode(image[:, :RGBD])
        x = F.adaptive_avg_pool2d(image[:, RGBD:], levels[0].shape[-2:])  # about as coarse as CLIP's cells
        for spatial, block, gate, lateral in zip(levels, self.semantic, self.gates, self.lateral, strict=True):
            x = F.interpolate(x, spatial.shape[-2:], mode="bilinear", align_corners=False)
            x = block(x) * gate(words)[:, :, None, None]
            x = F.relu(lateral(torch.cat([x, spatial], dim=1)))
        return self.spatial.out(levels[-1]) + self.out(x)


class Grounding(nn.Module):
    """Joins to RGB-D what CLIP's features have to do with the words, then applies a network to both."""

    def __init__(self, network: nn.Module, language_dim: int, config: Config) -> None:
        super().__init__()
        self.match = nn.Conv2d(language_dim, config.widths[0], 1)
        self.network = network

    def forward(self, inputs: Inputs, words: torch.Tensor, *more: torch.Tensor) -> torch.Tensor:
        """``words`` (B, D), and what the network takes ``more``, to what the network gives."""
        # Entries of unit vectors are about 1 / sqrt(D); their products are brought back to about 1.
        product = words.shape[1] * inputs.coarse * words[:, :, None, None]  # (B, D, h, w)
        matched = F.interpolate(
            F.relu(self.match(product)), inputs.image.shape[-2:], mode="bilinear", align_corners=False
        )
        return self.network(torch.cat([inputs.image, matched], dim=1), words, *more)


class ClipPort(TransporterLan):
    """CLIPort at our size: CLIP is frozen, the streams around it are trained."""

    method = "cliport"

    def build(self) -> tuple[Grounding, Grounding]:
        """See `PickPlacePolicy`."""
        c, words = self.config, self.clip.dim
        pick = TwoStream(c.angles, words, c)
        place = KeyQuery(TwoStream(c.channels, words, c), TwoStream(c.channels, words, c), c)
        return Grounding(pick, words, c), Grounding(place, words, c)

    @property
    def recolors(self) -> bool:
        """See `PickPlacePolicy`: CLIP's features keep the true colours."""
        return self.config.recolor

    def see(self, views: Sequence[View]) -> TopView:
        """See `PickPlacePolicy`."""
        heightmap = fuse_views(views, self.config.workspace)
        return TopView(heightmap, self.clip.embed_dense(heightmap.rgb, top_grid(self.config).patch))

    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        """See `PickPlacePolicy`."""
        return self.pick(inputs, inputs.pick_words).float()

    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """See `PickPlacePolicy`."""
        return self.place(inputs, inputs.place_words, picks)
