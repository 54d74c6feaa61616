"""GEM's pick and place modules, and the policy that chains them (Sec. 3.2, Fig. 3, Fig. A3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import nn
from typing_extensions import override

from gem_lite import config as configuration
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.language import Queries, Query, is_relation
from gem_lite.maps import sources
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey, collect_crops
from gem_lite.maps.query_maps import QueryMaps, query_maps
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies import augment
from gem_lite.policies.base import METHODS, Policy
from gem_lite.policies.choosing import PLACE_REACH, Choice, Gate, place_gate
from gem_lite.policies.gem_config import GemConfig
from gem_lite.policies.inputs import (
    HEIGHT_SCALE,
    RGBD,
    Cell,
    Inputs,
    PreparedStep,
    Sample,
    crop_at,
    cross_entropy,
    label,
    to_rgbd,
)
from gem_lite.policies.modulated import DepthFields, ModulatedUNet
from gem_lite.policies.networks import CropKernel, LanguageKernel, SemanticRefiner, UNet, set_padding
from gem_lite.rgbd.camera import View
from gem_lite.se2 import angle_bins
from gem_lite.steerable import SteerableKernel
from gem_lite.steerable.correlation import continued, correlate, sample_parts
from gem_lite.steerable.loss import sampled_cross_entropy

ROTATIONS = 8
"""n of the group C_n with whose turns the encoder "steerable" commutes."""
DEPTH_FIELDS = 2
"""The fields of its depth encoder, whose 16 numbers stand beside the paper's 8 channels."""


