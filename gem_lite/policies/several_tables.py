"""One policy over several tables (A.12): localise them by their tags, stitch action maps, split the answer.

The policy learned on one table. Its networks are convolutions and its kernels come from words or a crop, so
the same kernel is correlated with the features of every table at once; one argmax over all of them says
which table, which pixel and which angle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from scipy.spatial.transform import Rotation

from gem_lite import language
from gem_lite.policies import gem
from gem_lite.policies.base import RGBD, Inputs, PickPlacePolicy, collate, crop_at
from gem_lite.policies.gem import ActionModule
from gem_lite.rgbd.camera import View
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2, angle_bins
from gem_lite.simulation import tags
from gem_lite.simulation.mobile_world import MobileStep, MobileWorld

SIDESTEPS = (0.0, 0.15, -0.15)
"""Where along a table's edge (m) the robot looks for its tag, one place after the other."""


class LocalisationError(RuntimeError):
    """A table's tag was not found; the message says what was seen instead."""


def find_tags(view: View) -> dict[int, np.ndarray]:
    """The 36h11 tags in a picture: each one's number and its corners (4, 2), (x, y) from its upper left edge."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    corners, numbers, _ = cv2.aruco.ArucoDetector(tags.DICTIONARY, parameters).detectMarkers(view.rgb)
    found = [] if numbers is None else numbers.ravel().tolist()
    return {number: quad[0].astype(float) for number, quad in zip(found, corners, strict=True)}


def table_in_base(view: View, number: int, tag: Pose2) -> Pose2:
    """Where a table's frame is in the base's, from one picture of its tag (Perspective-n-Point).

    Args:
        view: by the body camera, in the base's frame.
        number: the table's tag.
        tag: the tag in the table's frame.

    Raises:
        LocalisationError: the tag is not in the picture; another one, or a half-hidden one, does not count.
    """
    seen = find_tags(view)
    if number not in seen:
        others = f"only tag {', '.join(map(str, sorted(seen)))}" if seen else "no tag at all"
        raise LocalisationError(f"tag {number} is not in the picture, {others}")
    camera = view.camera
    _, turn, at = cv2.solvePnP(tags.CORNERS, seen[number], camera.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    # The tag in the camera's frame, then in the base's: both stand level, so three numbers are left.
    rotation = camera.rotation @ Rotation.from_rotvec(turn.ravel()).as_matrix()
    x, y, _ = camera.rotation @ at.ravel() + camera.position
    return Pose2(x, y, float(np.arctan2(rotation[1, 0], rotation[0, 0]))) @ tag.inverse()


def localise(world: MobileWorld, table: int) -> Pose2:
    """Drive to a table and look for its tag, from another place if need be: its frame in the base's.

    Raises:
        LocalisationError: the tag was not found from any of `SIDESTEPS`.
    """
    said = []
    for sideways in SIDESTEPS:
        world.drive(table, sideways)
        try:
            return table_in_base(world.look(), world.tags[table], world.tag)
        except LocalisationError as error:
            said.append(f"{100 * sideways:+.0f} cm aside: {error}")
    raise LocalisationError(f"table {table} cannot be localised; " + "; ".join(said))


Finder = Callable[[MobileWorld, int], Pose2]
"""Drives to a table and says where its frame is in the base's."""


def by_truth(world: MobileWorld, table: int) -> Pose2:
    """A `Finder` that asks the simulator: for comparisons."""
    world.drive(table)
    return world.true_table(table)


def disturbed(find: Finder, error: Pose2) -> Finder:
    """A `Finder` whose answers are wrong by ``error``: a shift, and a turn about the table's middle."""

    def wrong(world: MobileWorld, table: int) -> Pose2:
        w = world.workspace
        middle = Pose2((w.x_min + w.x_max) / 2, (w.y_min + w.y_max) / 2)
        return find(world, table) @ middle @ error @ middle.inverse()

    return wrong


def stitch(maps: torch.Tensor) -> torch.Tensor:
    """The action maps (N, R, H, W) of N tables as one of (R, H, N W), side by side (Fig. A12, step 2)."""
    return maps.permute(1, 2, 0, 3).flatten(2)


def split(cell: tuple[int, int, int], width: int) -> tuple[int, tuple[int, int, int]]:
    """A stitched map's (angle, row, column) as the table's number and its own (angle, row, column)."""
    angle, row, column = cell
    return column // width, (angle, row, column % width)


