"""``gem-lite app``: a page in the browser."""

from __future__ import annotations

from pathlib import Path

from gem_lite.cli.base import Clip
from gem_lite.cli.own_table import SHIPPED, load


def app(checkpoint: Path = SHIPPED, /, *, host: str = "127.0.0.1", port: int = 7860, clip: Clip = None) -> None:
    """A page in the browser: lay a table, say a sentence, see maps and choice, let the simulator act.

    It needs gradio (docs/app.txt). It listens to this machine alone; with
    --host 0.0.0.0 others in your network may use it, one after the other.

    Args:
        checkpoint: policy of gem
        host: address to listen at
        port: port to listen at

    Examples:
      gem-lite app
    """
    try:
        from gem_lite.page.app import serve
    except ImportError as error:
        raise ValueError(f"the page needs gradio, see docs/installing.md: {error}") from None
    policy = load(checkpoint, None, clip).eval()
    print(f"the page is at http://{host}:{port}; Ctrl-C ends it", flush=True)
    serve(policy, host, port)
