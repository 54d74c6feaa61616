"""``gem-lite names``: what can be named."""

from __future__ import annotations

from gem_lite.cli.base import Import


def names(*, import_: Import = ()) -> None:
    """List the names of tasks, worlds and methods.

    Examples:
      gem-lite names
    """
    from gem_lite import tasks
    from gem_lite.evaluation.actors import SCRIPTED
    from gem_lite.policies import methods
    from gem_lite.simulation import looks

    print("tasks:", *(f"  {name}" for name in tasks.names()), sep="\n")
    print("worlds:", *(f"  {name}" for name in looks.names()), sep="\n")
    print("methods:", *(f"  {name:48s}{meaning}" for name, meaning in methods.meanings().items()), sep="\n")
    print(f"  {', '.join(SCRIPTED)}: need no checkpoint; expert-rounded shows the loss by rounding alone")
