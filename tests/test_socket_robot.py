"""The driver of docs/socket_robot.py, with a robot in another process."""

import contextlib
import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from docs import socket_robot
from docs.socket_robot import SocketRobot
from gem_lite.actions import Outcome
from gem_lite.rgbd.heightmap import HeightMap
from gem_lite.se2 import Pose2, Workspace

WORKSPACE = Workspace()
HEIGHTMAP = HeightMap(
    WORKSPACE,
    np.zeros((*WORKSPACE.shape, 3), np.uint8),
    np.full(WORKSPACE.shape, 0.04, np.float32),
    np.ones(WORKSPACE.shape, bool),
)
BASE = np.array([[0, -1, 0, 0.0], [1, 0, 0, 0.3], [0, 0, 1, 0.1], [0, 0, 0, 1]])
PICK, PLACE = Pose2(0.4, 0.2, 0.5), Pose2(0.6, -0.2, 1.0)


@contextlib.contextmanager
def robot_that(word="nothing", answer="done", timeout=5.0):
    """A driver, and a function that ends the robot and returns the commands that it got."""
    line = [sys.executable, str(Path(__file__).with_name("stand_in_robot.py")), word, answer]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:

        def commands():
            process.kill()
            return [json.loads(command) for command in process.stdout]

        try:
            yield SocketRobot(("127.0.0.1", int(process.stdout.readline())), BASE, timeout), commands
        finally:
            process.kill()


def test_it_comes_from_above_grasps_carries_and_lets_go():
    with robot_that() as (robot, commands):
        assert robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.HELD
        robot.place(PLACE, HEIGHTMAP)
        assert robot.outcome is Outcome.PLACED and robot.held is None
        got = commands()
    said = ["open", "above", "down", "close", "above", "above", "down", "open", "above"]
    assert [command["do"] for command in got] == said
    poses = np.array([command["pose"] for command in got if command["do"] in ("above", "down")])
    expected = [0.328, 0.128, 0.328, 0.368, 0.168, 0.368]
    assert poses[:, 2, 3] == pytest.approx(expected), "it grasps 12 mm below the top, and lets go as much higher"
    assert np.allclose(poses[:3, :2, 3], [-0.2, 0.7]) and np.allclose(poses[3:, :2, 3], [0.2, 0.9])


def test_after_an_empty_grasp_it_opens_rises_and_goes_on():
    with robot_that("close", "nothing held") as (robot, commands):
        for _ in range(2):
            assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.NOTHING_HELD
        robot.place(PLACE, HEIGHTMAP)
        assert robot.outcome is Outcome.NOTHING_HELD, "there is nothing to place"
        said = ["open", "above", "down", "close", "open", "above"]
        assert [command["do"] for command in commands()] == 2 * said


def test_what_the_robot_cannot_reach_is_said():
    with robot_that("above", "out of reach") as (robot, commands):
        assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.OUT_OF_REACH
        assert [command["do"] for command in commands()] == ["open", "above"]


def test_what_drops_on_the_way_is_said():
    with robot_that("0.368", "dropped") as (robot, _):  # above the place
        assert robot.pick(PICK, HEIGHTMAP)
        robot.place(PLACE, HEIGHTMAP)
        assert robot.outcome is Outcome.DROPPED and robot.held is None


def test_a_robot_that_does_not_answer_in_time_is_stopped():
    with robot_that("close", "silence", timeout=0.3) as (robot, commands):
        before = time.monotonic()
        assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.NO_ANSWER
        assert time.monotonic() - before < 3
        assert commands()[-1]["do"] == "stop"


def test_a_stop_comes_through_while_a_motion_is_waited_for():
    with robot_that("close", "silence", timeout=20.0) as (robot, _):
        act = threading.Thread(target=robot.pick, args=(PICK, HEIGHTMAP))
        act.start()
        time.sleep(0.5)
        assert act.is_alive() and robot.stop()
        act.join(timeout=5)
        assert not act.is_alive() and robot.held is None
        assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.STOPPED, "it stays stopped"


def test_nothing_is_sent_for_a_pose_beside_the_table_or_in_a_dry_run(capsys):
    with robot_that() as (robot, commands):
        assert not robot.pick(Pose2(0.9, 0.0), HEIGHTMAP) and robot.outcome is Outcome.OUT_OF_REACH
        robot.dry_run = True
        assert robot.pick(PICK, HEIGHTMAP) and robot.stop()
        assert commands() == []
    printed = [json.loads(line)["do"] for line in capsys.readouterr().out.splitlines()]
    assert printed == ["open", "above", "down", "close", "above", "stop"]


def test_nobody_listens_or_the_answer_is_unknown():
    assert not SocketRobot(("127.0.0.1", 9), BASE, 0.5).stop()
    for answer in ("hello", "held", "placed"):
        with robot_that("above", answer) as (robot, _):
            assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.NO_ANSWER and robot.stopped.is_set()


def test_what_could_not_be_placed_is_still_held():
    with robot_that() as (robot, commands):
        assert robot.pick(PICK, HEIGHTMAP)
        robot.place(Pose2(9.0, 9.0), HEIGHTMAP)
        assert robot.outcome is Outcome.OUT_OF_REACH and robot.held is not None
        assert robot.pick(PICK, HEIGHTMAP), "nothing is sent: it does not open"
        robot.place(PLACE, HEIGHTMAP)
        assert robot.outcome is Outcome.PLACED and robot.held is None
        said = [command["do"] for command in commands()]
    assert said == ["open", "above", "down", "close", "above", "above", "down", "open", "above"]


def test_it_is_short():
    lines = [line for line in Path(socket_robot.__file__).read_text().splitlines() if line.strip()]
    assert len(lines) <= 61