class ActionModule(nn.Module):
    """What pick and place share: (A ⊗ M) correlated with a steerable kernel, sampled at R angles."""

    angles: torch.Tensor

    def __init__(self, config: GemConfig, language_dim: int) -> None:
        super().__init__()
        self.config = config
        attention = language_dim if config.language_in_attention else None
        sizes = (RGBD, config.channels, attention, config.widths)
        self.encoder: nn.Module
        if config.encoder == "steerable":
            self.encoder = ModulatedUNet(*sizes, ROTATIONS)
            self.refiner = SemanticRefiner(config.channels, DEPTH_FIELDS, DepthFields(DEPTH_FIELDS, ROTATIONS))
        else:
            self.encoder = UNet(*sizes) if config.encoder == "plain" else ModulatedUNet(*sizes, 1)
            self.refiner = SemanticRefiner(config.channels)
        self.continue_border(config.continued)
        self.register_buffer("angles", torch.tensor(angle_bins(config.angles), dtype=torch.float32))

    @property
    def kernel_channels(self) -> int:
        """Channels that a kernel generator makes: those of one kernel, or of one for each angle."""
        return self.config.channels * (self.config.angles if self.config.kernels == "free" else 1)

    def features(self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """A ⊗ M: the encoder's features gated by the refined semantic map, (B, channels, H, W)."""
        return self.encoder(rgbd, words) * self.refiner(semantic, rgbd[:, 3:])

    def continue_border(self, continued: bool) -> None:
        """What the encoder and the refiner see beyond their pictures, see `GemConfig.continued`."""
        for encoder in (self.encoder, self.refiner):
            set_padding(encoder, continued)

    def respond(self, features: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
        """The response of features to a lifted kernel (B, C, h, h): `SteerableKernel.correlate_parts`."""
        lifted = SteerableKernel.lift(kernel.float(), self.config.rotations, self.config.frequency)
        return self.correlated(lifted.correlate_parts, features, kernel)

    def correlated(
        self, correlation: Callable[[torch.Tensor], torch.Tensor], features: torch.Tensor, kernel: torch.Tensor
    ) -> torch.Tensor:
        """A correlation of features with a kernel. Where the policy acts, they go on beyond the table (`continued`)."""
        return continued(correlation, features.float(), 0 if self.training else kernel.shape[-1] // 2)

    def score(self, features: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
        """Logits (B, R, H, W) of features against a kernel (B, kernel_channels, h, h)."""
        # Fourier transforms and logits need full precision, even where training uses mixed precision.
        with torch.autocast(features.device.type, enabled=False):
            if self.config.kernels == "steerable":
                return sample_parts(self.respond(features, kernel), self.angles)
            kernels = kernel.float().unflatten(1, (-1, self.config.channels))
            scores = self.correlated(lambda whole: correlate(whole, kernels), features, kernel)
            return scores.expand(-1, self.config.angles, -1, -1)  # an unrotated kernel gives every angle the same score

    def loss(self, features: torch.Tensor, kernel: torch.Tensor, cells: Sequence[Cell]) -> torch.Tensor:
        """The cross-entropy of `score` to labels; for a steerable kernel without the logits of all angles."""
        if self.config.kernels != "steerable":
            return cross_entropy(self.score(features, kernel), cells)
        with torch.autocast(features.device.type, enabled=False):
            return sampled_cross_entropy(self.respond(features, kernel), self.angles, cells)


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
        """As `PickModule`, with ``crop`` (B, 5, h, h): RGB-D and pick map around the pick, not rotated."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(crop))


@dataclass(frozen=True)
class GemChoice(Choice):
    """A choice with all maps that led to it, for figures.

    Maps are (H, W) float32; ``pick_image`` and ``place_image`` are None if no crop was retrieved.
    """

    pick_text: np.ndarray
    pick_image: np.ndarray | None
    pick_map: np.ndarray
    place_text: np.ndarray
    place_image: np.ndarray | None
    place_map: np.ndarray


@METHODS.register("gem")
class Gem(Policy[SceneEmbedding]):
    """The paper's method, without the parts that its configuration switches off (Table A2)."""

    Config = GemConfig
    choice = GemChoice
    one_kernel = True
    config: GemConfig
    pick: PickModule
    place: PlaceModule

    @override
    def build(self) -> tuple[PickModule, PlaceModule]:
        return PickModule(self.config, self.language_dim), PlaceModule(self.config, self.language_dim)

    @cached_property
    def source(self) -> sources.MapSource:
        """The source of the text-conditioned maps."""
        return sources.SOURCES.find(self.config.semantic_map)(self.clip, self.config)

    @override
    def act_as(self, config: configuration.Config) -> None:
        super().act_as(config)
        for module in (self.pick, self.place):
            module.continue_border(self.config.continued)
        self.__dict__.pop("source", None)  # The source has the configuration, too.

    @property
    def retrieves(self) -> bool:
        """Whether the maps need the demonstrations' crops."""
        return self.source.uses_views and self.config.image_weight > 0

    @property
    @override
    def recolors(self) -> bool:
        return self.config.recolor and self.source.uses_views  # The maps keep the true colours.

    @override
    def embed(self, views: Sequence[View]) -> SceneEmbedding:
        return self.source.embed(views)

    def maps(self, scene: SceneEmbedding, query: Query, hidden: EpisodeKey | None = None) -> QueryMaps:
        """A query's maps, see `query_maps`.

        Args:
            hidden: an episode whose crops must not be retrieved; in training, the step's own.
        """
        return query_maps(self.source, scene, query, self.config, self.memory, hidden)

    @override
    def inputs(self, scene: SceneEmbedding, queries: Queries) -> Inputs:
        return self.explained_inputs(scene, queries)[0]

    @override
    def explained_inputs(self, scene: SceneEmbedding, queries: Queries) -> tuple[Inputs, dict[str, Any]]:
        pick = self.maps(scene, queries.pick)
        place = self.maps(scene, queries.place)
        return self._inputs(scene, queries, pick.fused, place.fused), {
            "pick_text": pick.text, "pick_image": pick.image, "pick_map": pick.fused,
            "place_text": place.text, "place_image": place.image, "place_map": place.fused,
        }  # fmt: skip

    def _inputs(self, scene: SceneEmbedding, queries: Queries, pick: np.ndarray, place: np.ndarray) -> Inputs:
        return Inputs(rgbd=to_rgbd(scene.heightmap), maps=_maps_by_role(pick, place), words=self.words(queries))

    @override
    def remember(self, demos: Sequence[Demonstration]) -> None:
        """Fill ``memory`` with the demonstrations' crops, if the maps need them."""
        if self.retrieves:
            crops = list(collect_crops(demos, self.config.workspace, self.config.top_patch, self.read))
            if crops:  # Sentences may hold pictures alone.
                self.memory = CropMemory(crops, self.clip)

    @override
    def prepare_step(self, step: DemonstrationStep, key: EpisodeKey) -> PreparedStep:
        queries = self.read(step.instruction)
        has_words = any(isinstance(query, str) for query in (queries.pick, queries.place))
        if self.retrieves and self.memory is None and has_words:
            raise ValueError(f"{self.method} has no crops to retrieve: call remember with the demonstrations first")
        scene = self.embed(step.observation.views)
        hidden = None if self.config.own_crop else key
        pick = self.maps(scene, queries.pick, hidden)
        place = self.maps(scene, queries.place, hidden)
        both_maps = label(step, self._inputs(scene, queries, pick.fused, place.fused), self.config)
        return replace(both_maps, maps=_maps_by_role(pick.text, place.text)), both_maps

    @property
    @override
    def form_chances(self) -> tuple[float, float]:
        """Of the form with the text-conditioned maps alone, and of the one with both kinds of map."""
        return self.config.drop_image_map, 1 - self.config.drop_image_map

    @override
    def augmented(self, sample: Sample, rng: np.random.Generator) -> Sample:
        moved = augment.moved(rng, sample, self.config.turn)
        rescaled = augment.rescaled(rng, moved, self.config.map_gain, self.config.map_offset)
        # Light multiplies true colours, so it comes first. With 0, no random number is drawn, as in earlier trainings.
        relit = augment.relit(rng, rescaled, self.config.uneven_light) if self.config.uneven_light else rescaled
        return augment.recolored(rng, relit) if self.recolors else relit

    @override
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        return self.pick(inputs.rgbd, inputs.maps["pick"], inputs.words["pick"])

    @override
    def gates(self, views: Sequence[View], inputs: Inputs, queries: Queries) -> dict[str, Gate]:
        height = inputs.rgbd[3] * HEIGHT_SCALE
        gates = {}
        if not queries.push and self.config.peak_margin is not None:  # A push starts where the thing's map is low.
            gates["pick"] = Gate(inputs.maps["pick"][0], height, self.config)
        if is_relation(queries.place) and self.source.uses_views:
            gates["place"] = place_gate(inputs.maps["place"][0], height)
        elif self.config.place_lead is not None:
            config = replace(self.config, peak_radius=PLACE_REACH * self.config.peak_radius)
            gates["place"] = Gate(inputs.maps["place"][0], height, config, self.config.place_lead)
        return gates

    @override
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        return self.place(inputs.rgbd, inputs.maps["place"], inputs.words["place"], self.place_crop(inputs, picks))

    @override
    def pick_loss(self, inputs: Inputs, cells: Sequence[Cell]) -> torch.Tensor:
        features = self.pick.features(inputs.rgbd, inputs.maps["pick"], inputs.words["pick"])
        return self.pick.loss(features, self.pick.kernel(inputs.words["pick"]), cells)

    @override
    def place_loss(self, inputs: Inputs, picks: torch.Tensor, cells: Sequence[Cell]) -> torch.Tensor:
        features = self.place.features(inputs.rgbd, inputs.maps["place"], inputs.words["place"])
        return self.place.loss(features, self.place.kernel(self.place_crop(inputs, picks)), cells)

    def place_crop(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """The crops (B, 5, h, h) that make the place kernels: RGB-D and pick map around the pixels ``picks`` (B, 2)."""
        return crop_at(torch.cat([inputs.rgbd, inputs.maps["pick"]], dim=1), picks, self.config.crop)

    @override
    def score_picks(self, inputs: Inputs) -> torch.Tensor:
        return self._score_tables(self.pick, inputs, "pick", self.pick.kernel(inputs.words["pick"][:1]))

    @override
    def score_places(self, inputs: Inputs, table: int, pixel: tuple[int, int]) -> torch.Tensor:
        scene = torch.cat([inputs.rgbd, inputs.maps["pick"]], dim=1)[table : table + 1]
        crop = crop_at(scene, torch.tensor([pixel]), self.config.crop)
        return self._score_tables(self.place, inputs, "place", self.place.kernel(crop))

    def _score_tables(self, module: ActionModule, inputs: Inputs, role: str, kernel: torch.Tensor) -> torch.Tensor:
        """Logits (N, R, H, W) of one kernel (1, C, h, h) against the features of N tables, with the maps of a role."""
        # One table after the other: a batch of convolutions is rounded differently, and is no faster on a CPU.
        features = [
            module.features(rgbd[None], semantic[None], words[None])
            for rgbd, semantic, words in zip(inputs.rgbd, inputs.maps[role], inputs.words[role], strict=True)
        ]
        return module.score(torch.cat(features), kernel)


def _maps_by_role(pick: np.ndarray, place: np.ndarray) -> dict[str, torch.Tensor]:
    """The maps (H, W) of pick and place as `Inputs` holds them."""
    return {"pick": torch.from_numpy(pick)[None], "place": torch.from_numpy(place)[None]}
