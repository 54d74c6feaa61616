"""The simulated table: PyBullet world, cameras, height map, gripper and tasks."""
