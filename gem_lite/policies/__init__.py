"""Policies choose actions: GEM, its rivals, their ablations and checkpoints. They do not import a simulator."""

from gem_lite.policies import gem  # noqa: F401, I001 (each module registers its methods: GEM is the first in every list)
from gem_lite.policies import cliport, transporter  # noqa: F401
