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
    assert [command["do"] for command in got] == ["move", "move", "close", "move", "move", "move", "open", "move"]
    poses = np.array([command["pose"] for command in got])
    assert poses[:, 2, 3] == pytest.approx([0.34, 0.14, 0.14, 0.34, 0.38, 0.18, 0.18, 0.38]), "0.04 m is held"
    assert np.allclose(poses[:4, :2, 3], [-0.2, 0.7]) and np.allclose(poses[4:, :2, 3], [0.2, 0.9])


@pytest.mark.parametrize("outcome", [Outcome.NOTHING_HELD, Outcome.OUT_OF_REACH])
def test_a_failure_has_a_name_ends_the_motion_and_the_next_act_goes_on(outcome):
    with robot_that("close", outcome.value) as (robot, commands):
        for _ in range(2):
            assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is outcome
        assert [command["do"] for command in commands()] == ["move", "move", "close", "stop"] * 2


def test_what_drops_on_the_way_is_said():
    with robot_that("open", "dropped") as (robot, _):
        assert robot.pick(PICK, HEIGHTMAP)
        robot.place(PLACE, HEIGHTMAP)
        assert robot.outcome is Outcome.DROPPED


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
        assert not act.is_alive() and robot.outcome is Outcome.NO_ANSWER


def test_nothing_is_sent_for_a_pose_beside_the_table_or_in_a_dry_run(capsys):
    with robot_that() as (robot, commands):
        assert not robot.pick(Pose2(0.9, 0.0), HEIGHTMAP) and robot.outcome is Outcome.OUT_OF_REACH
        robot.dry_run = True
        assert robot.pick(PICK, HEIGHTMAP) and robot.stop()
        assert commands() == []
    printed = [json.loads(line)["do"] for line in capsys.readouterr().out.splitlines()]
    assert printed == ["move", "move", "close", "move", "stop"]


def test_nobody_listens_or_the_answer_is_unknown():
    assert not SocketRobot(("127.0.0.1", 9), BASE, 0.5).stop()
    with robot_that("move", "hello") as (robot, _):
        assert not robot.pick(PICK, HEIGHTMAP) and robot.outcome is Outcome.NO_ANSWER


def test_it_is_short():
    lines = [line for line in Path(socket_robot.__file__).read_text().splitlines() if line.strip()]
    assert len(lines) <= 60
