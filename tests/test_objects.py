import numpy as np
import pytest

from gem_lite.actions import PickPlace
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.rendering import CAMERAS, render

RED = (1.0, 0.34, 0.35, 1.0)


def bounds(name, variant):
    corners = np.array([part.mesh.bounds for part in objects.parts(name, variant)])
    return corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)


@pytest.mark.parametrize("name", objects.NAMES)
def test_objects_rest_on_the_table_centred_and_of_table_size(name):
    for variant in (0, 1, 1000):
        low, high = bounds(name, variant)
        assert np.allclose((low + high)[:2], 0, atol=1e-9)
        assert low[2] == pytest.approx(0, abs=1e-9)
        assert 0.04 < max(high - low) < 0.135
        assert (high - low)[2] < 0.1


def test_every_object_has_named_parts():
    assert all(objects.part_names(name) for name in objects.NAMES)
    assert objects.part_names("mug") == ("brim", "handle")


def test_variants_are_reproducible_and_differ():
    first = [part.mesh.vertices.copy() for part in objects.parts("mug", 3)]
    objects.parts.cache_clear()
    again = [part.mesh.vertices for part in objects.parts("mug", 3)]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    sizes = [tuple(np.round(np.subtract(*bounds("mug", v)[::-1]), 6)) for v in range(20)]
    assert len(set(sizes)) == 20


def test_bad_names_and_variants_are_named():
    with pytest.raises(ValueError, match=r"zebra.*mug"):
        objects.parts("zebra")
    with pytest.raises(ValueError, match=r"variant.*-1"):
        objects.parts("mug", -1)


def test_parts_are_seen_where_they_are(world, stage):
    (body,), _ = stage(lambda client: objects.add_object(client, "mug", RED, Pose2(0.5, 0, 0), movable=False))
    view, ids = render(world.client, CAMERAS[0], segmentation=True)
    points = view.points()
    mine = (ids >= 0) & ((ids & 0xFFFFFF) == body.id)
    names = [part.name for part in objects.parts("mug")]
    handle = points[mine & (ids >> 24 == names.index("handle"))]
    rest = points[mine & (ids >> 24 == names.index(""))]
    # The handle sticks out along +x, the mug's own x axis here.
    assert handle[:, 0].mean() > rest[:, 0].mean() + 0.02
    assert abs(handle[:, 1].mean()) < 0.01
    red = view.rgb[mine].astype(int)
    assert (red[:, 0] > 1.5 * red[:, 2]).mean() > 0.95


def test_a_part_has_its_own_colour(world, stage):
    (body,), _ = stage(lambda client: objects.add_object(client, "hammer", RED, Pose2(0.5, 0, 0), movable=False))
    view, ids = render(world.client, CAMERAS[0], segmentation=True)
    head = view.rgb[(ids >= 0) & ((ids & 0xFFFFFF) == body.id) & (ids >> 24 == 1)].astype(int)
    assert len(head) > 50
    assert np.abs(head[:, 0] - head[:, 1]).mean() < 15  # grey metal


def test_an_object_can_be_picked_and_placed(world, stage):
    (body,), _ = stage(lambda client: objects.add_object(client, "bottle", RED, Pose2(0.4, 0.2, 0.5)))
    start = world.pose(body)[0]
    step = world.step(PickPlace(start, Pose2(0.6, -0.2, start.yaw)))
    assert step.grasped
    end, height = world.pose(body)
    assert np.hypot(end.x - 0.6, end.y + 0.2) < 0.02
    assert height == pytest.approx(body.rest_height, abs=0.01)
