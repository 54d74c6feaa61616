"""GEM's pick and place modules, and the policy that chains them (Sec. 3.2, Fig. 3, Fig. A3)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from gem_lite import language
from gem_lite.config import Config
from gem_lite.correlation import correlate, sample
from gem_lite.demonstrations import Demonstration
from gem_lite.maps import semantic_map
from gem_lite.maps.crop_memory import CropMemory, demonstrated_crops
from gem_lite.maps.semantic_map import SceneEmbedding
from gem_lite.policies.base import Choice, PickPlacePolicy, numbered_steps
from gem_lite.policies.networks import CropKernel, LanguageKernel, SemanticRefiner, UNet
from gem_lite.policies.samples import RGBD, Inputs, PreparedStep, crop_at, label, to_rgbd
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.steerable import SteerableKernel


class ActionModule(nn.Module):
    """What pick and place share: (A ⊗ M) correlated with a steerable kernel, sampled at R angles."""

    def __init__(self, config: Config, language_dim: int) -> None:
        super().__init__()
        self.config = config
        attention = language_dim if config.language_in_attention else None
        self.encoder = UNet(RGBD, config.channels, attention, config.widths)
        self.refiner = SemanticRefiner(config.channels)
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
            one_or_all = correlate(features, kernel.unflatten(1, (-1, self.config.channels)))
            return one_or_all.expand(-1, self.config.angles, -1, -1)


class PickModule(ActionModule):
    """p(pick | observation, language): the kernel comes from the language (Eq. 9)."""

    def __init__(self, config: Config, language_dim: int) -> None:
        super().__init__(config, language_dim)
        self.kernel = LanguageKernel(config.kernel, self.kernel_channels, language_dim, config.kernel_widths)

    def forward(self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``semantic`` (B, 1, H, W), ``words`` (B, D) to logits (B, R, H, W)."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(words))


class PlaceModule(ActionModule):
    """p(place | observation, language, pick): the kernel comes from the crop at the pick (Eq. 11)."""

    def __init__(self, config: Config, language_dim: int) -> None:
        super().__init__(config, language_dim)
        self.kernel = CropKernel(RGBD + 1, self.kernel_channels, config.fields)

    def forward(
        self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor, crop: torch.Tensor
    ) -> torch.Tensor:
        """As `PickModule`, with ``crop`` (B, 5, h, h) of RGB-D and pick map, unrotated, at the pick."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(crop))


@dataclass(frozen=True)
class PhraseMaps:
    """The semantic maps of one phrase, (H, W) float32; ``image`` is None where no crop was retrieved."""

    text: np.ndarray
    image: np.ndarray | None
    fused: np.ndarray


