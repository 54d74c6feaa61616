"""Configurations and labels: what is not allowed ends in one sentence, before anything is computed."""

import dataclasses
import itertools
import math

import pytest

from gem_lite.actions import ExpertAction, PickPlace, Push
from gem_lite.config import Config
from gem_lite.maps.query_maps import MapConfig
from gem_lite.policies import methods
from gem_lite.policies.gem_config import LITE, GemConfig
from gem_lite.policies.inputs import Inputs, label, right_bins
from gem_lite.policies.transporter import TransporterConfig
from gem_lite.se2 import Pose2

NAN = math.nan


def test_the_library_says_of_every_entry_what_it_may_be():
    for name, preset in itertools.product(methods.meanings(), ("lite", "paper")):
        config = methods.find(name, preset)[1]
        assert all("allowed" in field.metadata for field in dataclasses.fields(config)), name
        assert type(config).from_dict(config.on_table(1.06).as_dict()) == config.on_table(1.06)


def test_digests_of_configurations_are_those_of_stored_rows():
    shipped = {LITE.digest, methods.find("transporter-lan")[1].digest, methods.find("cliport", "paper")[1].digest}
    assert shipped == {"2014e395030e", "d9bdabce1b3a", "46440fce55e3"}
    added = dataclasses.replace(LITE, rectangle=(0.0, 0.9, 0.0, 0.45), location_code=False).as_dict().keys()
    assert added - LITE.as_dict().keys() == {"rectangle", "location_code"}


def test_the_inputs_of_a_configuration_are_a_part_of_its_own():
    part = LITE.inputs
    assert type(part) is MapConfig and isinstance(LITE, MapConfig)
    assert part == dataclasses.replace(LITE, steps=7, peak_margin=None, kernel=9, turn=False).inputs
    assert (part.pixel, part.own_crop, part.workspace) == (LITE.pixel, LITE.own_crop, LITE.workspace)
    assert not hasattr(part, "steps") and not hasattr(part, "peak_margin")


@pytest.mark.parametrize(
    ("kind", "entry", "value", "allowed"),
    [
        (Config, "angles", 0, "a whole number from 1 on"),
        (Config, "steps", 0, "a whole number from 1 on"),
        (Config, "steps", 2.5, "a whole number from 1 on"),
        (Config, "batch", True, "a whole number from 1 on"),
        (Config, "pixel", -0.00625, "a number above 0 and up to 5.0"),
        (Config, "pixel", NAN, "a number above 0 and up to 5.0"),
        (Config, "pixel", "0.00625", "a number above 0 and up to 5.0"),
        (Config, "learning_rate", math.inf, "a number above 0 and up to 1"),
        (Config, "empty_radius", 10**400, "a number from 0 to 5.0"),
        (Config, "turn", 1, "True or False"),
        (Config, "rectangle", (0.0, 1.0, NAN, 1.0), "4 values, each a number from -1000 to 1000, or None"),
        (Config, "rectangle", (0.0, 1.0), "4 values, each a number from -1000 to 1000, or None"),
        (GemConfig, "kernel", 16, "an odd whole number from 1 on"),
        (GemConfig, "frequency", -1, "a whole number from 0 on"),
        (GemConfig, "widths", (16, 24, 32), "4 values, each a whole number from 1 on"),
        (GemConfig, "widths", (16, 24, 32, 0), "4 values, each a whole number from 1 on"),
        (GemConfig, "drop_image_map", 1.5, "a number from 0 to 1"),
        (GemConfig, "map_gain", (0.5, NAN), "2 values, each a number from 0 to 10"),
        (GemConfig, "peak_margin", -0.1, "a number from 0 to 10, or None"),
        (GemConfig, "kernels", "round", "one of steerable, unrotated, free"),
        (TransporterConfig, "query", 16, "one less than a multiple of 16"),
        (TransporterConfig, "joins", 5, "a whole number from 1 to 4"),
    ],
)
def test_a_value_that_is_not_allowed_is_refused_by_name(kind, entry, value, allowed):
    with pytest.raises(ValueError) as refused:
        kind(**{entry: value})
    assert str(refused.value) == f"{entry} must be {allowed}, got {value!r}"


def test_values_that_do_not_fit_each_other_are_refused():
    with pytest.raises(ValueError, match=r"pixel must divide a table of 0\.9 m by 0\.45 m .* such as 0\.00703125, got"):
        Config(table=0.9)
    with pytest.raises(ValueError, match=r"frequency must be below half of rotations, which is 8, got 8"):
        dataclasses.replace(LITE, rotations=16)
    with pytest.raises(ValueError, match=r"map_gain must go from a smaller number to a larger one, got \(2, 1\)"):
        dataclasses.replace(LITE, map_gain=(2, 1))
    with pytest.raises(ValueError, match=r'continued must be False with encoder "steerable", .*, got True'):
        dataclasses.replace(LITE, encoder="steerable", continued=True)
    with pytest.raises(ValueError, match=r"unknown entries \['PRESETS'\]"):
        Config.from_dict({"PRESETS": {}})
    assert dataclasses.replace(LITE, rectangle=(0.0, 0.9, 0.0, 0.45)).workspace.shape == (80, 144)


@dataclasses.dataclass
class Step:
    expert: ExpertAction


ON, OFF = Pose2(0.4, 0.1, 0.3), Pose2(0.2, 0.1, 0.3)


@pytest.mark.parametrize(
    ("action", "name"),
    [
        (PickPlace(OFF, ON), "pick"),
        (PickPlace(ON, OFF), "place"),
        (PickPlace(ON, Pose2(0.75, 0.0)), "place"),
        (PickPlace(ON, Pose2(0.4, -0.5)), "place"),
        (PickPlace(Pose2(0.4, 0.1, NAN), ON), "pick"),
        (PickPlace(Pose2(math.inf, 0.1), ON), "pick"),
        (Push(ON, OFF), "place"),
    ],
)
def test_a_label_outside_the_table_is_refused(action, name):
    inputs = Inputs(rgbd=None)
    with pytest.raises(ValueError, match=rf"^{name} must .* x 0\.250 to 0\.750 m, y -0\.500 to 0\.500 m, got Pose2"):
        label(Step(ExpertAction(action)), inputs, LITE)
    edge = label(Step(ExpertAction(PickPlace(Pose2(0.25, 0.5), Pose2(0.7499, -0.4999)))), inputs, LITE)
    assert [round(i) for i in (*edge.pick, *edge.place)] == [0, 0, 159, 79]


@pytest.mark.parametrize("symmetry", [90, -math.pi, 2.0, NAN, math.inf, 1e6, 1e-300, 5e-324])
def test_a_symmetry_that_is_none_is_refused(symmetry):
    for name in ("pick_symmetry", "place_symmetry"):
        with pytest.raises(ValueError, match=f"^{name} must be the smallest turn in radians .*, got"):
            ExpertAction(PickPlace(ON, ON), **{name: symmetry})
    with pytest.raises(ValueError, match=r"^symmetry must be"):
        right_bins(0.3, symmetry, 36)
    ExpertAction(PickPlace(ON, ON), 1.5708, 2 * math.pi)
