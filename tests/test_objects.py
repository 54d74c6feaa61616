import numpy as np
import pytest

from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import objects
from gem_lite.simulation.rendering import CAMERAS, render

RED = (1.0, 0.34, 0.35, 1.0)


@pytest.mark.parametrize("name", objects.NAMES)
def test_objects_rest_on_the_table_centred_and_of_table_size_and_have_named_parts(name):
    assert objects.part_names(name) and objects.part_names("mug") == ("brim", "handle")
    for variant in (0, 1, 1000):
        corners = np.array([part.mesh.bounds for part in objects.parts(name, variant)])
        low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
        assert np.allclose([*(low + high)[:2], low[2]], 0, atol=1e-9)
        assert 0.04 < max(high - low) < 0.135 and (high - low)[2] < 0.1
        assert np.allclose(objects.extents(name, variant), high - low)


def test_variants_are_reproducible_and_differ():
    first = [part.mesh.vertices.copy() for part in objects.parts("mug", 3)]
    objects.parts.cache_clear()
    again = [part.mesh.vertices for part in objects.parts("mug", 3)]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert len({tuple(np.round(objects.extents("mug", variant), 6)) for variant in range(20)}) == 20


@pytest.mark.parametrize(("name", "variant", "said"), [("zebra", 0, r"zebra.*mug"), ("mug", -1, r"variant.*-1")])
def test_bad_names_and_variants_are_named(name, variant, said):
    with pytest.raises(ValueError, match=said):
        objects.parts(name, variant)


def seen(world, stage, name):
    """The front view of an object alone, where its pixels are, and the number of the part in each pixel."""
    (body,), _ = stage(lambda client: objects.add_object(client, name, RED, Pose2(0.5, 0, 0), movable=False))
    view, ids = render(world.client, CAMERAS[0], segmentation=True)
    return view, (ids >= 0) & ((ids & 0xFFFFFF) == body.id), ids >> 24


def test_parts_are_seen_where_they_are_in_their_own_colours(world, stage):
    view, mine, part = seen(world, stage, "mug")
    points = view.points()
    names = [part.name for part in objects.parts("mug")]
    handle = points[mine & (part == names.index("handle"))]
    rest = points[mine & (part == names.index(""))]
    # The handle sticks out along +x, the mug's own x axis here.
    assert handle[:, 0].mean() > rest[:, 0].mean() + 0.02
    assert abs(handle[:, 1].mean()) < 0.01
    red = view.rgb[mine].astype(int)
    assert (red[:, 0] > 1.5 * red[:, 2]).mean() > 0.95
    view, mine, part = seen(world, stage, "hammer")
    head = view.rgb[mine & (part == 1)].astype(int)
    assert len(head) > 50 and np.abs(head[:, 0] - head[:, 1]).mean() < 15  # grey metal
