"""Worlds by name: scenes of the same task may differ in light, cameras, floor, containers and spacing.

For a new world, make a `Look` with other values and a new name, and call `register`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gem_lite.foundations import colors
from gem_lite.foundations.registry import Registry
from gem_lite.rgbd.camera import Camera
from gem_lite.rgbd.sensor_errors import AZURE, AZURE_HARD, D455, D455_HARD, SensorErrors
from gem_lite.simulation.bodies.parts import RGBA
from gem_lite.simulation.bodies.shapes import BOWL, FONT, BowlProfile
from gem_lite.simulation.rendering import AROUND_A_SMALL_TABLE, AZURE_AND_D455, CAMERAS, LIGHT, STEADY, LampRange, Light

FLOOR_COLOR: RGBA = (0.27, 0.28, 0.30, 1.0)
TABLE_COLOR: RGBA = (*(c / 255 for c in colors.TABLE), 1.0)


@dataclass(frozen=True)
class Look:
    """The looks and the layout of scenes. The defaults are the world "home", for which the tasks were written.

    Attributes:
        name: the world's name in results.
        floor: colour of the floor round the table.
        light: the lamp.
        lamp: how the lamp differs from episode to episode.
        cameras: of a table that is 1 m long, as CLIPort's; see `rendering.cameras_around`.
        sensors: the errors of each camera, drawn from the episode's seed. Without any, pictures are perfect.
        bowls: profiles of bowls; each bowl gets one of them at random.
        box_heights: heights (m) of the walls of a brown box; each box gets one of them at random.
        plates: (width, height) (m) of the plates of a pyramid's base; each base gets one of them at random.
        stretch: range of a factor by which lengths differ: of flat pieces and their holes, of a stand's plates and
            pegs, and of rings. A piece that looks the same after less than half a turn has one factor, others have two.
        fonts: of letters that are pieces or holes; each letter of a scene gets one of them at random.
        grays: range of a factor of the table's brightness, which differs from episode to episode. Networks see it as
            brighter or darker things (`policies.inputs.exposure`).
        erring: the share of episodes in which the cameras have the errors of ``sensors``.
        touching: the share of bodies that are put next to another body, if there is room.
        at_edge: the share of bodies that are put against the table's edge.
        tools: pairs of end effectors: a task that names the first gets the second.
        hulls_of_parts: whether things of which a part is to be grasped touch with the hulls of their parts. Without it,
            they touch with the hull of the whole thing, and no finger reaches behind a handle.
    """

    name: str = "home"
    floor: RGBA = FLOOR_COLOR
    light: Light = LIGHT
    lamp: LampRange = STEADY
    cameras: tuple[Camera, ...] = CAMERAS
    sensors: tuple[SensorErrors, ...] = ()
    bowls: tuple[BowlProfile, ...] = (BOWL,)
    box_heights: tuple[float, ...] = (0.05,)
    plates: tuple[tuple[float, float], ...] = ((0.05, 0.005),)
    stretch: tuple[float, float] = (1.0, 1.0)
    fonts: tuple[str, ...] = (FONT,)
    grays: tuple[float, float] = (1.0, 1.0)
    erring: float = 1.0
    touching: float = 0.0
    at_edge: float = 0.0
    tools: tuple[tuple[str, str], ...] = ()
    hulls_of_parts: bool = False

    def tool(self, effector: str) -> str:
        """The end effector that a task gets which names ``effector``."""
        return dict(self.tools).get(effector, effector)

    def __post_init__(self) -> None:
        if len(self.sensors) not in (0, len(self.cameras)):
            raise ValueError(
                f"sensors must be none, or one for each of {len(self.cameras)} cameras, got {len(self.sensors)}"
            )
        for name in ("stretch", "grays"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must go from a number above 0 to one at least as large, got {(low, high)}")
        if not self.fonts:
            raise ValueError("fonts must name at least one font")
        if not 0 <= self.erring <= 1:
            raise ValueError(f"erring must be a share in [0, 1], got {self.erring}")


TRAINING_BOWLS = (
    BOWL,
    BowlProfile(rim=0.056, base=0.052, height=0.03, floor=0.005),
    BowlProfile(rim=0.062, base=0.04, height=0.028, wall=0.004, floor=0.006),
    BowlProfile(rim=0.055, base=0.042, height=0.045, wall=0.008, floor=0.008),
)
"""Profiles of demonstrations in the worlds "varied", "crowded" and "diverse". None of them is in `OTHER_BOWLS`."""
OTHER_BOWLS = (
    BowlProfile(rim=0.06, base=0.036, height=0.04, wall=0.005, floor=0.008, bend=0.5),
    BowlProfile(rim=0.054, base=0.054, height=0.036, wall=0.003, floor=0.003),
    BowlProfile(rim=0.064, base=0.05, height=0.022, wall=0.005, floor=0.004),
)

HOME = Look()
VARIED = Look(
    "varied", bowls=TRAINING_BOWLS, box_heights=(0.05, 0.04, 0.06),
    plates=((0.05, 0.005), (0.056, 0.008), (0.064, 0.014)), touching=0.25, at_edge=0.15,
)  # fmt: skip
DIVERSE = replace(
    VARIED, name="diverse", light=Light(shadow=True), lamp=LampRange(1.0, 0.3, tint=0.15, contrast=0.5, shadows=0.5),
    sensors=(D455,) * len(CAMERAS), erring=1 / 3, stretch=(0.8, 1.1), grays=(0.6, 1.8),
    fonts=(FONT, "STIXGeneral"),
)  # fmt: skip
"""For demonstrations: "varied" with other proportions, fonts, lamps and tables, and errors of cameras in a third of the
episodes."""
KINECT = Look(
    "kinect", light=Light(shadow=True), lamp=LampRange(lean=0.5, strength=0.15), cameras=AZURE_AND_D455,
    sensors=(AZURE, D455, D455),
)  # fmt: skip
"""A real cell: an Azure Kinect on top, two D455 at the sides, a lamp that was put up anew (its numbers are guesses)."""
KINECT_HARD = replace(
    KINECT, name="kinect-hard", lamp=LampRange(lean=1.0, strength=0.3), sensors=(AZURE_HARD, D455_HARD, D455_HARD)
)
REAL_TABLE = Look("real-table", cameras=AROUND_A_SMALL_TABLE)
"""The paper's real table (A.11) with perfect pictures: `real_table.WORKSPACE`."""
REAL_TABLE_KINECT = replace(KINECT, name="real-table-kinect", cameras=AROUND_A_SMALL_TABLE)
ARM = (("suction", "panda"), ("jaw", "panda"), ("parallel-jaw", "panda"))
"""Franka's Panda in the place of every tool that picks and places."""
WORLDS: Registry[Look] = Registry("world")
"""Every world by its name. Demonstrations come from "home", "varied", "crowded", "diverse" or "kinect"; those of
the real tables from "real-table" or "real-table-kinect". The others only test."""


