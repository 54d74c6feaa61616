"""The simulated tables: PyBullet worlds, cameras, bodies, tools and the base of all tasks."""

import os


def _import_pybullet_quietly() -> None:
    """Import PyBullet without its message on the error stream (it writes its build time in every process)."""
    stream = os.dup(2)
    with open(os.devnull, "w") as null_device:
        os.dup2(null_device.fileno(), 2)
        try:
            import pybullet  # noqa: F401
        finally:
            os.dup2(stream, 2)
            os.close(stream)


_import_pybullet_quietly()
