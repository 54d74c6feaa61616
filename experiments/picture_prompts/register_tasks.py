"""The import of this module makes the task's three levels known by name: `gem-lite collect ... --import` does so."""

from experiments.picture_prompts.visual_manipulation import LISTS, VisualManipulation
from gem_lite.tasks.registry import TASKS, Variant

FAMILY = "visual-manipulation"
TASK_NAMES = tuple(f"{FAMILY}-{level}" for level in LISTS)

for name, level in zip(TASK_NAMES, LISTS, strict=True):
    TASKS.add(name, Variant(FAMILY, VisualManipulation, {"level": level}), __name__)
