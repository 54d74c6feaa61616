"""``gem-lite check-cameras`` and ``gem-lite look``: a table of your own, from a folder of pictures."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from gem_lite.cli.base import Clip, Refused
from gem_lite.foundations.files import DATA, write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gem_lite.language import Queries, ThingQuery
    from gem_lite.policies import gem

SHIPPED = DATA / "gem-multi.safetensors"
MUCH = 0.25
"""From this share on, a rectangle of what is seen is proposed."""
BGR = (
    "no other mistake found, but a doubt: the words fit much better with red and blue exchanged: are the pictures BGR? "
    "They must be RGB"
)

Folder = Annotated[Path, Parameter(help="folder with cameras.json and its pictures")]
Out = Annotated[
    Path | None, Parameter(help="folder for pictures and JSON (without it: runs/look/<name of the folder>)")
]
Policy = Annotated[
    Path, Parameter(help="checkpoint of a GEM; its maps, its table and, for a whole sentence, its action")
]
Rectangle = Annotated[
    tuple[float, float, float, float] | None,
    Parameter(help="x_min x_max y_min y_max (m) of the table (without it: the policy's own rectangle)"),
]
Picked = Annotated[str | None, Parameter(help="what to pick: a thing, or the PNG file of its picture")]
Placed = Annotated[str | None, Parameter(help="where to place it: a thing, or the PNG file of its picture")]


def check_cameras(
    folder: Folder, /, *phrases: str, out: Out = None, policy: Policy = SHIPPED, rectangle: Rectangle = None,
    clip: Clip = None,
) -> None:  # fmt: skip
    """Do the cameras of a table agree, and if not, what is probably wrong?

    Ends with code 2 if something is. Name some coloured things on the table
    as well: the command then asks if the pictures were read as BGR.

    Args:
        phrases: things on the table with their colours

    Examples:
      gem-lite check-cameras data/foreign-scenes/workbench "red block" "blue bowl"
    """
    from gem_lite.drawing import plot_own_table
    from gem_lite.rgbd import camera_check
    from gem_lite.rgbd.heightmap import fuse_views
    from gem_lite.rgbd.observation import Observation, read_raw
    from gem_lite.se2 import Workspace

    raw = read_raw(folder)
    # The shipped policy acts on the default rectangle. Its networks, which take seconds to load, read the words alone.
    gem = load(policy, rectangle, clip) if phrases or policy != SHIPPED else None
    workspace = gem.config.workspace if gem else Workspace.covering(*rectangle) if rectangle else Workspace()
    mistakes = [f"{', '.join(one.cameras)}: {one.sentence}" for one in camera_check.check(raw, workspace)]
    found = camera_check.fit([camera_check.cloud(view) for view in raw], workspace)
    for view, share in zip(raw, found.covered, strict=True):
        fitting = "" if share >= camera_check.COVERED else camera_check.rectangle_for(view)
        print(f"{view.name}: sees the table (z = 0) in {100 * share:.0f} % of the workspace{fitting}")
    for (first, second), share in found.pairs.items():
        print(f"{raw[first].name} and {raw[second].name} agree about {100 * share:.0f} % of what stands there")
    try:
        views = Observation(tuple(view.view() for view in raw)).views
        heightmap = fuse_views(views, workspace)
    except ValueError:  # With some mistakes there is nothing to draw: no camera sees the workspace, or sizes differ.
        if not mistakes:
            raise
    else:
        draw({"table": plot_own_table.show_table_from_above(heightmap)}, out, folder)
    if mistakes:
        raise ValueError("; ".join(mistakes))
    if gem and phrases:
        from gem_lite.maps import places

        if places.gain_by_swapping(views, phrases, gem.source) > places.SWAP_MARGIN:
            print(BGR)
            return
    print("no mistake found" + ("" if phrases else "; name some coloured things to check the colours, too"))


def look(
    folder: Folder, text: str = "", /, *, pick: Picked = None, place: Placed = None, out: Out = None,
    policy: Policy = SHIPPED, rectangle: Rectangle = None, clip: Clip = None,
) -> None:  # fmt: skip
    """What does the policy see?

    Writes the height map, the maps of each phrase and its best places. If
    nothing on the table fits a phrase, it says so and ends with code 1. A
    whole sentence ("put the red block in the blue bowl") also gives the pick
    and the place. So do --pick and --place, each a thing or a picture of one.

    Args:
        text: a thing, or a whole sentence

    Examples:
      gem-lite look data/foreign-scenes/kitchen "red mug"
      gem-lite look data/foreign-scenes/workbench "put the red block in the blue bowl"
      gem-lite look data/foreign-scenes/kitchen --pick mug.png --place "brown box"
    """
    from gem_lite.actions import PickPlace
    from gem_lite.clip import EMBEDDED
    from gem_lite.drawing import plot_own_table, plots
    from gem_lite.language import Queries
    from gem_lite.maps import places, refusal
    from gem_lite.policies import robot_plan
    from gem_lite.rgbd.observation import Observation, robot_base
    from gem_lite.rgbd.seen import as_option, seen_rectangle, sees_nothing, unseen_in_words

    observation = Observation.load(folder)
    base = robot_base(folder)
    gem = load(policy, rectangle, clip)
    scene = gem.embed(observation.views)
    asked = read(gem, text) if pick is None and place is None else things(text, pick, place)
    queries = [asked.pick, asked.place] if isinstance(asked, Queries) else [asked]
    refusals = {str(query): refusal.refusal(scene, [query], gem.source) for query in queries}
    refused = any(refusals.values())
    choice = gem.decide_in(scene, observation.views, asked) if isinstance(asked, Queries) and not refused else None
    action = choice.action if choice else None
    maps = {str(query): gem.maps(scene, query) for query in queries}
    parts = {f"{phrase}: {name}": getattr(maps[phrase], name) for phrase in maps for name in ("text", "image")}
    fused = {phrase: maps[phrase].fused for phrase in maps}
    seen = scene.heightmap.seen
    best = {phrase: places.best_places(semantic, seen, gem.config) for phrase, semantic in fused.items()}
    shown = action if isinstance(action, PickPlace) else None
    planned = robot_plan.plan(choice, base) if choice and shown else None
    in_base = {"pick": planned.pick.tolist(), "place": planned.place.tolist()} if planned and base is not None else None
    figures = {
        "table": plot_own_table.show_table_from_above(scene.heightmap),
        "maps": plots.show_maps([(title, semantic) for title, semantic in parts.items() if semantic is not None]),
        "look": plot_own_table.show_look(scene.heightmap, fused, best, shown),
    }
    content = {
        "text": text or str(asked),
        "places": {phrase: [dataclasses.asdict(place) for place in of_phrase] for phrase, of_phrase in best.items()},
        "refusals": refusals,
        "action": None if action is None else dataclasses.asdict(action),
        "in_base": in_base,
    }
    file = draw(figures, out, folder) / "look.json"
    write_atomically(file, json.dumps(content, indent=1).encode())
    if gem.clip.name == f"embedded {EMBEDDED.name}" and DATA not in folder.resolve().parents:
        print("maps by the embedded CLIP, which has seen renderings alone: on photographs it is often wrong")
    for view in observation.views:
        if sees_nothing(view, gem.config.workspace):
            print(f"camera {view.camera.name!r} sees nothing of the rectangle")
    if said := unseen_in_words(seen):
        print(said)
    if 1 - seen.mean() >= MUCH and (fitting := seen_rectangle(seen, gem.config.workspace)) is not None:
        print(f"what is seen fits {as_option(fitting)}")
    for reason in filter(None, refusals.values()):
        print(reason)
    for phrase, of_phrase in best.items():
        print(f'"{phrase}": ' + ", ".join(f"({p.x:.3f}, {p.y:.3f}) m {p.score:.2f}" for p in of_phrase))
    if action is not None:
        print(action)
    if planned:
        for sentence in planned.forbidden_in_words():
            print(sentence)
    for part, pose in (in_base or {}).items():
        x, y, z = (row[3] for row in pose[:3])
        print(f"{part} in the frame of the robot's base: ({x:.3f}, {y:.3f}, {z:.3f}) m")
    print(f"wrote {file}")
    if refused:
        raise Refused


def load(checkpoint: Path, rectangle: tuple[float, float, float, float] | None, clip_name: str | None) -> gem.Gem:
    """The policy, on a table of another form. Raises ValueError if it is no GEM: others have no maps to look at."""
    from gem_lite import clip
    from gem_lite.policies import checkpoints, gem

    policy = checkpoints.load_policy(checkpoint, clip.load(clip_name))
    if not isinstance(policy, gem.Gem):
        raise ValueError(f"{checkpoint} must be a checkpoint of gem, got {policy.name}")
    if rectangle is not None:  # The networks are convolutions: they read a table of any size.
        policy.config = dataclasses.replace(policy.config, rectangle=rectangle)
    return policy


def read(policy: gem.Gem, text: str) -> Queries | str:
    """The queries of a sentence, or the phrase of a thing. Raises ValueError if the text is neither."""
    from gem_lite import language

    try:
        return policy.read(text)
    except ValueError as error:
        try:
            return language.parse_thing(text)
        except ValueError:
            raise ValueError(f"text must be a sentence or name a thing: {error}") from None


def things(text: str, pick: str | None, place: str | None) -> Queries | ThingQuery:
    """The queries of --pick and --place, or the one thing if there is one of them.

    Raises:
        FileNotFoundError: there is no such picture.
        ValueError: there is a text, too; or a name is no thing, or a file is no picture.
    """
    from gem_lite import language

    if text:
        raise ValueError(f"text must be empty besides --pick or --place, got {text!r}")
    named = [thing(name) for name in (pick, place) if name is not None]
    return language.Queries(*named) if len(named) == 2 else named[0]


def thing(name: str) -> ThingQuery:
    """A thing by its words, or by its picture if the name ends with .png. Raises as `things`."""
    from gem_lite import language

    return language.read_picture(name) if name.lower().endswith(".png") else language.parse_thing(name)


def draw(figures: dict[str, Figure], out: Path | None, scene: Path, command: str = "look") -> Path:
    """Write figures, each into a file of its name, into ``out`` or a command's folder for a scene. Returns this folder.

    The figures are closed.
    """
    import matplotlib.pyplot as plt

    folder = out or Path("runs") / command / scene.resolve().name
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png", dpi=110)
        plt.close(figure)
        print(f"wrote {folder / name}.png")
    return folder
