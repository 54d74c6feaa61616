"""The demonstrations' crops at pick and place, and their retrieval by phrase (Sec. 3.1, Eq. 2, A.7)."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from gem_lite import language
from gem_lite.actions import GripperState, Push
from gem_lite.clip import Clip
from gem_lite.demonstrations import Demonstration, DemonstrationStep
from gem_lite.language import Instruction, Queries
from gem_lite.rgbd.heightmap import HeightMap, fuse_views
from gem_lite.se2 import Pose2, Workspace

EpisodeKey = tuple[str, int]
"""An episode: its task's name, and its number among the task's demonstrations."""
ROUNDING = 1e-6
"""How much the cosines of equal phrases may differ, since a matrix product rounds its rows differently."""


@dataclass(frozen=True)
class CropEntry:
    """One event of a demonstration: the thing that was acted on, in words and as a picture (H, W, 3) uint8.

    Attributes:
        task, episode: which demonstration it comes from (`EpisodeKey`).

    Raises ValueError for an empty phrase or task, another kind of picture, or an episode that is no number from 0 on.
    """

    phrase: str
    image: np.ndarray
    task: str
    episode: int

    @property
    def key(self) -> EpisodeKey:
        """The demonstration that it comes from."""
        return self.task, self.episode

    def __post_init__(self) -> None:
        if not isinstance(self.phrase, str) or not self.phrase.strip():
            raise ValueError(f"phrase must name what was acted on, got {self.phrase!r}")
        if not isinstance(self.task, str) or not self.task:
            raise ValueError(f"task must be the name of a task, got {self.task!r}")
        if type(self.episode) is not int or not 0 <= self.episode < 2**63:
            raise ValueError(f"episode must be a number from 0 on, got {self.episode!r}")
        shape = self.image.shape
        dtype = self.image.dtype
        if len(shape) != 3 or shape[-1] != 3 or 0 in shape or dtype != np.uint8:
            raise ValueError(f"image must be an (H, W, 3) uint8 picture, got {shape} {dtype}")


class CropMemory:
    """A database of (phrase, crop) pairs, embedded once.

    Attributes:
        entries: the pairs.
        keys: (N, D) text embeddings of the phrases, K of Eq. 2.
        values: (N, D) image embeddings of the crops, E_crop of Eq. 3.

    Raises:
        ValueError: no entries, or pictures of unequal size.
    """

    def __init__(self, entries: Iterable[CropEntry], clip: Clip) -> None:
        self.entries = list(entries)
        if not self.entries:
            raise ValueError("entries is empty: a crop memory needs at least one demonstrated crop")
        shapes = sorted({entry.image.shape for entry in self.entries})
        if len(shapes) > 1:
            raise ValueError(f"entries must hold pictures of one size, got {', '.join(map(str, shapes))}")
        self.keys = clip.embed_texts([entry.phrase for entry in self.entries]).cpu()
        self.values = clip.embed_images(np.stack([entry.image for entry in self.entries])).cpu()

    def find(self, query: torch.Tensor, hidden: EpisodeKey | None = None) -> tuple[int, float] | None:
        """Index and cosine of the nearest phrase to a text embedding (D,); None if no phrase may be searched.

        Of equally near phrases, this is the first.

        Args:
            hidden: an episode whose crops must not be retrieved.

        Raises:
            ValueError: a query of another shape.
        """
        if query.shape != self.keys.shape[1:]:
            raise ValueError(f"query must have shape {tuple(self.keys.shape[1:])}, got {tuple(query.shape)}")
        similarity = self.keys @ query
        if hidden is not None:
            of_hidden = torch.tensor([entry.key == hidden for entry in self.entries])
            similarity = similarity.masked_fill(of_hidden, -torch.inf)
        nearest = similarity.max()
        if torch.isinf(nearest):
            return None
        first = int((similarity >= nearest - ROUNDING).int().argmax())
        return first, float(similarity[first])

    def retrieve(self, query: torch.Tensor, threshold: float, hidden: EpisodeKey | None = None) -> torch.Tensor | None:
        """QueriedCrop (Eq. 2): the image embedding (D,) of the nearest phrase's crop, None below ``threshold``.

        Raises ValueError for a threshold that is no cosine, or a query of another shape.
        """
        if not -1 <= threshold <= 1:
            raise ValueError(f"threshold must be a cosine in [-1, 1], got {threshold}")
        nearest = self.find(query, hidden)
        if nearest is None:
            return None
        index, cosine = nearest
        return self.values[index] if cosine >= threshold else None

    def pack(self) -> tuple[np.ndarray, list[dict]]:
        """The pictures (N, H, W, 3) uint8, and for each its phrase, task and episode, ready for JSON."""
        labels = [{"phrase": entry.phrase, "task": entry.task, "episode": entry.episode} for entry in self.entries]
        return np.stack([entry.image for entry in self.entries]), labels

    @classmethod
    def unpack(cls, images: np.ndarray, labels: Sequence[dict], clip: Clip) -> CropMemory:
        """The memory that `pack` took apart, embedded by any CLIP.

        Raises:
            ValueError: not one label for each picture, a label without phrase, task or episode, or a wrong picture.
        """
        count = len(images) if images.ndim else 0
        if not isinstance(labels, list | tuple) or len(labels) != count:
            raise ValueError(f"labels must be one for each of {count} pictures, got {labels!r:.200}")
        for label in labels:
            if not isinstance(label, dict) or label.keys() != {"phrase", "task", "episode"}:
                raise ValueError(f"a label must hold a phrase, a task and an episode, got {label!r:.200}")
        return cls([CropEntry(image=image, **label) for image, label in zip(images, labels, strict=True)], clip)


def events(trace: Sequence[GripperState]) -> list[tuple[Literal["pick", "place"], Pose2]]:
    """When and where the gripper closed on something ("pick") and let it go ("place"), in order (Sec. 3.1)."""
    return [
        ("pick" if after.holding else "place", Pose2(after.x, after.y, after.yaw))
        for before, after in itertools.pairwise(trace)
        if before.holding != after.holding
    ]


def step_events(step: DemonstrationStep) -> list[tuple[Literal["pick", "place"], Pose2]]:
    """The `events` of a step. A push has no grasp: its start counts as the pick, its end as the place."""
    action = step.expert.action
    if isinstance(action, Push):
        return [("pick", action.start), ("place", action.end)]
    return events(step.trace)


def numbered(demonstrations: Iterable[Demonstration]) -> Iterator[tuple[EpisodeKey, Demonstration]]:
    """Every demonstration with its key: each task's are numbered from 0 on, so that tasks may be mixed."""
    counts: Counter[str] = Counter()
    for demonstration in demonstrations:
        yield (demonstration.task, counts[demonstration.task]), demonstration
        counts[demonstration.task] += 1


