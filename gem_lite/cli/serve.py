"""``gem-lite serve``: a policy for robots whose computer has no torch."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

from gem_lite.cli.base import Clip

TOKEN = "GEM_LITE_TOKEN"
"""The environment variable with the token: on a command line, everybody on the machine could read it."""


def serve(checkpoint: Path, /, *, host: str = "127.0.0.1", port: int = 8000, clip: Clip = None) -> None:
    """Answer robots: pictures and a sentence in, poses and confidence out.

    It speaks the protocol of openpi's websocket client (docs/your_table.md).
    It listens to this machine alone. For others, set the environment variable
    GEM_LITE_TOKEN, which a client must then send, and give --host.

    Args:
        checkpoint: policy that answers
        host: address to listen at
        port: port to listen at; 0 takes a free one

    Examples:
      gem-lite serve data/gem-multi.safetensors
    """
    from gem_lite import clip as clips
    from gem_lite.policies import checkpoints
    from gem_lite.policies.gem import Gem
    from gem_lite.serving.server import PolicyServer

    card = checkpoints.read_card(checkpoint)
    policy = checkpoints.load_policy(checkpoint, clips.load(clip)).eval()
    facts = {name: card.get(name) for name in ("method", "task", "sha256")}
    facts["rectangle"] = list(policy.config.workspace.limits)
    facts["refuses"] = isinstance(policy, Gem)

    async def run() -> None:
        server = await PolicyServer(policy, facts, os.environ.get(TOKEN, "")).start(host, port)
        print(f"{card['method']} listens at ws://{host}:{server.sockets[0].getsockname()[1]}", flush=True)
        await server.serve_forever()

    asyncio.run(run())