def score_tables(
    module: ActionModule, inputs: Inputs, semantic: int, words: torch.Tensor, kernel: torch.Tensor
) -> torch.Tensor:
    """Logits (N, R, H, W) of one kernel against the features of N tables.

    Args:
        inputs: of N tables.
        semantic: the channel of ``inputs.image`` with the phrase's map.
        words: (N, D), the phrase on every table.
        kernel: (1, C, h, h).
    """
    # One table after the other: a batch of convolutions rounds otherwise, and is no faster on a CPU.
    features = [
        module.features(image[None, :RGBD], image[None, semantic : semantic + 1], phrase[None])
        for image, phrase in zip(inputs.image, words, strict=True)
    ]
    return module.score(torch.cat(features), kernel)


@dataclass(frozen=True)
class MobileChoice:
    """One pick and one place over N tables, and what they were read from.

    ``pick_logits`` and ``place_logits`` are (N, R, H, W). ``pick`` is in the frame of table ``pick_table``;
    ``place`` in that of table ``place_table``, its yaw the gripper's there.
    """

    instruction: str
    phrases: language.Phrases
    heightmaps: tuple[HeightMap, ...]
    inputs: Inputs
    pick_logits: np.ndarray
    place_logits: np.ndarray
    pick_table: int
    pick: Pose2
    place_table: int
    place: Pose2


def check_policy(policy: PickPlacePolicy) -> gem.Policy:
    """The policy, if it can choose over several tables.

    Raises:
        ValueError: it is no GEM policy, so that it has no kernel to score every table's features with.
    """
    if not isinstance(policy, gem.Policy):
        raise ValueError(
            f"policy must be a gem policy or one of its ablations to choose over several tables, got {policy.name}: "
            "it makes no kernel that is scored against the features of every table"
        )
    return policy


@torch.inference_mode()
def choose(policy: gem.Policy, observations: Sequence[Observation], instruction: str) -> MobileChoice:
    """What to pick from which table, and where to place it on which. The policy's networks compute where they are.

    Raises:
        ValueError: a policy that cannot (`check_policy`); no observation; the instruction is empty or names no pick
            or no place.
    """
    check_policy(policy)
    if not observations:
        raise ValueError("observations is empty: there must be one for each table")
    phrases = policy.read(instruction)
    scenes = [policy.see(observation.views) for observation in observations]
    seen = [policy.inputs(scene, phrases) for scene in scenes]
    inputs = collate(seen, policy.device)
    policy.pick.eval()
    policy.place.eval()
    workspace, bins = policy.config.workspace, angle_bins(policy.config.angles)

    def best(logits: torch.Tensor) -> tuple[int, tuple[int, int, int]]:
        panorama = stitch(logits).cpu()
        cell = tuple(int(i) for i in np.unravel_index(int(panorama.argmax()), panorama.shape))
        return split(cell, workspace.shape[1])

    words = inputs.pick_words
    pick_logits = score_tables(policy.pick, inputs, RGBD, words, policy.pick.kernel(words[:1]))
    semantic = inputs.image[:, RGBD]
    candidates = gem.near_peak(semantic, torch.ones_like(semantic, dtype=torch.bool), policy.config)
    pick_table, (angle, *pixel) = best(pick_logits.masked_fill(~candidates[:, None], -torch.inf))
    pick = Pose2(*workspace.to_world(*pixel), bins[angle])
    held = inputs.image[pick_table : pick_table + 1, : RGBD + 1]
    kernel = policy.place.kernel(crop_at(held, torch.tensor([pixel]), policy.config.crop))
    place_logits = score_tables(policy.place, inputs, RGBD + 1, inputs.place_words, kernel)
    place_table, (angle, *pixel) = best(place_logits)
    # Δ turns the picture of the one table's crop into the picture of the other table.
    place = Pose2(*workspace.to_world(*pixel), pick.yaw + bins[angle])
    return MobileChoice(
        instruction, phrases, tuple(scene.heightmap for scene in scenes), collate(seen), pick_logits.numpy(force=True),
        place_logits.numpy(force=True), pick_table, pick, place_table, place,
    )  # fmt: skip


def act(world: MobileWorld, choice: MobileChoice, find: Finder = localise) -> MobileStep:
    """Carry out a choice: drive, localise, pick; drive, localise, place. Nothing is done at a table not localised.

    Raises:
        LocalisationError: a table was not found.
        ValueError: a pose lies outside the workspace.
    """
    world.check("choice.pick", choice.pick)
    world.check("choice.place", choice.place)
    table = find(world, choice.pick_table)
    if world.pick(table @ choice.pick):
        if choice.place_table != choice.pick_table:
            table = find(world, choice.place_table)
        world.place(table @ choice.place)
    return world.finish()
