"""``gem-lite check-cameras`` and ``gem-lite look``: a table of your own, from a folder of pictures."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from typing_extensions import override
from tyro.conf import Positional

from gem_lite import language
from gem_lite.cli.command import Command
from gem_lite.files import DATA, write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gem_lite.language import Queries
    from gem_lite.policies.gem import Policy

# Each method imports what it runs: torch takes seconds to load, and the help needs none of it.
SHIPPED = DATA / "gem-multi.safetensors"


@dataclass(frozen=True, kw_only=True)
class OwnTable(Command):
    """What both commands take."""

    folder: Positional[Path]
    """folder with cameras.json and its pictures"""
    out: Path | None = None
    """folder for pictures and JSON (without it: runs/look/<name of the folder>)"""
    policy: Path = SHIPPED
    """checkpoint of a GEM; its maps, its table and, for a whole sentence, its action"""
    rectangle: tuple[float, float, float, float] | None = None
    """x_min x_max y_min y_max (m) of the table (without it: the policy's own rectangle)"""
    clip: str | None = None
    """Hugging Face name or folder of the CLIP of the policy (without it: the embedded one)"""

    @property
    def output(self) -> Path:
        """The folder to write."""
        return self.out or Path("runs") / "look" / self.folder.resolve().name

    def load_policy(self) -> Policy:
        """The policy. Raises ValueError if it is no GEM: other methods have no maps to look at."""
        from gem_lite import clip
        from gem_lite.policies import checkpoints
        from gem_lite.policies.gem import Policy

        policy = checkpoints.load_policy(self.policy, clip.load(self.clip))
        if not isinstance(policy, Policy):
            raise ValueError(f"{self.policy} must be a checkpoint of gem, got {policy.name}")
        if self.rectangle is not None:  # The networks are convolutions: they read a table of any size.
            policy.config = dataclasses.replace(policy.config, rectangle=self.rectangle)
        return policy

    def draw(self, figure: Figure, name: str) -> None:
        """Write a figure into the folder."""
        self.output.mkdir(parents=True, exist_ok=True)
        figure.savefig(self.output / name, dpi=110)
        print(f"wrote {self.output / name}")


@dataclass(frozen=True, kw_only=True)
class CheckCameras(OwnTable):
    """Do the cameras of a table agree, and if not, what is probably wrong? Ends with code 2 if something is.

    Name some coloured things on the table as well: the command then finds pictures that were read as BGR.
    """

    examples: ClassVar[tuple[str, ...]] = (
        'gem-lite check-cameras data/foreign-scenes/workbench "red block" "blue bowl"',
    )

    phrases: Positional[tuple[str, ...]] = ()
    """things on the table with their colours"""

    @override
    def run(self) -> None:
        from gem_lite.drawing import plot_own_table
        from gem_lite.maps import looking
        from gem_lite.rgbd import camera_check
        from gem_lite.rgbd.camera_mistakes import cloud
        from gem_lite.rgbd.heightmap import fuse_views
        from gem_lite.rgbd.observation import Observation, read_raw

        views = read_raw(self.folder)
        policy = self.load_policy()
        workspace = policy.config.workspace
        findings = camera_check.check(views, workspace)
        found = camera_check.fit([cloud(view) for view in views], workspace)
        for view, share in zip(views, found.covered, strict=True):
            print(f"{view.name}: sees the table (z = 0) in {100 * share:.0f} % of the workspace")
        for (first, second), share in found.pairs.items():
            print(f"{views[first].name} and {views[second].name} agree about {100 * share:.0f} % of what stands there")
        if not findings:
            observation = Observation(tuple(view.view() for view in views))
            self.draw(plot_own_table.show_table_from_above(fuse_views(observation.views, workspace)), "table.png")
            if self.phrases and looking.gain_by_swapping(
                observation.views, self.phrases, policy.source
            ) > looking.SWAP_MARGIN:  # fmt: skip
                findings.append(camera_check.Finding("BGR", (), BGR))
        if findings:
            sentences = [f"{', '.join(one.cameras) or 'colours'}: {one.sentence}" for one in findings]
            raise ValueError("; ".join(sentences))
        print("no mistake found" + ("" if self.phrases else "; name some coloured things to check the colours, too"))


BGR = "the words fit much better with red and blue exchanged: the pictures are BGR, and must be RGB"


@dataclass(frozen=True, kw_only=True)
class Look(OwnTable):
    """What does the policy see? Writes the height map, the maps of each phrase and its best places.

    It says if nothing on the table fits a phrase. A whole sentence ("put the red block in the blue bowl") also gives
    the pick and the place.
    """

    examples: ClassVar[tuple[str, ...]] = (
        'gem-lite look data/foreign-scenes/kitchen "red mug"',
        'gem-lite look data/foreign-scenes/workbench "put the red block in the blue bowl"',
    )

    text: Positional[str]
    """a thing, or a whole sentence"""

    def queries(self, policy: Policy) -> Queries | str:
        """The queries of a sentence, or the phrase of a thing. Raises ValueError if the text is neither."""
        try:
            return policy.read(self.text)
        except ValueError as error:
            try:
                return language.parse_thing(self.text)
            except ValueError:
                raise ValueError(f"text must be a sentence or name a thing: {error}") from None

    @override
    def run(self) -> None:
        from gem_lite.actions import PickPlace
        from gem_lite.drawing import plot_own_table, plots
        from gem_lite.maps import looking, recognition
        from gem_lite.rgbd.observation import Observation

        observation = Observation.load(self.folder)
        policy = self.load_policy()
        scene = policy.embed(observation.views)
        queries = self.queries(policy)
        action = None if isinstance(queries, str) else policy.act(observation, queries)
        phrases = [queries] if isinstance(queries, str) else [str(queries.pick), str(queries.place)]
        self.draw(plot_own_table.show_table_from_above(scene.heightmap), "table.png")
        parts = {phrase: policy.maps(scene, phrase) for phrase in phrases}
        panels = [
            (f"{phrase}: {name}", semantic)
            for phrase, maps_of_phrase in parts.items()
            for name, semantic in (("text", maps_of_phrase.text), ("image", maps_of_phrase.image))
            if semantic is not None
        ]
        self.draw(plots.show_maps(panels), "maps.png")
        maps = {phrase: maps_of_phrase.fused for phrase, maps_of_phrase in parts.items()}
        places = {phrase: looking.best_places(semantic, policy.config) for phrase, semantic in maps.items()}
        drawn = action if isinstance(action, PickPlace) else None
        self.draw(plot_own_table.show_look(scene.heightmap, maps, places, drawn), "look.png")
        refusals = {phrase: recognition.refusal(scene, [phrase], policy.source) for phrase in phrases}
        content = {
            "text": self.text,
            "places": {phrase: [dataclasses.asdict(place) for place in found] for phrase, found in places.items()},
            "refusals": refusals,
            "action": None if action is None else dataclasses.asdict(action),
        }
        write_atomically(self.output / "look.json", json.dumps(content, indent=1).encode())
        for reason in filter(None, refusals.values()):
            print(reason)
        for phrase, found in places.items():
            print(f'"{phrase}": ' + ", ".join(f"({p.x:.3f}, {p.y:.3f}) m {p.score:.2f}" for p in found))
        if action is not None:
            print(action)
        print(f"wrote {self.output / 'look.json'}")
