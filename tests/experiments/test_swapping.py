"""The tables of vague goals and of swaps, and the scenes of swaps."""

from pathlib import Path

import pytest

from experiments.planning import measuring, swapping
from gem_lite import clip
from gem_lite.planning import goals

ROWS = clip.DATA / "planning"
README = Path(measuring.__file__).with_name("README.md").read_text()


def test_the_page_shows_the_tables_of_the_published_rows():
    for line in measuring.table(ROWS / "rows.jsonl").splitlines():
        assert line in README
    columns = [line.split("|")[2:] for line in swapping.table(ROWS / "swaps.jsonl").splitlines()[2:]]
    for kind, numbers in zip(("blocks of seven colours", "everyday objects"), columns, strict=True):
        assert f"| {kind} |{'|'.join(numbers)}" in README


@pytest.mark.parametrize("kind", swapping.KINDS)
def test_a_scene_of_a_swap_is_done_when_both_things_lie_where_the_other_was(world, kind):
    task = swapping.Swapping(kind)
    world.begin(task, swapping.FIRST_SEED)
    (swap,) = goals.read(task.instruction)
    first, second = (goal.bodies[0] for goal in task.goals)
    assert (task.names[first.id], task.names[second.id]) == (swap.first, swap.second)
    assert len(world.bodies) == swapping.COUNT and not any(goal.done(world) for goal in task.goals)
    for goal, other in zip(task.goals, (second, first), strict=True):
        pose = world.pose(other)[0]
        assert (goal.targets[0].x, goal.targets[0].y) == pytest.approx((pose.x, pose.y), abs=1e-4)
