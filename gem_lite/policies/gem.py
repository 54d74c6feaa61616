"""GEM's pick and place modules, and the policy that chains them (Sec. 3.2, Fig. 3, Fig. A3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import nn
from typing_extensions import override

from gem_lite import language
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.language import Queries, Query
from gem_lite.maps import semantic_map, sources
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey, demonstrated_crops
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies.base import Choice, PickPlacePolicy
from gem_lite.policies.gem_config import GemConfig
from gem_lite.policies.networks import CropKernel, LanguageKernel, SemanticRefiner, UNet
from gem_lite.policies.samples import RGBD, Inputs, PreparedStep, crop_at, label, to_rgbd
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.steerable import SteerableKernel
from gem_lite.steerable.correlation import correlate, sample


class ActionModule(nn.Module):
    """What pick and place share: (A ⊗ M) correlated with a steerable kernel, sampled at R angles."""

    angles: torch.Tensor

    def __init__(self, config: GemConfig, language_dim: int) -> None:
        super().__init__()
        self.config = config
        attention = language_dim if config.language_in_attention else None
        self.encoder = UNet(RGBD, config.channels, attention, config.widths)
        self.refiner = SemanticRefiner(config.channels)
        self.angles: torch.Tensor
        self.register_buffer("angles", torch.tensor(angle_bins(config.angles), dtype=torch.float32))

    @property
    def kernel_channels(self) -> int:
        """Channels that a kernel generator makes: those of one kernel, or of one for each angle."""
        return self.config.channels * (self.config.angles if self.config.kernels == "free" else 1)

    def features(self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """A ⊗ M: the encoder's features gated by the refined semantic map, (B, channels, H, W)."""
        return self.encoder(rgbd, words) * self.refiner(semantic, rgbd[:, 3:])

    def score(self, features: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
        """Logits (B, R, H, W) of features against a kernel (B, kernel_channels, h, h)."""
        # Fourier transforms and logits want all their digits, also where training is in mixed precision.
        with torch.autocast(features.device.type, enabled=False):
            features, kernel = features.float(), kernel.float()
            if self.config.kernels == "steerable":
                lifted = SteerableKernel.lift(kernel, self.config.rotations, self.config.frequency)
                return sample(lifted.correlate(features), self.angles)
            scores = correlate(features, kernel.unflatten(1, (-1, self.config.channels)))
            return scores.expand(-1, self.config.angles, -1, -1)  # an unrotated kernel scores every angle alike


class PickModule(ActionModule):
    """p(pick | observation, language): the kernel comes from the language (Eq. 9)."""

    def __init__(self, config: GemConfig, language_dim: int) -> None:
        super().__init__(config, language_dim)
        self.kernel = LanguageKernel(config.kernel, self.kernel_channels, language_dim, config.kernel_widths)

    def forward(self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``semantic`` (B, 1, H, W), ``words`` (B, D) to logits (B, R, H, W)."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(words))


class PlaceModule(ActionModule):
    """p(place | observation, language, pick): the kernel comes from the crop at the pick (Eq. 11)."""

    def __init__(self, config: GemConfig, language_dim: int) -> None:
        super().__init__(config, language_dim)
        self.kernel = CropKernel(RGBD + 1, self.kernel_channels, config.fields)

    def forward(
        self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor, crop: torch.Tensor
    ) -> torch.Tensor:
        """As `PickModule`, with ``crop`` (B, 5, h, h) of RGB-D and pick map, unrotated, at the pick."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(crop))


@dataclass(frozen=True)
class QueryMaps:
    """The semantic maps of one query, (H, W) float32; ``image`` is None where there is no picture to compare with."""

    text: np.ndarray
    image: np.ndarray | None
    fused: np.ndarray


def joined(members: Sequence[QueryMaps]) -> QueryMaps:
    """The maps of "X and Y": the members' maps are scaled to equally high peaks; each cell gets the largest value.

    CLIP may answer less to X than to Y. Without the scaling, X would then be the darker one in the joined map.
    """
    images = [member.image for member in members if member.image is not None]
    return QueryMaps(
        _scaled_maximum([member.text for member in members]),
        _scaled_maximum(images) if images else None,
        _scaled_maximum([member.fused for member in members]),
    )


def _scaled_maximum(maps: Sequence[np.ndarray]) -> np.ndarray:
    """(H, W) maps to one: each is scaled until its peak is as high as the highest peak; a map without one stays."""
    peaks = [member.max() for member in maps]
    highest = float(max(peaks))
    scaled = [
        member * np.float32(highest / peak) if peak > 0 else member for member, peak in zip(maps, peaks, strict=True)
    ]
    return np.maximum.reduce(scaled)


def near_peak(semantic: torch.Tensor, allowed: torch.Tensor, config: GemConfig) -> torch.Tensor:
    """The allowed cells beside which a semantic map is at most ``config.peak_margin`` below its highest allowed value.

    The networks weigh a map against all else that they see, and may prefer an object on which the map is low. Here the
    map's ranking of the objects comes first, and the networks choose among what is left.

    Args:
        semantic: (..., H, W); the peak is taken over all of it.
        allowed: (..., H, W) bool, at least one of them.

    Returns:
        (..., H, W) bool. All of ``allowed`` without a margin.
    """
    if config.peak_margin is None:
        return allowed
    highest = (semantic >= semantic[allowed].max() - config.peak_margin) & allowed
    reach = round(config.peak_radius / config.pixel)
    maps = highest.float().reshape(-1, 1, *highest.shape[-2:])
    near = nn.functional.max_pool2d(maps, 2 * reach + 1, stride=1, padding=reach)
    return near.view_as(semantic).bool() & allowed


@dataclass(frozen=True)
class Decision(Choice):
    """Everything on the way from a sentence to an action, for figures.

    Maps are (H, W) float32; ``pick_image`` and ``place_image`` are None where no crop was retrieved.
    """

    pick_text: np.ndarray
    pick_image: np.ndarray | None
    pick_map: np.ndarray
    place_text: np.ndarray
    place_image: np.ndarray | None
    place_map: np.ndarray


class Policy(PickPlacePolicy[SceneEmbedding]):
    """The paper's method, less what its configuration switches off (Table A2)."""

    method = "gem"
    Config = GemConfig
    config: GemConfig
    pick: PickModule
    place: PlaceModule

    @override
    def build(self) -> tuple[PickModule, PlaceModule]:
        return PickModule(self.config, self.clip.dim), PlaceModule(self.config, self.clip.dim)

    @cached_property
    def source(self) -> sources.MapSource:
        """What makes the text-conditioned maps."""
        return sources.SOURCES.find(self.config.semantic_map)(self.clip, self.config)

    @property
    def retrieves(self) -> bool:
        """Whether the maps need the demonstrations' crops."""
        return self.source.sees and self.config.image_weight > 0

    @property
    def recolors(self) -> bool:
        """Whether training recolours its pictures; the maps keep the true colours."""
        return self.config.recolor and self.source.sees

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        return self.source.embed(views)

    def maps(self, scene: SceneEmbedding, query: Query, hidden: EpisodeKey | None = None) -> QueryMaps:
        """A query's maps: Eq. 1-4 up to the depth, which belongs to the networks.

        Args:
            hidden: an episode whose crops must not be retrieved (training's own).
        """
        if self.config.conjuncts and isinstance(query, str):
            return joined([self._member_maps(scene, member, hidden) for member in language.conjuncts(query)])
        return self._member_maps(scene, query, hidden)

    def _member_maps(self, scene: SceneEmbedding, query: Query, hidden: EpisodeKey | None) -> QueryMaps:
        text = self.source.map(scene, query)
        if not self.retrieves:
            return QueryMaps(text, None, text)
        image = semantic_map.image_conditioned_map(scene, query, self.clip, self.memory, hidden)
        fused = semantic_map.fuse(text, image, self.config.text_weight, self.config.image_weight)
        return QueryMaps(text, image, fused)

    @override
    def inputs(self, scene: SceneEmbedding, queries: Queries) -> Inputs:
        pick = self.maps(scene, queries.pick)
        place = self.maps(scene, queries.place)
        return self._inputs(scene, queries, pick.fused, place.fused)

    def _inputs(self, scene: SceneEmbedding, queries: Queries, pick: np.ndarray, place: np.ndarray) -> Inputs:
        return Inputs(rgbd=to_rgbd(scene.heightmap), maps=_named(pick, place), words=self.words(queries))

    @override
    def remember(self, demos: Sequence[Demonstration]) -> None:
        """Fill ``memory`` with the demonstrations' crops, if the maps need them."""
        if self.retrieves:
            crops = demonstrated_crops(demos, self.config.workspace, self.config.top_patch, self.parser)
            self.memory = CropMemory(crops, self.clip)

    @override
    def prepare_step(self, step: DemonstrationStep, key: EpisodeKey) -> PreparedStep:
        if self.retrieves and self.memory is None:
            raise ValueError(f"{self.name} has no crops to retrieve: call remember with the demonstrations first")
        scene = self.embed(step.observation.views)
        queries = self.read(step.instruction)
        hidden = None if self.config.own_crop else key
        pick = self.maps(scene, queries.pick, hidden)
        place = self.maps(scene, queries.place, hidden)
        with_image = label(step, self._inputs(scene, queries, pick.fused, place.fused), self.config)
        return PreparedStep(with_image, replace(with_image, maps=_named(pick.text, place.text)))

    @override
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        return self.pick(inputs.rgbd, inputs.maps["pick"], inputs.words["pick"])

    @override
    def candidates(self, inputs: Inputs, empty_picks: Sequence[Pose2]) -> torch.Tensor:
        """(H, W) bool: where a pick is allowed; besides, only where its semantic map is near its peak."""
        return near_peak(inputs.maps["pick"][0], super().candidates(inputs, empty_picks), self.config)

    @override
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        return self.place(inputs.rgbd, inputs.maps["place"], inputs.words["place"], self.place_crop(inputs, picks))

    def place_crop(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """What the place's kernel is made from: RGB-D and pick map around the pixels ``picks`` (B, 2), (B, 5, h, h)."""
        return crop_at(torch.cat([inputs.rgbd, inputs.maps["pick"]], dim=1), picks, self.config.crop)

    @override
    def decide(
        self, observation: Observation, instruction: str | Queries, empty_picks: Sequence[Pose2] = ()
    ) -> Decision:
        queries = self.read(instruction)
        scene = self.embed(observation.views)
        pick = self.maps(scene, queries.pick)
        place = self.maps(scene, queries.place)
        inputs = self._inputs(scene, queries, pick.fused, place.fused)
        return Decision(
            **vars(self.choose(str(instruction), queries, scene.heightmap, inputs, empty_picks)),
            pick_text=pick.text, pick_image=pick.image, pick_map=pick.fused,
            place_text=place.text, place_image=place.image, place_map=place.fused,
        )  # fmt: skip


def _named(pick: np.ndarray, place: np.ndarray) -> dict[str, torch.Tensor]:
    """The maps (H, W) of pick and place as `Inputs` holds them."""
    return {"pick": torch.from_numpy(pick)[None], "place": torch.from_numpy(place)[None]}
