"""A task, a look, an arm, a method, a map source and a parser of somebody else's: the library knows none of them.

CONTRIBUTING.md shows these as the examples of what is added without an edit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pybullet as p
import pybullet_data
import torch
from torch import nn
from typing_extensions import override

from gem_lite import language, tasks
from gem_lite.actions import GripperState, Outcome, PickPlace
from gem_lite.config import Config
from gem_lite.foundations import colors
from gem_lite.language import Queries, Query
from gem_lite.maps import sources
from gem_lite.policies import methods
from gem_lite.policies.base import Policy
from gem_lite.policies.inputs import RGBD, Inputs, to_rgbd
from gem_lite.policies.transporter import TopView
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.se2 import Pose2
from gem_lite.simulation import effectors, looks
from gem_lite.simulation.bodies import shapes
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, PoseMetric
from gem_lite.tasks.put_block_in_bowl import PutBlockInBowl
from gem_lite.tasks.spawn import FreeSpace
from gem_lite.tasks.task import Task


@tasks.register("block-on-plate")
class BlockOnPlate(Task):
    """One red block and one white plate; the block belongs on the plate."""

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        size = (0.1, 0.1, 0.005)
        plate = shapes.add_box(environment.client, size, colors.rgba("white"), free.take(0.08), movable=False)
        block = shapes.add_block(environment.client, colors.rgba("red"), free.take(0.03))
        self.put(environment, plate, "white plate")
        self.put(environment, block, "red block")
        return [Goal("red block -> white plate", (block,), (plate,), PoseMetric(0.04), grasp_symmetry=np.pi / 2)]


looks.register(looks.Look("night", floor=(0.05, 0.05, 0.1, 1.0)))


@effectors.EFFECTORS.register("arm")
class Arm:
    """A robot arm of seven joints, with a magnet at its end."""

    actions = (PickPlace,)

    def __init__(self, client: int, parked: tuple[float, float, float], log: effectors.Log) -> None:
        self.log, self.held, self.magnet, self.common = log, None, None, {"physicsClientId": client}
        self.outcome = Outcome.NOTHING_HELD
        model = Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf"
        self.id = p.loadURDF(str(model), useFixedBase=True, globalScaling=1.2, **self.common)
        self.joints = range(p.getNumJoints(self.id, **self.common))

    def move(self, x: float, y: float, z: float, steps: int = 120) -> None:
        down = (1.0, 0.0, 0.0, 0.0)
        precision = dict(maxNumIterations=200, residualThreshold=1e-4)
        angles = p.calculateInverseKinematics(self.id, self.joints[-1], (x, y, z), down, **precision, **self.common)
        p.setJointMotorControlArray(self.id, self.joints, p.POSITION_CONTROL, angles, **self.common)
        for _ in range(steps):
            p.stepSimulation(**self.common)
        self.log(GripperState(x, y, 0.0, self.held is not None))

    def pick(self, pose: Pose2, bodies: Sequence[Body]) -> bool:
        self.move(pose.x, pose.y, 0.2)
        movable = {body.id for body in bodies if body.movable}
        for height in np.linspace(0.2, 0.0, 40):
            self.move(pose.x, pose.y, height, steps=10)
            for body in {contact[2] for contact in p.getContactPoints(self.id, **self.common)} & movable:
                ends = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.02))  # the upper face of a block
                joint = (self.id, self.joints[-1], body, -1, p.JOINT_POINT2POINT, *ends)
                self.held, self.magnet = body, p.createConstraint(*joint, **self.common)
                self.outcome = Outcome.HELD
                return True
        self.outcome = Outcome.NOTHING_HELD
        return False

    def place(self, pose: Pose2) -> None:
        self.move(pose.x, pose.y, 0.25)
        self.move(pose.x, pose.y, 0.12)
        self.outcome = Outcome.PLACED

    def park(self) -> None:
        if self.held is not None:
            p.removeConstraint(self.magnet, **self.common)
        self.held = None
        self.move(0.1, 0.0, 0.6)


@tasks.register("put-block-in-bowl", {"by-arm": {}})
class PutBlockInBowlByArm(PutBlockInBowl):
    """The arm carries them out."""

    effector = "arm"


@language.PARSERS.register("arrow")
def parse_arrow(instruction: str) -> Queries:
    """ "X -> Y": X is what to pick, Y is where to place it. Raises ValueError for anything else."""
    match = re.fullmatch(r"(.+) -> (.+)", instruction)
    if match is None:
        raise ValueError(f'instruction must be like "red block -> white plate", got {instruction!r}')
    return Queries(*match.groups())


@sources.SOURCES.register("redness")
class Redness(sources.ViewSource[np.ndarray]):
    """How red each pixel is, whatever the query."""

    @override
    def embed_view(self, view: View, inside: np.ndarray) -> np.ndarray:
        return view.rgb

    @override
    def score_view(self, embedded: np.ndarray, query: Query) -> np.ndarray:
        red, green, blue = np.moveaxis(embedded.astype(np.float32) / 255, -1, 0)
        return np.clip(red - np.maximum(green, blue), 0, 1)


@dataclass(frozen=True)
class OneConvolutionConfig(Config):
    """The numbers of `OneConvolution`.

    Attributes:
        size: side of its kernels (pixels, odd).
    """

    PRESETS: ClassVar[dict[str, dict[str, Any]]] = {**Config.PRESETS, "tiny": {"angles": 4}}

    size: int = 5


@methods.METHODS.register("one-convolution")
class OneConvolution(Policy[TopView]):
    """Picks and places by one convolution each; it does not listen to words."""

    Config = OneConvolutionConfig
    config: OneConvolutionConfig

    @override
    def build(self) -> tuple[nn.Module, nn.Module]:
        pick, place = (
            nn.Conv2d(RGBD, self.config.angles, self.config.size, padding=self.config.size // 2) for _ in range(2)
        )
        return pick, place

    @override
    def embed(self, views: Sequence[View]) -> TopView:
        return TopView(fuse_views(views, self.config.workspace))

    @override
    def inputs(self, scene: TopView, queries: Queries) -> Inputs:
        return Inputs(rgbd=to_rgbd(scene.heightmap))

    @override
    def score_pick(self, inputs: Inputs) -> torch.Tensor:
        return self.pick(inputs.rgbd)

    @override
    def score_place(self, inputs: Inputs, picks: torch.Tensor) -> torch.Tensor:
        return self.place(inputs.rgbd)
