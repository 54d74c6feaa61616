import numpy as np
import pytest
from shapely import affinity, contains_xy

from experiments.clip_tabletop import tiles
from gem_lite.actions import PickPlace
from gem_lite.foundations import colors
from gem_lite.rgbd.camera import Camera
from gem_lite.se2 import Pose2
from gem_lite.simulation.rendering import render

BLUE, YELLOW = colors.rgba("blue"), colors.rgba("yellow")
ABOVE = Camera.pinhole("above", (0.5, 0, 5), (1.0, 0.0, 0.0, 0.0), (120, 120), 5000, 4, 6)
"""Looks straight down at (0.5, 0): 1 mm to a pixel, world +y up in the picture."""


def adders(name="letter R"):
    """One body of each kind and texture."""
    kinds = [lambda client, pose: tiles.add_tile(client, name, BLUE, pose)]
    for texture in tiles.TEXTURES:
        kinds.append(lambda client, pose, t=texture: tiles.add_textured_block(client, t, YELLOW, pose))
        kinds.append(lambda client, pose, t=texture: tiles.add_towel(client, t, BLUE, pose))
    return kinds


def seen(world, body):
    """(pixels of the body, pixels of its ink) from above."""
    _, ids = render(world.client, ABOVE, segmentation=True)
    mine = (ids >= 0) & ((ids & 0xFFFFFF) == body.id)
    return mine, mine & (ids >> 24 == 1)


def drawn(area):
    """The pixels of `ABOVE` that an area (metres) covers."""
    places = (np.arange(120) - 59.5) / 1000
    x, y = np.meshgrid(places, -places)
    return contains_xy(area, x, y)


def overlap(first, second):
    return (first & second).sum() / (first | second).sum()


def test_all_bodies_rest_where_they_are_put(blind, stage):
    poses = [Pose2(0.35 + 0.12 * (i % 3), 0.2 - 0.14 * (i // 3), 0.4 * i) for i in range(7)]
    builders = [lambda client, add=add, pose=pose: add(client, pose) for add, pose in zip(adders(), poses, strict=True)]
    bodies, _ = stage(*builders)
    blind.wait(1.0)
    for body, pose in zip(bodies, poses, strict=True):
        end, height = blind.pose(body)
        assert body.movable
        assert height == pytest.approx(body.rest_height, abs=5e-4)
        assert np.hypot(end.x - pose.x, end.y - pose.y) < 1e-3
        assert np.cos(end.yaw - pose.yaw) > 0.9999


def test_unknown_names_are_named():
    for name in ("letter a", "letter AB", "digit 10", "A", "letter A shape"):
        with pytest.raises(ValueError, match=rf"name .*'{name}'"):
            tiles.add_tile(0, name, BLUE, Pose2(0.5, 0))
    for add in (tiles.add_textured_block, tiles.add_towel):
        with pytest.raises(ValueError, match=r"texture .*striped.*'plaid'"):
            add(0, "plaid", BLUE, Pose2(0.5, 0))


def test_ink_stands_out_from_every_colour():
    assert tiles.ink_on((1, 1, 1, 1)) == tiles.ink_on(YELLOW) == tiles.DARK_INK
    assert tiles.ink_on((0, 0, 0, 1)) == tiles.ink_on(BLUE) == tiles.WHITE_INK
    weights = (0.299, 0.587, 0.114)
    for name in colors.RGB:
        color = colors.rgba(name)
        assert abs(np.dot(weights, np.subtract(tiles.ink_on(color)[:3], color[:3]))) > 0.4


@pytest.mark.parametrize(("one", "other"), [("digit 6", "digit 9"), ("letter M", "letter W"), ("letter N", "letter Z")])
def test_the_bar_tells_the_upright_way(one, other):
    upright = drawn(tiles.tile_ink(one))
    turns = (180,) if one != "letter N" else (90, 270)
    for turn in turns:
        assert overlap(upright, drawn(affinity.rotate(tiles.tile_ink(other), turn, origin=(0, 0)))) < 0.7


def test_no_two_tiles_look_alike_at_any_quarter_turn():
    turned = [
        [drawn(affinity.rotate(tiles.tile_ink(name), 90 * i, origin=(0, 0))) for i in range(4)] for name in tiles.TILES
    ]
    for i, first in enumerate(turned):
        for quarter in range(1, 4):
            assert overlap(first[0], first[quarter]) < 0.8, tiles.TILES[i]
        for j in range(i):
            for other in turned[j]:
                assert overlap(first[0], other) < 0.95, (tiles.TILES[i], tiles.TILES[j])


@pytest.mark.parametrize("name", ["letter F", "digit 6", "letter W", "letter Q"])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_tile_shows_its_letter_from_above_not_mirrored(world, stage, name, yaw):
    (body,), _ = stage(lambda client: tiles.add_tile(client, name, BLUE, Pose2(0.5, 0, yaw)))
    mine, ink = seen(world, body)
    assert mine.sum() == pytest.approx(48**2, rel=0.05)
    assert overlap(ink, drawn(affinity.rotate(tiles.tile_ink(name), np.degrees(yaw), origin=(0, 0)))) > 0.8
    assert world.pose(body)[0].yaw == pytest.approx(yaw, abs=0.01)


@pytest.mark.parametrize("texture", tiles.TEXTURES)
@pytest.mark.parametrize("add", [tiles.add_textured_block, tiles.add_towel])
def test_a_pattern_covers_about_half_of_what_is_seen(world, stage, add, texture):
    (body,), _ = stage(lambda client: add(client, texture, YELLOW, Pose2(0.5, 0, 0.3)))
    mine, ink = seen(world, body)
    assert 0.3 < ink.sum() / mine.sum() < 0.7


@pytest.mark.parametrize("texture", tiles.TEXTURES)
def test_all_faces_of_a_block_but_the_lowest_have_the_pattern(texture):
    size = np.array([0.04, 0.05, 0.03])
    plain, ink = tiles._block(texture, tuple(size))
    for normal in np.concatenate([np.eye(3), -np.eye(3)[:2]]):
        distance = np.abs(normal @ size) / 2

        def area_on_face(mesh, normal=normal, distance=distance):
            there = (mesh.face_normals @ normal > 0.9) & (mesh.triangles_center @ normal > distance - 1e-6)
            return mesh.area_faces[there].sum()

        face = size.prod() / (2 * distance)
        assert area_on_face(plain) + area_on_face(ink) == pytest.approx(face)  # no gap and no overlap
        assert 0.2 < area_on_face(ink) / face < 0.7
        assert (ink.triangles @ normal).max() < distance + 1e-9  # nothing sticks out of the contact shape


def test_meshes_are_small_and_made_once():
    size = (0.04, 0.04, 0.04)
    made = [tiles._tile(name) for name in tiles.TILES]
    made += [mesh for texture in tiles.TEXTURES for mesh in (tiles._block(texture, size), tiles._towel(texture))]
    assert all(len(plain.faces) + len(ink.faces) < 1500 for plain, ink in made)
    assert tiles._tile("letter A")[0] is made[0][0]


def test_a_tile_can_be_picked_and_placed(world, stage):
    (body,), _ = stage(lambda client: tiles.add_tile(client, "letter K", BLUE, Pose2(0.4, 0.2, 0.5)))
    start = world.pose(body)[0]
    assert world.step(PickPlace(start, Pose2(0.6, -0.2, start.yaw))).grasped
    end, height = world.pose(body)
    assert np.hypot(end.x - 0.6, end.y + 0.2) < 0.02
    assert height == pytest.approx(body.rest_height, abs=0.002)
