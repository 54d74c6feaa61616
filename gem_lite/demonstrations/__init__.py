"""Expert demonstrations: their records, and how a set of them is saved, loaded and verified."""

from gem_lite.demonstrations.records import OWN_WORLD, Demonstration, DemonstrationStep, quantized
from gem_lite.demonstrations.sets import DemonstrationSet, load, read_manifest, save, write_episode, write_manifest

__all__ = [
    "OWN_WORLD", "Demonstration", "DemonstrationSet", "DemonstrationStep", "load", "quantized", "read_manifest", "save",
    "write_episode", "write_manifest",
]  # fmt: skip