def register(world: Look) -> Look:
    """Add a world under its name and return it. Raises ValueError if another world has this name."""
    if world.name in WORLDS.names() and style(world.name) != world:
        raise ValueError(f"world.name must be new: there is another world named {world.name!r}")
    return WORLDS.add(world.name, world)


def style(name: str) -> Look:
    """The world with this name. If there is none, raises ValueError with the nearest names."""
    return WORLDS.find(name)


def names() -> tuple[str, ...]:
    """The names of all worlds."""
    return WORLDS.names()


for _world in (
    HOME,
    VARIED,
    replace(VARIED, name="crowded", touching=0.5),
    DIVERSE,
    Look("other-containers", bowls=OTHER_BOWLS, box_heights=(0.034, 0.07), plates=((0.06, 0.011),)),
    Look("white-floor", floor=(0.95, 0.95, 0.95, 1.0)),
    Look("shadows", light=Light((1.0, -0.8, 1.2), ambient=0.3, diffuse=0.8, shadow=True)),
    Look("touching", touching=0.6),
    Look("bright-light", light=Light(ambient=0.8, diffuse=0.5)),
    KINECT,
    KINECT_HARD,
    REAL_TABLE,
    REAL_TABLE_KINECT,
    Look("narrow-suction", tools=(("suction", "narrow-suction"),)),
    replace(HOME, name="panda", tools=ARM, hulls_of_parts=True),
    replace(REAL_TABLE, name="real-table-panda", tools=ARM, hulls_of_parts=True),
):
    register(_world)
