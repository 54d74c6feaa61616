"""``gem-lite evaluate`` and ``gem-lite several-tables``: measure a policy."""

from __future__ import annotations

from pathlib import Path

from gem_lite.cli.base import Clip, File, Import, Out, Processes, Split, World


def evaluate(
    method: str, task: str, /, *, checkpoint: Path | None = None, episodes: int = 100, start: int = 0,
    split: Split = "test", skip: tuple[int, ...] = (), world: World = "home", clip: Clip = None, preset: str = "lite",
    processes: Processes = None, file: File = False, out: Out = None, import_: Import = (),
) -> None:  # fmt: skip
    """Measure a policy over episodes of a task.

    Prints the mean with its 95 % interval and writes the rows.

    Args:
        method: name of the method: gem-lite names lists them
        task: name of the task: gem-lite names lists them
        checkpoint: checkpoint to load, for a learned method
        episodes: number of episodes
        start: index of the first episode in the split
        skip: indices of episodes to leave out, such as those that the expert does not solve: later ones take their
            place
        preset: pixels and angles of a method without a checkpoint: lite or paper

    Examples:
      gem-lite evaluate gem put-block-in-bowl-unseen-colors --checkpoint data/gem-put-block-in-bowl.safetensors
      gem-lite evaluate expert bars-in-box --episodes 2 --world shadows
    """
    from gem_lite import tasks
    from gem_lite.evaluation import results
    from gem_lite.evaluation.evaluate import Measurement, measure_and_file

    path = results.output(file, out, tasks.family(task))
    measurement = Measurement(method, task, episodes, split, start, checkpoint, clip, world, preset, skip)
    rows, _ = measure_and_file(measurement, path, processes)
    for row in rows:
        print("{method} on {task}, {subset}: {mean} {ci95}, {episodes} episodes".format(**row))
    print(f"the rows are in {path}")


def several_tables(
    checkpoint: Path, /, *, tasks: tuple[str, ...] = ("object-sorting-seen", "object-sorting-unseen"),
    episodes: int = 100, start: int = 0, split: Split = "test", tables: int = 2, curve: bool = False,
    world: World = "home", clip: Clip = None, processes: Processes = None, file: File = False, out: Out = None,
    import_: Import = (),
) -> None:  # fmt: skip
    """Measure a policy over several tables, with their poses from tags and with their true poses.

    Writes all rows.

    Args:
        checkpoint: checkpoint of the policy
        tasks: names of the tasks
        episodes: number of episodes of each task
        start: index of the first episode in the split
        tables: number of tables
        curve: also measure with added errors of the poses

    Examples:
      gem-lite several-tables data/gem-object-sorting.safetensors --curve
      gem-lite several-tables data/gem-object-sorting.safetensors --tasks object-sorting-seen --episodes 2
    """
    from gem_lite.evaluation import results, table_poses
    from gem_lite.evaluation.evaluate import Measurement, measure_and_file
    from gem_lite.policies.checkpoints import read_card
    from gem_lite.tasks import family

    conditions = (*table_poses.BOTH, *(table_poses.CURVE if curve else ()))
    method = read_card(checkpoint)["method"]
    common = episodes, split, start, checkpoint, clip, world
    measurements = [Measurement(method, task, *common, tables=tables, conditions=conditions) for task in tasks]
    for measurement in measurements:  # All tasks before the first is measured.
        measurement.check()
    for measurement in measurements:
        path = results.output(file, out, family(measurement.task))
        rows, errors = measure_and_file(measurement, path, processes)
        for row in rows:
            print("{task}, {poses}, {shift} m, {turn} rad: {mean} {ci95}".format(**row))
        for error in errors:
            print(error)
        print(f"the rows are in {path}")
