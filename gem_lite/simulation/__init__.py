"""The simulated table: PyBullet world, cameras, height map, gripper and tasks."""

import os


def _import_pybullet_quietly() -> None:
    """PyBullet writes its build time to the error stream on import; in every process, that is noise."""
    stream = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            import pybullet  # noqa: F401
        finally:
            os.dup2(stream, 2)
            os.close(stream)


_import_pybullet_quietly()