def collect_crops(
    demonstrations: Iterable[Demonstration], workspace: Workspace, side: float,
    read: Callable[[Instruction], Queries] = language.parse,
) -> Iterator[CropEntry]:  # fmt: skip
    """The crops of every event of the demonstrations that a phrase names, from before the action (Sec. 3.1).

    Args:
        workspace: of the height maps from which they are cut.
        side: of a crop, in metres.
        read: gives each crop its phrase.

    Raises:
        ValueError: an instruction that is refused, or a ``side`` that `cut` refuses.
    """
    for key, demonstration in numbered(demonstrations):
        for step in demonstration.steps:
            heightmap = fuse_views(step.observation.views, workspace)
            for kind, pose in step_events(step):
                query = getattr(read(step.instruction), kind)
                if not isinstance(query, str):
                    continue  # A picture needs no search, and has no words by which its crop could be found.
                if language.is_relation(query):
                    continue  # The crop shows the bare table, and no thing that a phrase could mean.
                # A copy: what `cut` returns would keep the whole height map.
                yield CropEntry(query, cut(heightmap, pose, side).copy(), *key)


def cut(heightmap: HeightMap, pose: Pose2, side: float) -> np.ndarray:
    """The square of ``side`` metres around a pose, moved inside the map at its border.

    Returns:
        (S, S, 3) uint8, a view of the map's colours.

    Raises:
        ValueError: the pose lies outside the map, or the square does not fit into it.
    """
    size = round(side / heightmap.workspace.pixel)
    row, col = heightmap.workspace.nearest_cell(pose.x, pose.y)
    height, width = heightmap.rgb.shape[:2]
    if not 1 <= size <= min(height, width):
        raise ValueError(f"side must make 1 to {min(height, width)} cells of the map, got {side} m: {size} cells")
    top = np.clip(row - size // 2, 0, height - size)
    left = np.clip(col - size // 2, 0, width - size)
    return heightmap.rgb[top : top + size, left : left + size]
