import numpy as np
import pytest
from shapely import affinity, contains_xy

from experiments.clip_tabletop import printed
from gem_lite.foundations import colors
from gem_lite.rgbd.camera import Camera
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import tiles
from gem_lite.simulation.rendering import render

BLUE, YELLOW = colors.rgba("blue"), colors.rgba("yellow")
ABOVE = Camera.pinhole("above", (0.5, 0, 5), (1.0, 0.0, 0.0, 0.0), (120, 120), 5000, 4, 6)
"""Looks straight down at (0.5, 0): 1 mm to a pixel, world +y up in the picture."""


def adders(name="letter R"):
    """One body of each kind and texture."""
    kinds = [lambda client, pose: printed.add_tile(client, name, BLUE, pose)]
    for texture in printed.TEXTURES:
        kinds.append(lambda client, pose, t=texture: printed.add_textured_block(client, t, YELLOW, pose))
        kinds.append(lambda client, pose, t=texture: printed.add_towel(client, t, BLUE, pose))
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


@pytest.mark.parametrize("name", ["letter a", "letter AB", "digit 10", "A", "letter A shape"])
def test_unknown_tiles_are_named(name):
    with pytest.raises(ValueError, match=rf"name .*'{name}'"):
        printed.add_tile(0, name, BLUE, Pose2(0.5, 0))
    for add in (printed.add_textured_block, printed.add_towel):
        with pytest.raises(ValueError, match=r"texture .*striped.*'plaid'"):
            add(0, "plaid", BLUE, Pose2(0.5, 0))


def test_ink_stands_out_from_every_colour():
    assert tiles.ink_on((1, 1, 1, 1)) == tiles.ink_on(YELLOW) == tiles.DARK_INK
    assert tiles.ink_on((0, 0, 0, 1)) == tiles.ink_on(BLUE) == tiles.WHITE_INK
    weights = (0.299, 0.587, 0.114)
    for name in colors.RGB:
        color = colors.rgba(name)
        assert abs(np.dot(weights, np.subtract(tiles.ink_on(color)[:3], color[:3]))) > 0.4


def test_no_two_tiles_look_alike_at_any_quarter_turn():
    turned = [
        [drawn(affinity.rotate(tiles.tile_ink(name), 90 * i, origin=(0, 0))) for i in range(4)] for name in tiles.TILES
    ]
    for i, (upright, *others) in enumerate(turned):
        assert max(overlap(upright, other) for other in others) < 0.8, tiles.TILES[i]
        for j in range(i):
            assert max(overlap(upright, other) for other in turned[j]) < 0.95, (tiles.TILES[i], tiles.TILES[j])
    # The bar tells the upright way.
    for one, other, quarter in (("digit 6", "digit 9", 2), ("letter M", "letter W", 2), ("letter N", "letter Z", 1)):
        for turn in {quarter, 4 - quarter}:
            assert overlap(turned[tiles.TILES.index(one)][0], turned[tiles.TILES.index(other)][turn]) < 0.7


@pytest.mark.parametrize("name", ["letter F", "digit 6", "letter W", "letter Q"])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_tile_shows_its_letter_from_above_not_mirrored(world, stage, name, yaw):
    (body,), _ = stage(lambda client: printed.add_tile(client, name, BLUE, Pose2(0.5, 0, yaw)))
    mine, ink = seen(world, body)
    assert mine.sum() == pytest.approx(48**2, rel=0.05)
    assert overlap(ink, drawn(affinity.rotate(tiles.tile_ink(name), np.degrees(yaw), origin=(0, 0)))) > 0.8
    assert world.pose(body)[0].yaw == pytest.approx(yaw, abs=0.01)
