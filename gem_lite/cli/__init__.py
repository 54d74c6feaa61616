"""The command ``gem-lite``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

try:
    from gem_lite.cli import base
except ModuleNotFoundError as missing:  # The core group alone is installed: it has no commands.
    sys.exit(f"gem-lite needs {missing.name}, which the group table brings: pip install 'gem_lite[table]'")

from gem_lite.cli import (
    app,
    clip,
    collect,
    demo,
    evaluate,
    imports,
    names,
    own_table,
    plan,
    read,
    results,
    serve,
    set_up,
    train,
)

ABOUT = "Grounded Equivariant Manipulation. gem-lite COMMAND --help explains a command."
GROUPS = (
    base.make_app("clip", "Calibrate a CLIP.", clip.calibrate),
    base.make_app("results", "Show the stored rows.", results.list_, results.show),
)
APP = base.make_app(
    "gem-lite", ABOUT, demo.demo, collect.collect, collect.verify, train.APP, evaluate.evaluate,
    evaluate.several_tables, imports.APP, set_up.APP, own_table.check_cameras, own_table.look, app.app, serve.serve,
    read.read, plan.plan, names.names, *GROUPS, help_epilogue="Example:\n  gem-lite evaluate --help",
)  # fmt: skip


def main(words: Sequence[str] | None = None) -> int:
    """Run a command line, by default that of `sys.argv`. Returns the exit code, see `base.run`."""
    return base.run(APP, words)
