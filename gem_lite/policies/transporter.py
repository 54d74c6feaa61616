"""Transporter-Lan (A.1.5): Transporter Networks with the language at the bottleneck of every U-Net.

The pick's logits are the output of a U-Net. So they are equivariant to shifts by 16 pixels, and the network has to
learn every angle. The place correlates the scene's features (key) with those of the crop at the pick (query). The crop
is turned by every angle before it enters the query network. So if the picked object is turned by one angle bin, the
best place angle moves back by one bin, for any weights and up to interpolation (half of Eq. 6). The key network has to
learn turns of the goal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from torch import nn
from typing_extensions import override

from gem_lite.config import (
    COUNT,
    FLAG,
    SHARED_ENDINGS,
    Ablation,
    Allowed,
    Config,
    each,
    entry,
    or_none,
    whole_number,
)
from gem_lite.language import Queries, is_relation, split_location
from gem_lite.maps.query_maps import query_maps
from gem_lite.maps.sources import SOURCES, MapSource
from gem_lite.policies.base import METHODS, Policy, SceneT
from gem_lite.policies.choosing import Gate, place_gate
from gem_lite.policies.gem_config import GemConfig
from gem_lite.policies.inputs import RGBD, Inputs, to_rgbd
from gem_lite.policies.networks import UNet
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap, fuse_views
from gem_lite.se2 import angle_bins
from gem_lite.steerable.correlation import continued, correlate


@dataclass(frozen=True)
class KeyQueryConfig(Config):
    """The numbers of methods whose place correlates key and query (`KeyQuery`).

    Attributes:
        widths: channels of the U-Nets' four levels.
        channels: channels that key and query share.
        query: side of the crop at the pick (pixels, one less than a multiple of 16), near GEM's crop.
        pick_angles: at how many angles a pick is scored; None: at ``angles``, as GEM's. CLIPort has one.
        map_rules: whether the policy keeps to GEM's rules where it acts (`Rival.gates`).
        recolor: whether training exchanges and scales the picture's colours (`augment.recolored`).
    """

    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {
        "with-wide-crops": Ablation("the crop at the pick has 31 pixels, in lite the 0.2 m of CLIPort", {"query": 31}),
        "with-one-pick-angle": Ablation("every pick has the yaw 0, as CLIPort's", {"pick_angles": 1}),
        "with-map-rules": Ablation(
            "acts by GEM's rules: picks near the peak of a text map, location words", {"map_rules": True}
        ),
        **SHARED_ENDINGS,
    }
    ACTING: ClassVar[frozenset[str]] = Config.ACTING | {"map_rules"}

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {**Config.PRESETS["paper"], "widths": (32, 64, 128, 256), "query": 31},
    }

    widths: tuple[int, ...] = entry((16, 24, 32, 48), each(COUNT, 4))
    channels: int = entry(3, COUNT)
    query: int = entry(
        15, Allowed("one less than a multiple of 16", lambda value: COUNT.holds(value) and value % 16 == 15),
        grows=True,
    )  # fmt: skip
    pick_angles: int | None = entry(None, or_none(COUNT), added=True)
    map_rules: bool = entry(False, FLAG, added=True)
    recolor: bool = entry(False, FLAG, added=True)


@dataclass(frozen=True)
class TransporterConfig(KeyQueryConfig):
    """Transporter-Lan's numbers. It does not recolour: the picture is all that it knows of colours.

    Attributes:
        joins: at how many levels the words are joined to the U-Nets, from the bottleneck up. The paper has 1. The cells
            of `lite`'s bottleneck are twice as wide as the paper's, wider than a block; those of its next level are as
            wide as the paper's.
    """

    ABLATIONS: ClassVar[Mapping[str, Ablation]] = {
        "with-recoloring": Ablation("training exchanges and scales the colours", {"recolor": True}),
        **KeyQueryConfig.ABLATIONS,
    }
    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {
        "lite": {},
        "paper": {**KeyQueryConfig.PRESETS["paper"], "joins": 1},
    }

    joins: int = entry(2, whole_number(1, 4))


def turned_crops(
    image: torch.Tensor, pixels: torch.Tensor, angles: torch.Tensor, size: int, shape: tuple[int, int]
) -> torch.Tensor:
    """Squares around pixels of a picture that is turned counter-clockwise about these pixels.

    Args:
        image: (B, C, h, w), the picture or features that cover it with fewer cells; outside is 0.
        pixels: (B, 2) integers (row, col) of the picture.
        angles: (R,) radians.
        size: of a crop (pixels of the picture, odd).
        shape: (H, W) of the picture.

    Returns:
        (B, R, C, size, size), interpolated between cells.
    """
    offsets = torch.arange(size, device=image.device, dtype=image.dtype) - size // 2
    row, col = offsets[:, None], offsets[None, :]
    c, s = angles.to(image).cos()[:, None, None], angles.to(image).sin()[:, None, None]
    middle = pixels.to(image)[:, :, None, None, None]
    # The source of each pixel of a crop, so this is the inverse turn: (B, R, size, size).
    rows = middle[:, 0] + c * row + s * col
    cols = middle[:, 1] - s * row + c * col
    height, width = shape
    grid = torch.stack([(2 * cols + 1) / width - 1, (2 * rows + 1) / height - 1], dim=-1)
    crops = F.grid_sample(image, grid.flatten(1, 2), align_corners=False)  # (B, C, R * size, size)
    return crops.unflatten(2, (len(angles), size)).transpose(1, 2)


class KeyQuery(nn.Module):
    """Transporter's place: features of the scene correlated with those of the crop at the pick, turned R times.

    Args:
        encoder, kernel: the key and the query network: from a picture (B, 4, H, W), words (B, D) and features
            (B, C_i, h_i, w_i) that cover the picture, if the method has any, to features (B, F, H, W).
    """

    angles: torch.Tensor

    def __init__(self, encoder: nn.Module, kernel: nn.Module, config: KeyQueryConfig) -> None:
        super().__init__()
        self.encoder = encoder
        self.kernel = kernel
        self.size = config.query
        self.angles: torch.Tensor
        self.register_buffer("angles", torch.tensor(angle_bins(config.angles), dtype=torch.float32))

    def forward(
        self, image: torch.Tensor, words: torch.Tensor, picks: torch.Tensor, *levels: torch.Tensor
    ) -> torch.Tensor:
        """``image`` (B, 4, H, W), ``words`` (B, D), ``picks`` (B, 2), ``levels`` (B, C_i, h_i, w_i) to (B, R, H, W)."""
        kernels = self.kernels(image, words, picks, *levels)
        features = self.encoder(image, words, *levels)
        with torch.autocast(features.device.type, enabled=False):
            # Where the policy acts, the features go on beyond the table.
            reach = 0 if self.training else self.size // 2
            return continued(lambda whole: correlate(whole, kernels.float()), features.float(), reach)

    def kernels(
        self, image: torch.Tensor, words: torch.Tensor, picks: torch.Tensor, *levels: torch.Tensor
    ) -> torch.Tensor:
        """The query of every angle, (B, R, F, size, size)."""
        shape = (image.shape[-2], image.shape[-1])
        count = len(self.angles)
        crops = []
        for whole in (image, *levels):
            turned = turned_crops(whole, picks, self.angles, self.size, shape).flatten(0, 1)
            # The networks halve the size four times: one more row and column makes it a multiple of 16.
            crops.append(F.pad(turned, (0, 1, 0, 1)))  # (B*R, C, size+1, size+1)
        features = self.kernel(crops[0], words.repeat_interleave(count, dim=0), *crops[1:])
        return features[..., : self.size, : self.size].unflatten(0, (len(image), count)) / self.size


class Rival(Policy[SceneT]):
    """What Transporter-Lan and CLIPort share: one pick angle and GEM's rules, if their configuration says so.

    Their networks get RGB-D, words, for a place the picks, and the features, if the method has any.
    """

    config: KeyQueryConfig

    @property
    @override
    def recolors(self) -> bool:
        return self.config.recolor

    @override
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        return self.pick(inputs.rgbd, inputs.words["pick"], *inputs.features.values()).float()

    @override
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        return self.place(inputs.rgbd, inputs.words["place"], picks, *inputs.features.values())

    @property
    @override
    def pick_angles(self) -> int:
        return self.config.pick_angles or self.config.angles

    @cached_property
    def _map_config(self) -> GemConfig:
        same = {name: getattr(self.config, name) for name in ("table", "pixel", "rectangle", "locations", "parsing")}
        return replace(GemConfig.preset(self.config.name), **same)

    @cached_property
    def _map_source(self) -> MapSource:
        return SOURCES.find(self._map_config.semantic_map)(self.clip, self._map_config)

    @override
    def gates(self, views: Sequence[View], inputs: Inputs, queries: Queries) -> Mapping[str, Gate]:
        """GEM's text-conditioned maps, with their words "left" and "and".

        A pick is gated by its map, but not the start of a push. A place is gated if its phrase has a location word,
        since GEM's place reads such a word from its map; and if it is a relation, as GEM's.
        """
        if not self.config.map_rules:
            return {}
        gating = {} if queries.push else {"pick": queries.pick}
        related = is_relation(queries.place)
        if isinstance(queries.place, str) and (related or split_location(queries.place)[0]):
            gating["place"] = queries.place
        scene = self._map_source.embed(views)
        height = torch.from_numpy(scene.heightmap.height)
        maps = {role: query_maps(self._map_source, scene, query, self._map_config) for role, query in gating.items()}
        gates = {role: Gate(torch.from_numpy(of.fused), height, self._map_config) for role, of in maps.items()}
        if related:
            gates["place"] = place_gate(gates["place"].semantic, height)
        return gates


@dataclass(frozen=True)
class TopView:
    """Transporter-Lan's scene: the table from above."""

    heightmap: HeightMap


@METHODS.register("transporter-lan")
class TransporterLan(Rival[TopView]):
    """Transporter Networks with language: of CLIP they use only the embeddings of the queries."""

    Config = TransporterConfig
    config: TransporterConfig

    @override
    def build(self) -> tuple[nn.Module, nn.Module]:
        c = self.config
        words = self.language_dim
        key, query = (UNet(RGBD, c.channels, words, c.widths, c.joins) for _ in range(2))
        return UNet(RGBD, self.pick_angles, words, c.widths, c.joins), KeyQuery(key, query, c)

    @override
    def embed(self, views: Sequence[View]) -> TopView:
        return TopView(fuse_views(views, self.config.workspace))

    @override
    def inputs(self, scene: TopView, queries: Queries) -> Inputs:
        return Inputs(rgbd=to_rgbd(scene.heightmap), words=self.words(queries))