def joined(members: Sequence[PhraseMaps]) -> PhraseMaps:
    """The maps of "X and Y": the members' maps are scaled to equally high peaks; each cell gets the largest value.

    CLIP may answer less to X than to Y. Without the scaling, X would then be the darker one in the joined map.
    """
    images = [member.image for member in members if member.image is not None]
    return PhraseMaps(
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


def near_peak(semantic: torch.Tensor, allowed: torch.Tensor, config: Config) -> torch.Tensor:
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


class Policy(PickPlacePolicy):
    """The whole chain of GEM, less what its configuration switches off (Table A2)."""

    method = "gem"

    def build(self) -> tuple[PickModule, PlaceModule]:
        """See `PickPlacePolicy`."""
        return PickModule(self.config, self.clip.dim), PlaceModule(self.config, self.clip.dim)

    @property
    def recolors(self) -> bool:
        """See `PickPlacePolicy`."""
        return self.config.recolor and self.config.semantic_map != "none"

    def see(self, views: Sequence[View]) -> SceneEmbedding:
        """See `PickPlacePolicy`."""
        return semantic_map.embed_scene(views, self.clip, self.config)

    def maps(self, scene: SceneEmbedding, phrase: str, exclude_episode: int | None = None) -> PhraseMaps:
        """A phrase's maps: Eq. 1-4 up to the depth, which belongs to the networks.

        Args:
            exclude_episode: an episode whose crops must not be found (training's own).
        """
        if self.config.semantic_map == "none":
            ones = np.ones(self.config.workspace.shape, np.float32)
            return PhraseMaps(ones, None, ones)
        members = language.conjuncts(phrase) if self.config.conjuncts else (phrase,)
        return joined([self._member_maps(scene, member, exclude_episode) for member in members])

    def _member_maps(self, scene: SceneEmbedding, phrase: str, exclude_episode: int | None) -> PhraseMaps:
        single = self.config.semantic_map == "single-view"
        text_map = semantic_map.single_view_map if single else semantic_map.text_conditioned_map
        text = text_map(scene, phrase, self.clip)
        image = semantic_map.image_conditioned_map(scene, phrase, self.clip, self.memory, exclude_episode)
        fused = semantic_map.fuse(text, image, self.config.text_weight, self.config.image_weight)
        return PhraseMaps(text, image, fused)

    def inputs(self, scene: SceneEmbedding, phrases: language.Phrases) -> Inputs:
        """See `PickPlacePolicy`."""
        fused = [self.maps(scene, phrase).fused for phrase in (phrases.pick, phrases.place)]
        return self._join(scene, fused, phrases)

    def _join(self, scene: SceneEmbedding, maps: Sequence[np.ndarray], phrases: language.Phrases) -> Inputs:
        """``image`` (6, H, W): RGB-D, then the pick and the place semantic map."""
        image = torch.cat([to_rgbd(scene.heightmap), torch.from_numpy(np.stack(maps))])
        return Inputs(image=image, **self.words(phrases))

    def remember(self, demos: Sequence[Demonstration]) -> None:
        """See `PickPlacePolicy`: the crops at the demonstrated picks and places."""
        if self.config.semantic_map != "none" and self.config.image_weight > 0:
            self.memory = CropMemory(demonstrated_crops(demos, self.config.workspace, self.config.top_patch), self.clip)

    def prepare(self, demos: Sequence[Demonstration], start: int = 0) -> Iterator[PreparedStep]:
        """See `PickPlacePolicy`; image-conditioned maps come from what the policy `remember`s."""
        for episode, step in itertools.islice(numbered_steps(demos, "semantic maps"), start, None):
            scene = self.see(step.observation.views)
            phrases = self.read(step.instruction)
            hidden = None if self.config.own_crop else episode
            maps = [self.maps(scene, phrase, hidden) for phrase in (phrases.pick, phrases.place)]
            with_image, text_only = (
                label(step, self._join(scene, [getattr(found, kind) for found in maps], phrases), self.config)
                for kind in ("fused", "text")
            )
            yield PreparedStep(with_image, text_only)

    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        """See `PickPlacePolicy`."""
        return self.pick(inputs.image[:, :RGBD], inputs.image[:, 4:5], inputs.pick_words)

    def candidates(self, inputs: Inputs, empty_picks: Sequence[Pose2]) -> torch.Tensor:
        """See `PickPlacePolicy`; besides, only where the pick's semantic map is near its peak."""
        return near_peak(inputs.image[RGBD], super().candidates(inputs, empty_picks), self.config)

    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """See `PickPlacePolicy`."""
        crop = crop_at(inputs.image[:, : RGBD + 1], picks, self.config.crop)
        return self.place(inputs.image[:, :RGBD], inputs.image[:, 5:6], inputs.place_words, crop)

    def decide(self, observation: Observation, instruction: str, empty_picks: Sequence[Pose2] = ()) -> Decision:
        """`act`, with every intermediate result."""
        phrases = self.read(instruction)
        scene = self.see(observation.views)
        pick, place = self.maps(scene, phrases.pick), self.maps(scene, phrases.place)
        inputs = self._join(scene, [pick.fused, place.fused], phrases)
        return Decision(
            **vars(self.choose(instruction, phrases, scene.heightmap, inputs, empty_picks)),
            pick_text=pick.text, pick_image=pick.image, pick_map=pick.fused,
            place_text=place.text, place_image=place.image, place_map=place.fused,
        )  # fmt: skip
