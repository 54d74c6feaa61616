"""GEM's pick and place modules, and the policy that chains them (Sec. 3.2, Fig. 3, Fig. A3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from gem_lite import language, semantic_map
from gem_lite.clip import Clip
from gem_lite.config import Config
from gem_lite.crop_memory import CropMemory
from gem_lite.networks import CropKernel, LanguageKernel, SemanticRefiner, UNet
from gem_lite.se2 import Action, Pose2, angle_bins
from gem_lite.steerable import SteerableKernel, sample
from gem_lite.tabletop.heightmap import HeightMap
from gem_lite.tabletop.world import Observation

HEIGHT_SCALE = 0.05
"""Metres that become 1 in a network's height channel."""
RGBD = 4


def to_rgbd(heightmap: HeightMap) -> torch.Tensor:
    """(4, H, W) float32: colour around the bare table's, height in units of 50 mm; bare table is 0."""
    rgb = torch.from_numpy(heightmap.rgb).float().permute(2, 0, 1) / 255 - 0.2
    height = torch.from_numpy(heightmap.height)[None] / HEIGHT_SCALE
    return torch.cat([rgb, height])


def crop_at(image: torch.Tensor, pixels: torch.Tensor, size: int) -> torch.Tensor:
    """Unrotated squares around pixels: (B, C, H, W) and (B, 2) integers to (B, C, size, size); outside is 0."""
    half = size // 2
    padded = nn.functional.pad(image, (half, half, half, half))
    corners = zip(padded, pixels.tolist(), strict=True)
    return torch.stack([picture[:, row : row + size, col : col + size] for picture, (row, col) in corners])


class ActionModule(nn.Module):
    """What pick and place share: (A ⊗ M) correlated with a steerable kernel, sampled at R angles."""

    def __init__(self, config: Config, language_dim: int) -> None:
        super().__init__()
        self.config = config
        self.encoder = UNet(RGBD, config.channels, language_dim, config.widths)
        self.refiner = SemanticRefiner(config.channels)
        self.register_buffer("angles", torch.tensor(angle_bins(config.angles), dtype=torch.float32))

    def features(self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """A ⊗ M: the encoder's features gated by the refined semantic map, (B, channels, H, W)."""
        return self.encoder(rgbd, words) * self.refiner(semantic, rgbd[:, 3:])

    def score(self, features: torch.Tensor, kernel: torch.Tensor) -> torch.Tensor:
        """Logits (B, R, H, W) of features against a kernel (B, channels, h, h)."""
        lifted = SteerableKernel.lift(kernel, self.config.rotations, self.config.frequency)
        return sample(lifted.correlate(features), self.angles)


class PickModule(ActionModule):
    """p(pick | observation, language): the kernel comes from the language (Eq. 9)."""

    def __init__(self, config: Config, language_dim: int) -> None:
        super().__init__(config, language_dim)
        self.kernel = LanguageKernel(config.kernel, config.channels, language_dim, config.kernel_widths)

    def forward(self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor) -> torch.Tensor:
        """``rgbd`` (B, 4, H, W), ``semantic`` (B, 1, H, W), ``words`` (B, D) to logits (B, R, H, W)."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(words))


class PlaceModule(ActionModule):
    """p(place | observation, language, pick): the kernel comes from the crop at the pick (Eq. 11)."""

    def __init__(self, config: Config, language_dim: int) -> None:
        super().__init__(config, language_dim)
        self.kernel = CropKernel(RGBD + 1, config.channels, config.fields)

    def forward(
        self, rgbd: torch.Tensor, semantic: torch.Tensor, words: torch.Tensor, crop: torch.Tensor
    ) -> torch.Tensor:
        """As `PickModule`, with ``crop`` (B, 5, h, h) of RGB-D and pick map, unrotated, at the pick."""
        return self.score(self.features(rgbd, semantic, words), self.kernel(crop))


@dataclass(frozen=True)
class Decision:
    """Everything on the way from a sentence to an action, for figures.

    Maps are (H, W) float32; ``pick_image`` and ``place_image`` are None where no crop was retrieved.
    ``pick_logits`` and ``place_logits`` are (R, H, W); ``pick_cell`` and ``place_cell`` are (angle, row, col).
    """

    instruction: str
    phrases: language.Phrases
    heightmap: HeightMap
    pick_text: np.ndarray
    pick_image: np.ndarray | None
    pick_map: np.ndarray
    place_text: np.ndarray
    place_image: np.ndarray | None
    place_map: np.ndarray
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_cell: tuple[int, int, int]
    place_cell: tuple[int, int, int]
    action: Action


class Policy:
    """The whole chain: images and a sentence in, one pick and place out."""

    name = "gem"

    def __init__(self, config: Config, clip: Clip, memory: CropMemory | None, seed: int = 0) -> None:
        self.config, self.clip, self.memory = config, clip, memory
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.pick = PickModule(config, clip.dim)
            self.place = PlaceModule(config, clip.dim)

    def act(self, observation: Observation, instruction: str) -> Action:
        """One pick and place.

        Raises:
            ValueError: the instruction is empty or names no pick or no place.
        """
        return self.decide(observation, instruction).action

    @torch.inference_mode()
    def decide(self, observation: Observation, instruction: str) -> Decision:
        """`act`, with every intermediate result."""
        phrases = language.parse(instruction)
        scene = semantic_map.embed_scene(observation.views, self.clip, self.config)
        texts, images, maps, words = {}, {}, {}, {}
        for role, phrase in (("pick", phrases.pick), ("place", phrases.place)):
            texts[role] = semantic_map.text_conditioned_map(scene, phrase, self.clip)
            images[role] = semantic_map.image_conditioned_map(scene, phrase, self.clip, self.memory)
            maps[role] = semantic_map.fuse(texts[role], images[role], self.config.text_weight, self.config.image_weight)
            words[role] = self.clip.embed_texts([phrase]).cpu()
        rgbd = to_rgbd(scene.heightmap)[None]
        tensor = {role: torch.from_numpy(value)[None, None] for role, value in maps.items()}
        self.pick.eval()
        self.place.eval()
        pick_logits = self.pick(rgbd, tensor["pick"], words["pick"])[0]
        pick_cell = _argmax(pick_logits)
        stack = torch.cat([rgbd, tensor["pick"]], dim=1)
        crop = crop_at(stack, torch.tensor([pick_cell[1:]]), self.config.crop)
        place_logits = self.place(rgbd, tensor["place"], words["place"], crop)[0]
        place_cell = _argmax(place_logits)
        workspace, angles = self.config.workspace, angle_bins(self.config.angles)
        pick = Pose2(*workspace.to_world(*pick_cell[1:]), angles[pick_cell[0]])
        # Δ turns the object as it lies, so the gripper ends at its pick yaw + Δ.
        place = Pose2(*workspace.to_world(*place_cell[1:]), pick.yaw + angles[place_cell[0]])
        return Decision(
            instruction, phrases, scene.heightmap,
            texts["pick"], images["pick"], maps["pick"], texts["place"], images["place"], maps["place"],
            pick_logits.numpy(), place_logits.numpy(), pick_cell, place_cell, Action(pick, place),
        )  # fmt: skip


def _argmax(logits: torch.Tensor) -> tuple[int, int, int]:
    """(angle, row, col) of the largest logit of (R, H, W)."""
    return tuple(int(i) for i in np.unravel_index(int(logits.argmax()), logits.shape))
