"""put-beside: "put the red block to the left of the green bowl". This family is ours; the paper has no relations."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pybullet as p
from typing_extensions import override

from gem_lite.foundations import colors
from gem_lite.language import BETWEEN, RELATIONS, anchor_count
from gem_lite.maps import relations
from gem_lite.se2 import Pose2, Workspace
from gem_lite.simulation.bodies import objects, shapes
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, Target
from gem_lite.tasks.packing_objects import OBJECT_RADIUS, SEEN, TOPPLING, UNSEEN
from gem_lite.tasks.put_block_in_bowl import BLOCK_RADIUS
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, TableFullError, draw
from gem_lite.tasks.task import Split, Task

SAID = {
    "left of": "to the left of", "right of": "to the right of", "in front of": "in front of", "behind": "behind",
    "beside": "next to", BETWEEN: BETWEEN,
}  # fmt: skip
"""The words of the sentence for each relation."""
SECTOR = math.radians(45)
"""The direction from the other thing to the placed one is at most so far (radians) off that of the relation."""
REACH = 0.15
"""The free space (m) between the two is at most this wide."""
MIDDLE_HALF = (0.25, 0.75)
"""Between two things, a thing has a share of the way from one to the other that lies in this range."""
OFF_LINE = 0.08
"""It is at most this far (m) from the line through both."""
CONTACT = 0.001
"""Bodies that are at most this far (m) apart touch."""
DISTRACTORS = 4
LAYOUTS = 1000
"""So many layouts are tried until the place of the sentence is free."""


@dataclass(frozen=True)
class RelationMetric:
    """A body is where a relation to other bodies says, and touches none of them: it lies on the table alone.

    The tolerances are wider than the places that `maps.relations` offers. A body's target says where an expert puts
    it; it does not change the share.

    Attributes:
        relation: a value of `language.RELATIONS`.
        anchors: one body, or two for "between".
        symmetry: 0, because every yaw is right.
    """

    relation: str
    anchors: tuple[Body, ...]
    symmetry: float = 0.0

    def share(self, environment: Environment, body: Body, target: Target) -> float:
        """1 if the relation holds, else 0."""
        pose = environment.pose(body)[0]
        anchors = [environment.pose(anchor)[0] for anchor in self.anchors]
        near = self.relation == BETWEEN or _near(environment, body, self.anchors[0], REACH)
        alone = not any(_near(environment, body, other, CONTACT) for other in environment.bodies if other != body)
        on_table = environment.workspace.contains(pose.x, pose.y)
        return float(near and alone and on_table and holds(self.relation, pose, anchors))


def _near(environment: Environment, body: Body, other: Body, distance: float) -> bool:
    """Whether two bodies are at most ``distance`` metres apart."""
    return bool(p.getClosestPoints(body.id, other.id, distance, physicsClientId=environment.client))


def holds(relation: str, pose: Pose2, anchors: list[Pose2]) -> bool:
    """Whether a relation to one thing or two holds, apart from the distance."""
    if relation == BETWEEN:
        start, end = (np.array([anchor.x, anchor.y]) for anchor in anchors)
        share, off = relations.along_line(pose.x, pose.y, start, end)
        return MIDDLE_HALF[0] <= share <= MIDDLE_HALF[1] and abs(off) <= OFF_LINE
    directions = relations.DIRECTIONS
    steps = directions.values() if relation == relations.BESIDE else [directions[relation]]
    x, y = pose.x - anchors[0].x, pose.y - anchors[0].y
    return any(step_x * x + step_y * y >= math.cos(SECTOR) * math.hypot(x, y) for step_x, step_y in steps)


@dataclass(frozen=True)
class Layout:
    """The poses of an episode: of the thing to move, of its anchors, of distractors, and where the expert puts it."""

    thing: Pose2
    anchors: list[Pose2]
    distractors: list[Pose2]
    target: Pose2


@register(
    "put-beside",
    {
        "seen-colors": {}, "unseen-colors": {"unseen": True}, "seen-objects": {"everyday": True},
        "unseen-objects": {"unseen": True, "everyday": True},
    },
)  # fmt: skip
class PutBeside(Task):
    """A thing, one other thing that the sentence names, or two for "between", and up to four distractors.

    The thing is a block; the others are blocks and bowls. All have different colours, of which the distractors take the
    remaining ones of the full list in order. Scenes in which the place is not free, or in which the thing is there from
    the beginning, are drawn again.

    Args:
        everyday: all are everyday objects with different names and of any colour: `SEEN` in training, and in every
            split of the seen variant; `UNSEEN` in validation and test of the unseen one.
    """

    max_steps = 2

    def __init__(self, split: Split = "train", unseen: bool = False, everyday: bool = False) -> None:
        super().__init__(split, unseen)
        self.everyday = everyday

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        relation = str(rng.choice(list(dict.fromkeys(RELATIONS.values()))))
        count = 1 + anchor_count(relation)
        named = self._draw_named(rng, count)
        names = named + self._distractors(rng, named)
        radii = [self._radius(environment, name) for name in names]
        layout = draw_layout(environment, rng, relation, radii)
        poses = [layout.thing, *layout.anchors, *layout.distractors]
        bodies = [
            self._add(environment, rng, name, pose, movable=not 0 < number < count)
            for number, (name, pose) in enumerate(zip(names, poses, strict=False))  # Distractors may find no place.
        ]
        if self.everyday:
            environment.wait(TOPPLING)
        thing, *anchors = (f"the {name}" for name in named)
        sentence = f"put {thing} {SAID[relation]} {' and '.join(anchors)}"
        metric = RelationMetric(relation, tuple(bodies[1:count]))
        symmetry = 0.0 if self.everyday else math.pi / 2
        return [Goal(sentence, (bodies[0],), (layout.target,), metric, grasp_symmetry=symmetry)]

    def _draw_named(self, rng: np.random.Generator, count: int) -> list[str]:
        if self.everyday:
            return draw(rng, UNSEEN if self.unseen else SEEN, count)
        self.named_colors = tuple(draw(rng, self.palette, count))
        kinds = ["block", *(str(kind) for kind in rng.choice(["block", "bowl"], count - 1))]
        return [f"{color} {kind}" for color, kind in zip(self.named_colors, kinds, strict=True)]

    def _distractors(self, rng: np.random.Generator, named: list[str]) -> list[str]:
        if self.everyday:
            others = [name for name in (UNSEEN if self.unseen else SEEN) if name not in named]
            return draw(rng, others, DISTRACTORS)
        others = [color for color in colors.RGB if color not in self.named_colors][:DISTRACTORS]
        return [f"{color} {rng.choice(['block', 'bowl'])}" for color in others]

    def _radius(self, environment: Environment, name: str) -> float:
        if self.everyday:
            return OBJECT_RADIUS
        return max(profile.rim for profile in environment.style.bowls) if name.endswith("bowl") else BLOCK_RADIUS

    def _add(self, environment: Environment, rng: np.random.Generator, name: str, pose: Pose2, movable: bool) -> Body:
        if self.everyday:
            color = str(rng.choice(list(colors.RGB)))
            variant = int(rng.integers(*objects.TEST_VARIANTS))
            body = objects.add_object(environment.client, name, colors.rgba(color), pose, variant)
            return self.put(environment, body, f"{color} {name}")
        color, kind = name.split()
        if kind == "block":
            body = shapes.add_block(environment.client, colors.rgba(color), pose)
        else:
            profiles = environment.style.bowls
            profile = profiles[int(rng.integers(len(profiles)))]
            body = shapes.add_bowl(environment.client, colors.rgba(color), pose, movable, profile)
        return self.put(environment, body, name)


def draw_layout(environment: Environment, rng: np.random.Generator, relation: str, radii: list[float]) -> Layout:
    """Draw poses until the place of a relation is free and the thing is not there yet.

    Args:
        radii: of the bounding circles (m) of the thing, its anchors and the distractors.

    Raises:
        TableFullError: no layout was such.
    """
    count = anchor_count(relation)
    workspace = environment.workspace
    for _ in range(LAYOUTS):
        free = FreeSpace(workspace, rng, environment.style)
        poses: list[Pose2] = []
        with suppress(TableFullError):
            for radius in radii:
                poses.append(free.take(radius))
        if len(poses) <= count:
            continue
        thing, *anchors = poses[: count + 1]
        discs = [disc(workspace, pose, radius) for pose, radius in zip(poses, radii, strict=False)]
        places = relations.free_places(relation, discs[1 : count + 1], np.any(discs, axis=0), workspace)
        near = relation == BETWEEN or math.dist((thing.x, thing.y), (anchors[0].x, anchors[0].y)) < REACH + sum(
            radii[:2]
        )
        if places.any() and not (near and holds(relation, thing, anchors)):
            row, col = np.unravel_index(relations.graded(places, workspace).argmax(), places.shape)
            return Layout(thing, anchors, poses[count + 1 :], Pose2(*workspace.to_world(float(row), float(col))))
    raise TableFullError(f"no layout of {LAYOUTS} has a free place {relation} a thing")


def disc(workspace: Workspace, pose: Pose2, radius: float) -> np.ndarray:
    """The cells (H, W) bool whose centre is at most ``radius`` metres from a pose."""
    x, y = workspace.to_world(*np.indices(workspace.shape))
    return np.hypot(x - pose.x, y - pose.y) <= radius
