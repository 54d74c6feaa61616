"""A robot's own program: look, decide, move. Replace `StandInRobot` by yours. It needs no simulator.

python docs/robot_example.py data/foreign-scenes/workbench "put the red block in the blue bowl"
"""

import sys

import numpy as np

from gem_lite import clip
from gem_lite.maps.recognition import refusal
from gem_lite.policies import checkpoints
from gem_lite.policies.robot import plan
from gem_lite.rgbd.observation import Observation


class StandInRobot:
    """Prints what a real one would do. Its base stands beside the table, turned by 90 degrees."""

    base_from_table = np.array([[0, -1, 0, 0.1], [1, 0, 0, -0.5], [0, 0, 1, 0.0], [0, 0, 0, 1]])

    def move(self, pose: np.ndarray, above: float, grip: bool) -> None:
        """Go to a pose, or above it (m)."""
        x, y, z = pose[:3, 3] + [0, 0, above]
        print(f"move to ({x:.3f}, {y:.3f}, {z:.3f}) m, {'closed' if grip else 'open'}")


robot = StandInRobot()
policy = checkpoints.load_policy(clip.DATA / "gem-multi.safetensors", clip.load()).eval()
observation, queries = Observation.load(sys.argv[1]), policy.read(sys.argv[2])
reason = refusal(policy.embed(observation.views), [queries.pick, queries.place], policy.source)
if reason:
    sys.exit(f"refused: {reason}")
choice = policy.decide(observation, queries)
found = plan(choice, robot.base_from_table)
print(f"confidence {found.confidence:.2f}, {found.lead:.3g} times as probable as the runner-up at {found.runner_up}")
for pose, grip in ((found.pick, True), (found.place, False)):
    for height in (0.2, 0.0):
        robot.move(pose, height, grip=not grip)
    robot.move(pose, 0.2, grip=grip)
