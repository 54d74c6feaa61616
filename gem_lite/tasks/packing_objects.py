"""packing-google-objects: "pack the mug in the brown box", after CLIPort, with this project's own everyday objects.

CLIPort packs scanned objects of Google's data set. Ours stand in for them; the names of the tasks stay, so that a row
can be found beside the paper's.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import MultiPoint, Polygon
from typing_extensions import override

from gem_lite.actions import ExpertAction
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.bodies.shapes import Body
from gem_lite.simulation.environment import Environment
from gem_lite.tasks.goals import Goal, VolumeMetric
from gem_lite.tasks.registry import register
from gem_lite.tasks.spawn import FreeSpace, TableFullError, draw, put_brown_box, split_floor
from gem_lite.tasks.task import Split, Task

UNSEEN = (
    "screwdriver", "wine glass", "chair", "fork", "airplane", "mushroom", "sailboat", "lollipop", "flashlight", "lamp",
    "rabbit", "elephant", "butterfly", "donut", "pizza slice", "corn", "guitar", "robot", "pliers", "rolling pin",
)  # fmt: skip
"""Objects that no training demonstration of the unseen variants shows."""
SEEN = tuple(name for name in objects.NAMES if name not in UNSEEN)
BOX_SIDES = (0.2, 0.35)
"""Each side (m) of the brown box is drawn from this range."""
SHORTEST = 0.08
"""The cells of the brown box have sides (m) between about this and twice as much. Each cell stands for an object."""
OBJECT_RADIUS = 0.06
TOPPLING = 2.0
"""Seconds before the first picture, in which bodies that cannot stand fall over."""
ABOVE = 0.325
"""A point of an object counts as packed below this height (m): CLIPort's 0.30 m above the box's middle."""
SPOTS = 21
"""So many places along each side of the box are tried for an object that leans out of it."""
YAWS = 12
"""So many yaws are tried for every object."""


@register("packing-google-objects-group", {"seen": {"group": True}, "unseen": {"unseen": True, "group": True}})
@register("packing-google-objects-seq", {"seen": {}, "unseen": {"unseen": True}})
class PackingObjects(Task):
    """A brown box and four to nine everyday objects of any colour, with their true sizes.

    A "seen" variant shows all objects in every split, an "unseen" one shows `SEEN` in training and `UNSEEN` in
    validation and test: as in the paper. An object without a free place is left out.

    Args:
        group: one sentence names at least two objects of one name, among at least two of another name, and others. By
            default, the objects are different, and one or more of them are named one after another.
    """

    def __init__(self, split: Split = "train", unseen: bool = False, group: bool = False) -> None:
        super().__init__(split, unseen)
        self.group = group
        self.object_names = objects.NAMES
        if unseen:
            self.object_names = UNSEEN if self.unseen else SEEN

    @override
    def lay_out(self, environment: Environment, rng: np.random.Generator, seed: int) -> list[Goal]:
        free = FreeSpace(environment.workspace, rng, environment.style)
        box, zone = put_brown_box(self, environment, rng, free, BOX_SIDES)
        bodies = []
        extents = {}
        for name in self._draw_names(rng, len(split_floor(rng, zone.size, SHORTEST))):
            color = str(rng.choice(list(colors.RGB)))
            variant = int(rng.integers(*objects.TEST_VARIANTS))
            with suppress(TableFullError):
                pose = free.take(OBJECT_RADIUS)
                body = objects.add_object(environment.client, name, colors.rgba(color), pose, variant)
                bodies.append((name, self.put(environment, body, f"{color} {name}")))
                extents[body.id] = objects.extents(name, variant)
        environment.wait(TOPPLING)
        if self.group:
            named = bodies[0][0]
            group = tuple(body for name, body in bodies if name == named)
            asked = [(f"pack all the {named} objects in the brown box", group)]
        else:
            in_turn = bodies[: int(rng.integers(1, max(2, len(bodies))))]
            asked = [(f"pack the {name} in the brown box", (body,)) for name, body in in_turn]
        self.max_steps = sum(len(group) for _, group in asked) + 1
        metric = VolumeMetric(box, zone.size, ABOVE, extents)
        return [Goal(sentence, group, (box,), metric) for sentence, group in asked]

    def _draw_names(self, rng: np.random.Generator, count: int) -> list[str]:
        if not self.group:
            return draw(rng, self.object_names, count)
        drawn = [str(name) for name in rng.choice(self.object_names, max(count, 4))]
        named, distractor = draw(rng, self.object_names, 2)
        return [named, named, distractor, distractor, *drawn[4:]]

    @override
    def expert(self, environment: Environment) -> ExpertAction | None:
        """The next action. An object goes to the middle of the box. If it leans out of the box, to the freest pose."""
        expert = super().expert(environment)
        if expert is None:
            return None
        goal = self.goals[self._reached_now(environment)]
        body, box = goal.next_move(environment)
        first_try = goal.metric.share(environment, body, box) == 0
        pose = freest_pose(environment, goal.metric, body, 1 if first_try else SPOTS)
        place, table = environment.on_table(pose)
        return replace(expert, action=replace(expert.action, place=place, place_table=table))


def freest_pose(environment: Environment, metric: VolumeMetric, body: Body, spots: int) -> Pose2:
    """The pose of a body in the world, in the metric's zone, with the most space round its footprint.

    The footprint stays between the walls if it can, and then clear of the other objects' footprints if it can.

    Args:
        spots: how many places are tried along each side of the zone; with one, only the middle. `YAWS` yaws at each.
    """
    zone = environment.pose(metric.zone)[0]
    x_max, y_max = np.array(metric.size) / 2
    others = [other for other in environment.bodies if other.id in metric.extents and other.id != body.id]
    covered = shapely.union_all([moved(footprint(environment, metric, other), zone.inverse()) for other in others])
    floor = shapely.box(-x_max, -y_max, x_max, y_max)

    steps = (2 * np.arange(spots) + 1) / spots - 1  # the middles of equal parts of -1 to 1
    x, y, yaw = np.meshgrid(x_max * steps, y_max * steps, angle_bins(YAWS))
    poses = [Pose2(*map(float, pose)) for pose in zip(x.flat, y.flat, yaw.flat, strict=True)]
    outline = moved(footprint(environment, metric, body), environment.pose(body)[0].inverse())
    outlines = [moved(outline, pose) for pose in poses]
    outside = shapely.area(shapely.difference(outlines, floor))
    overlap = shapely.area(shapely.intersection(outlines, covered))
    space = shapely.distance(outlines, shapely.difference(floor, covered).boundary)
    return zone @ poses[np.lexsort((-space, overlap, outside))[0]]


def footprint(environment: Environment, metric: VolumeMetric, body: Body) -> Polygon:
    """The outline of a body's bounding box in the world (m), seen from above."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3))) * metric.extents[body.id]
    position, turn = environment.placement(body)
    return MultiPoint((corners @ turn.T + position)[:, :2]).convex_hull


def moved(outline: Polygon, pose: Pose2) -> Polygon:
    """The outline in the frame in which ``pose`` is the pose of the outline's own frame."""
    cosine = math.cos(pose.yaw)
    sine = math.sin(pose.yaw)
    return affinity.affine_transform(outline, [cosine, -sine, sine, cosine, pose.x, pose.y])
