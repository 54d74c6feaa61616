"""A robot's own program: look, ask, decide, move. Replace `StandInRobot` by yours. It needs no simulator.

python docs/robot_example.py data/foreign-scenes/workbench "put the red block in the blue bowl" [policy.safetensors]
"""

import sys
from pathlib import Path

import numpy as np

from gem_lite import clip
from gem_lite.maps.refusal import refusal
from gem_lite.policies import checkpoints
from gem_lite.policies.robot_plan import plan
from gem_lite.rgbd.observation import Observation


class StandInRobot:
    """Prints what a real one would do. Its base stands at x = -0.3 m on the table's frame, turned by 90 degrees."""

    base_from_table = np.array([[0, -1, 0, 0.0], [1, 0, 0, 0.3], [0, 0, 1, 0.0], [0, 0, 0, 1]])

    def move(self, pose: np.ndarray, above: float) -> None:
        """Go to a pose, or above it (m)."""
        x, y, z = pose[:3, 3] + [0, 0, above]
        print(f"move to ({x:.3f}, {y:.3f}, {z:.3f}) m")

    def grip(self, closed: bool) -> None:
        """Close or open the gripper."""
        print("close" if closed else "open")


robot = StandInRobot()
checkpoint = Path(sys.argv[3]) if len(sys.argv) > 3 else clip.DATA / "gem-multi.safetensors"
policy = checkpoints.load_policy(checkpoint, clip.load()).eval()
observation, queries = Observation.load(sys.argv[1]), policy.read(sys.argv[2])
reason = refusal(policy.embed(observation.views), [queries.pick, queries.place], policy.source)
if reason:
    sys.exit(f"refused: {reason}")
choice = policy.decide(observation, queries)
found = plan(choice, robot.base_from_table)
print(f"confidence {found.confidence:.2f}, {found.lead:.3g} times as probable as the runner-up at {found.runner_up}")
held = found.pick[2, 3] - robot.base_from_table[2, 3]  # (m) the tool holds the thing this far above its lower side
for pose, height, closed in ((found.pick, 0.0, True), (found.place, held, False)):
    robot.move(pose, height + 0.2)
    robot.move(pose, height)
    robot.grip(closed)
    robot.move(pose, height + 0.2)
