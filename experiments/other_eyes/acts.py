"""What is lost: where policies with other map sources pick, on one scene and the same phrase."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from drawings import plot_real_table
from tqdm import tqdm

from experiments.other_eyes import scenes
from gem_lite import clip
from gem_lite.evaluation.evaluate import check_table
from gem_lite.language import Queries
from gem_lite.policies.checkpoints import load_policy
from gem_lite.policies.gem import Gem
from gem_lite.rgbd.observation import Observation

SCENES = 50
"""The validation scenes that are looked at."""


def draw(picture: Path, kind: str, checkpoints: Sequence[Path], count: int, clip_name: str | None) -> list[int]:
    """Draw the first validation scenes on which some policies pick the named thing and others do not, if there are any.

    A row is a scene: the table, then each policy's map of what to pick, with a cross where it picks.

    Args:
        picture: PNG to write.
        kind: of scenes, with a pick and a place.
        checkpoints: of GEM, two or more.
        count: number of scenes, at most.

    Returns:
        For each policy, the number of the `SCENES` on which it picks the named thing.

    Raises:
        ValueError: another kind, fewer than two checkpoints, one that is not of GEM or is of another table, or
            ``count`` below 1.
        OSError: a checkpoint cannot be read, or the picture cannot be written.
    """
    if kind not in (scenes.BOWLS, scenes.PARTS):
        raise ValueError(f"kind must be {scenes.BOWLS} or {scenes.PARTS}, got {kind!r}")
    if len(checkpoints) < 2:
        raise ValueError(f"checkpoints must be at least two, got {len(checkpoints)}")
    if count < 1:
        raise ValueError(f"scenes must be at least 1, got {count}")
    model = clip.load(clip_name)
    policies = [load_policy(path, model).eval() for path in checkpoints]
    if others := [policy.name for policy in policies if not isinstance(policy, Gem)]:
        raise ValueError(f"checkpoints must be of GEM, whose maps can be drawn, got {', '.join(others)}")
    asked = scenes.configuration(kind).workspace
    for path, policy in zip(checkpoints, policies, strict=True):
        check_table(path, policy.config.workspace, asked, kind)
    panels: list[tuple] = []
    totals = [0] * len(policies)
    with scenes.world_of(kind) as world:
        for index in tqdm(range(SCENES), kind, unit="scene"):
            row, rights = row_of(scenes.look(world, kind, "val", index), policies)
            totals = [total + right for total, right in zip(totals, rights, strict=True)]
            if len(set(rights)) > 1 and len(panels) < count * len(row):
                panels += row
    if not panels:
        return totals
    figure = plot_real_table.show_maps(panels, columns=1 + len(policies))
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, bbox_inches="tight")
    plt.close(figure)
    return totals


def row_of(scene: scenes.Scene, policies: Sequence[Gem]) -> tuple[list[tuple], list[bool]]:
    """The panels of a scene for `plot_real_table.show_maps`, and for each policy whether it picks the named thing."""
    asked, place = scene.questions
    queries = Queries(pick=asked.phrase, place=place.phrase)
    panels = []
    rights = []
    for policy in policies:
        choice = policy.decide(Observation(scene.views), queries)
        _, row, col = choice.pick_cell
        right = bool(asked.cells[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2].any())
        title = f"{policy.config.semantic_map}\npick: {'right' if right else 'wrong'}"
        panels.append((title, choice.pick_map, asked.cells, (row, col)))
        rights.append(right)
    return [(f'"{asked.phrase}"\nthe table', choice.heightmap.rgb, asked.cells, None), *panels], rights
