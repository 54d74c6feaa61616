"""What tests of the simulated table share: bodies, layouts, and episodes of the expert."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pybullet as p

from gem_lite import tasks
from gem_lite.actions import PickPlace
from gem_lite.foundations import colors
from gem_lite.se2 import Pose2
from gem_lite.simulation.bodies import shapes

HERE, THERE = Pose2(0.4, 0.2, 0.5), Pose2(0.6, -0.2, 0.5)
MOVE = PickPlace(HERE, THERE)


def block(pose=HERE, color="red"):
    return partial(shapes.add_block, color=colors.rgba(color), pose=pose)


def bowl(pose, movable=False):
    return partial(shapes.add_bowl, color=colors.rgba("green"), pose=pose, movable=movable)


def distance(a, b):
    return math.hypot(a.x - b.x, a.y - b.y)


def teleport(world, body, pose, z=0.02):
    turn = p.getQuaternionFromEuler((0, 0, pose.yaw))
    p.resetBasePositionAndOrientation(body.id, (pose.x, pose.y, z), turn, physicsClientId=world.client)


def lay_out(world, name, index=0, split="val"):
    """The task after the beginning of an episode."""
    task = tasks.make(name, split)
    world.reset(task, tasks.episode_seed(split, index))
    return task


def layout(world, name, split, index):
    """The task after laying out an episode that nothing has simulated since."""
    task = tasks.make(name, split)
    world.workspace = task.workspace
    world.clear()
    seed = tasks.episode_seed(split, index)
    task.reset(world, np.random.default_rng(seed), seed)
    return task


def play(world, task):
    """Let the expert play an episode that is laid out. Its sentences, actions, results, and the bodies at the end."""
    sentences, actions, steps = [], [], []
    while not (steps and steps[-1].done):
        sentences.append(task.instruction)
        actions.append(task.expert(world).action)
        steps.append(world.step(actions[-1]))
    movable = [world.pose(body) for body in world.bodies if body.movable]
    return SimpleNamespace(sentences=sentences, actions=actions, steps=steps, movable=movable)
