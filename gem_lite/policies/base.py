"""What every learned method shares: how it reads, acts and is trained; `PickPlacePolicy` is the interface.

A method turns camera views into a `Scene` of its own, a scene and two queries into `Inputs`, and inputs
into logits over angles and pixels. All the rest, from the sentence to the gripper and from the
demonstration to the loss, is the same for all of them and stands here.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from gem_lite import config as configuration
from gem_lite import language
from gem_lite.actions import PickPlace
from gem_lite.clip import Clip
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.language import Queries
from gem_lite.maps.crop_memory import CropMemory, EpisodeKey, numbered
from gem_lite.maps.semantic_map import embed_query
from gem_lite.policies.samples import Inputs, PreparedStep, Sample, collate, cross_entropy, label, right_bins
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins


def numbered_steps(demos: Sequence[Demonstration]) -> Iterator[tuple[EpisodeKey, DemonstrationStep]]:
    """Every step with the key of its episode, one episode at a time: a large set need not fit into memory.

    Raises:
        ValueError: a step has other cameras than the steps before it.
    """
    expected: set[str] = set()
    for key, demonstration in tqdm(numbered(demos), "scenes", len(demos), unit="episode"):
        for step in demonstration.steps:
            cameras = {view.camera.name for view in step.observation.views}
            expected = expected or cameras
            if cameras != expected:
                raise ValueError(
                    f"demonstration {key[1]} of {key[0]} (seed {demonstration.seed}) has a step with the views of "
                    f"{', '.join(sorted(cameras))}, where the steps before it have those of "
                    f"{', '.join(sorted(expected))}; leave it out or collect it again"
                )
            yield key, step


@dataclass(frozen=True)
class Choice:
    """A decision and what it was read from.

    ``pick_logits`` and ``place_logits`` are (R, H, W); ``pick_cell`` and ``place_cell`` are (angle, row, col), the best
    of the logits; for the pick, of those where `PickPlacePolicy.candidates` allows one.
    """

    instruction: str
    queries: Queries
    heightmap: HeightMap
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_cell: tuple[int, int, int]
    place_cell: tuple[int, int, int]
    action: PickPlace


class Scene(Protocol):
    """What a method made of the camera views before it knows any query."""

    @property
    def heightmap(self) -> HeightMap:
        """The table from above."""


SceneT = TypeVar("SceneT", bound=Scene)


class PickPlacePolicy(nn.Module, ABC, Generic[SceneT]):
    """A learned method: images and a sentence in, one pick and place out.

    A new method has ``method`` and ``Config`` and defines `build`, `embed`, `inputs`, `score_pick` and `score_place`;
    `gem_lite.policies.methods.register` makes it known by its name. The CLIP is no part of the module: it is frozen,
    and `to` leaves it where it is (`Clip.to`).

    Attributes:
        method: the method's name, without what its configuration switches off.
        Config: the class of its configurations.
        pick, place: its two trainable modules.
        memory: the demonstrations' crops, for a method that retrieves them.
        parser: what reads instructions.

    Args:
        seed: of the weights.
        parser: what reads instructions, in place of the parser that the configuration names.

    Raises:
        ValueError: a configuration of another method.
    """

    method: ClassVar[str]
    Config: ClassVar[type[configuration.Config]]
    pick: nn.Module
    place: nn.Module

    def __init__(
        self, config: configuration.Config, clip: Clip, memory: CropMemory | None = None, seed: int = 0,
        parser: language.Parser | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        if not isinstance(config, self.Config):
            raise ValueError(f"config of {self.method} must be a {self.Config.__name__}, got {type(config).__name__}")
        self.config = config
        self.clip = clip
        self.memory = memory
        self.parser = parser or language.PARSERS.find(config.parser)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.pick, self.place = self.build()

    @property
    def device(self) -> torch.device:
        """Where the policy's networks are."""
        return next(self.parameters()).device

    @property
    def name(self) -> str:
        """The name in results and checkpoints, such as ``gem`` or ``gem-without-semantic-map``."""
        return self.method + self.config.variant

    @property
    def recolors(self) -> bool:
        """Whether training recolours its pictures: only where CLIP tells it the true colours beside them."""
        return False

    @property
    def roles(self) -> dict[str, nn.Module]:
        """The two trained modules by name; each has its own loss and optimizer."""
        return {"pick": self.pick, "place": self.place}

    @abstractmethod
    def build(self) -> tuple[nn.Module, nn.Module]:
        """Fresh pick and place modules of ``config``'s sizes."""

    @abstractmethod
    def embed(self, views: Sequence[View]) -> SceneT:
        """All that does not depend on the queries."""

    @abstractmethod
    def inputs(self, scene: SceneT, queries: Queries) -> Inputs:
        """What the networks see of a scene that `embed` made, given the queries."""

    @abstractmethod
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        """Logits (B, R, H, W) of picking at a pixel with a yaw, of batched inputs."""

    @abstractmethod
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        """Logits (B, R, H, W) of placing at a pixel, turned by an angle, what lies at the pixels ``picks`` (B, 2)."""

    def read(self, instruction: str | Queries) -> Queries:
        """The two queries that the method gets to know; ready-made ones stay as they are.

        Raises:
            ValueError: the parser refuses the instruction.
        """
        if isinstance(instruction, Queries):
            return instruction
        queries = self.parser(instruction)
        return queries if self.config.parsing else Queries(instruction, instruction)

    def words(self, queries: Queries) -> dict[str, torch.Tensor]:
        """The queries' embeddings (D,), as `Inputs` holds them: "pick" and "place"."""
        return {"pick": embed_query(queries.pick, self.clip), "place": embed_query(queries.place, self.clip)}

    def remember(self, demos: Sequence[Demonstration]) -> None:
        """Keep what the method later retrieves from demonstrations. Most methods keep nothing."""

    def prepare(self, demos: Sequence[Demonstration], start: int = 0) -> Iterator[PreparedStep]:
        """What training does not change, computed step by step as it is asked for. `remember` comes first.

        Args:
            start: how many steps to leave out at the beginning.

        Raises:
            ValueError: a step lacks a camera's view, or has one more than the others.
        """
        for key, step in itertools.islice(numbered_steps(demos), start, None):
            yield self.prepare_step(step, key)

    def prepare_step(self, step: DemonstrationStep, key: EpisodeKey) -> PreparedStep:
        """`prepare` of one step; ``key`` tells which episode it belongs to."""
        inputs = self.inputs(self.embed(step.observation.views), self.read(step.instruction))
        sample = label(step, inputs, self.config)
        return PreparedStep(sample, sample)

    def losses(self, batch: Sequence[Sample]) -> dict[str, torch.Tensor]:
        """Each module's cross-entropy over pixels and angles; the place is told the demonstrated pick (A.11)."""
        inputs = collate(batch, self.device)
        count = self.config.angles
        picks = [(right_bins(s.pick_yaw, s.pick_symmetry, count), round(s.pick[0]), round(s.pick[1])) for s in batch]
        places = [(right_bins(s.delta, s.place_symmetry, count), round(s.place[0]), round(s.place[1])) for s in batch]
        pixels = torch.tensor([cell[1:] for cell in picks])
        return {
            "pick": cross_entropy(self.score_pick(inputs), picks),
            "place": cross_entropy(self.score_place(inputs, pixels), places),
        }

    def candidates(self, inputs: Inputs, empty_picks: Sequence[Pose2]) -> torch.Tensor:
        """(H, W) bool: where a pick is allowed; ``empty_picks`` as in `act`."""
        return ~near_any(empty_picks, self.config)

    def act(self, observation: Observation, instruction: str | Queries, empty_picks: Sequence[Pose2] = ()) -> PickPlace:
        """One pick and place.

        Args:
            instruction: a sentence, or what to pick and where to place it: phrases or pictures.
            empty_picks: where the tool has grasped nothing since it last held something, by its own log. The pick
                keeps away from there (`Config.empty_radius`).

        Raises:
            ValueError: the parser refuses the instruction.
        """
        return self.decide(observation, instruction, empty_picks).action

    def decide(self, observation: Observation, instruction: str | Queries, empty_picks: Sequence[Pose2] = ()) -> Choice:
        """`act`, with what the action was read from."""
        queries = self.read(instruction)
        scene = self.embed(observation.views)
        return self.choose(str(instruction), queries, scene.heightmap, self.inputs(scene, queries), empty_picks)

    @torch.inference_mode()
    def choose(
        self, instruction: str, queries: Queries, heightmap: HeightMap, inputs: Inputs,
        empty_picks: Sequence[Pose2] = (),
    ) -> Choice:  # fmt: skip
        """The best pick, then the best place for it."""
        self.eval()
        candidates = self.candidates(inputs, empty_picks)
        inputs = collate([inputs], self.device)
        pick_logits = self.score_pick(inputs)[0].cpu()
        pick_cell = _argmax(pick_logits.masked_fill(~candidates, -torch.inf))
        place_logits = self.score_place(inputs, torch.tensor([pick_cell[1:]]))[0].cpu()
        place_cell = _argmax(place_logits)
        workspace, angles = self.config.workspace, angle_bins(self.config.angles)
        pick = Pose2(*workspace.to_world(*pick_cell[1:]), angles[pick_cell[0]])
        # Δ turns the object as it lies, so the gripper ends at its pick yaw + Δ.
        place = Pose2(*workspace.to_world(*place_cell[1:]), pick.yaw + angles[place_cell[0]])
        return Choice(
            instruction, queries, heightmap, pick_logits.numpy(), place_logits.numpy(), pick_cell, place_cell,
            PickPlace(pick, place),
        )  # fmt: skip


def near_any(poses: Sequence[Pose2], config: configuration.Config) -> torch.Tensor:
    """(H, W) bool: cells whose centre is nearer than ``config.empty_radius`` to one of ``poses``."""
    workspace = config.workspace
    rows, cols = np.indices(workspace.shape)
    x, y = workspace.to_world(rows, cols)
    near = np.zeros(workspace.shape, bool)
    for pose in poses:
        near |= np.hypot(x - pose.x, y - pose.y) < config.empty_radius
    return torch.from_numpy(near)


def _argmax(logits: torch.Tensor) -> tuple[int, int, int]:
    """(angle, row, col) of the largest logit of (R, H, W)."""
    angle, row, col = np.unravel_index(int(logits.argmax()), logits.shape)
    return int(angle), int(row), int(col)
