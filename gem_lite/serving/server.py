"""``gem-lite serve``: a robot sends pictures and a sentence, and gets poses, confidence or a refusal.

The server speaks the protocol of openpi's websocket client. After the connection it sends facts about the policy. Then
it answers each message, a dict:

    prompt        the sentence
    colors        for each camera (H, W, 3) uint8 RGB
    depths        for each camera (H, W) floating point numbers: metres along its axis, 0 where nothing was measured
    intrinsics    for each camera (3, 3), in pixels
    poses         for each camera (4, 4), from its axes (x right, y down, z forward) to the table's frame, in metres
    empty_picks   optional, (N, 3): x, y (m) and yaw (radians) where the tool has just grasped nothing

The answer is a dict, too: see `answer`. A message that is not allowed gets a text with the reason, and the connection
stays; openpi's client raises it as RuntimeError. Only a message above `LARGEST_MESSAGE` ends its connection. Web pages
may not ask: their requests name an origin.
"""

from __future__ import annotations

import asyncio
import hmac
import http
import ipaddress
import logging
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from gem_lite.actions import Push
from gem_lite.maps.refusal import refusal
from gem_lite.policies import robot_plan
from gem_lite.policies.base import Policy
from gem_lite.policies.gem import Gem
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Pose2
from gem_lite.serving.messages import pack, unpack

LARGEST_MESSAGE = 2**26
"""Bytes of a message. Ten cameras of 1280 x 720 with depths in float32 have less."""
FAILED = "the server failed: see its log"
LOG = logging.getLogger(__name__)
ARRAYS = ("colors", "depths", "intrinsics", "poses")


def answer(policy: Policy, message: object) -> dict[str, Any]:
    """What a policy says to a message.

    Returns:
        "refusal": why the robot should not act, or "". Without one, a "kind": "pick and place" with "pick" and "place",
        (4, 4) poses of the tool in the table's frame, and their "confidence", "lead", "seen", "unseen_pick" and
        "unseen_place" (`robot_plan.RobotPlan`); or
        "push" with "start" and "end", (2,) metres. "server_timing": milliseconds of each part.

    Raises:
        ValueError: an entry is missing or not allowed, or the parser refuses the sentence.
    """
    start = time.perf_counter()
    observation, sentence, empty_picks = _read(message)
    queries = policy.read(sentence)
    times = {"read_ms": _since(start)}
    scene = policy.embed(observation.views)
    times["look_ms"] = _since(start) - sum(times.values())
    reason = refusal(scene, [queries.pick, queries.place], policy.source) if isinstance(policy, Gem) else None
    found: dict[str, Any] = {"refusal": reason or ""}
    if not reason:
        choice = policy.decide_in(scene, observation.views, queries, empty_picks)
        if isinstance(choice.action, Push):
            ends = (choice.action.start, choice.action.end)
            found |= {"kind": "push"}
            found |= {name: np.array([pose.x, pose.y]) for name, pose in zip(("start", "end"), ends, strict=True)}
        else:
            plan = robot_plan.plan(choice)
            found |= {"kind": "pick and place", "pick": plan.pick, "place": plan.place}
            found |= {"confidence": plan.confidence, "lead": plan.lead, "seen": plan.seen}
            found |= {"unseen_pick": plan.unseen_pick, "unseen_place": plan.unseen_place}
    times["decide_ms"] = _since(start) - sum(times.values())
    return found | {"server_timing": times | {"infer_ms": _since(start)}}


def _since(start: float) -> float:
    return 1000 * (time.perf_counter() - start)


def _read(message: object) -> tuple[Observation, str, Sequence[Pose2]]:
    if not isinstance(message, Mapping):
        raise ValueError(f"a message must be a dict, got {type(message).__name__}")
    missing = [name for name in ("prompt", *ARRAYS) if name not in message]
    if missing:
        raise ValueError(f"the message lacks {', '.join(missing)}")
    if not isinstance(message["prompt"], str):
        raise ValueError(f"prompt must be a text, got {type(message['prompt']).__name__}")
    for name in ARRAYS:
        if not isinstance(message[name], list | np.ndarray) or getattr(message[name], "ndim", 1) == 0:
            raise ValueError(f"{name} must be a list with an array for each camera, got {type(message[name]).__name__}")
    given = message.get("empty_picks", np.zeros((0, 3)))
    if not isinstance(given, np.ndarray) or given.ndim != 2 or given.shape[1] != 3:
        raise ValueError("empty_picks must be an array (N, 3)")
    picks = given.astype(float)
    if not np.isfinite(picks).all():
        raise ValueError("empty_picks must be finite numbers")
    observation = Observation.from_arrays(*(message[name] for name in ARRAYS))
    return observation, message["prompt"], [Pose2(*pick) for pick in picks.tolist()]


class PolicyServer:
    """Answers any number of clients, one message at a time.

    Args:
        policy: in the mode of acting.
        facts: what a client gets after the connection.
        token: what a client must know, in ASCII; without one, everybody may ask.

    Raises:
        ValueError: the token has other characters.
    """

    def __init__(self, policy: Policy, facts: Mapping[str, object], token: str = "") -> None:
        if not token.isascii():
            raise ValueError("the token must be of ASCII characters")
        self.policy = policy
        self.facts = dict(facts)
        self.token = token
        self._busy = asyncio.Lock()

    async def start(self, host: str, port: int) -> Server:
        """Listen.

        Raises:
            ValueError: other machines can reach ``host``, and there is no token.
            OSError: the port is taken, or the host is not this machine's.
        """
        if not self.token and not is_loopback(host):
            raise ValueError(f"host {host!r} can be reached from other machines: a token is needed")
        return await serve(
            self._talk,
            host,
            port,
            process_request=self._admit,
            max_size=LARGEST_MESSAGE,
            max_queue=1,
            compression=None,
            origins=[None],
        )

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse who does not know the token."""
        given = request.headers.get("Authorization", "").removeprefix("Api-Key ")
        if self.token and not hmac.compare_digest(given.encode(), self.token.encode()):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "the token is wrong or missing\n")
        return None

    async def _talk(self, connection: ServerConnection) -> None:
        with suppress(ConnectionClosed):  # The client went away.
            await connection.send(pack(self.facts))
            async for content in connection:
                await connection.send(await self._answered(content))

    async def _answered(self, content: bytes | str) -> bytes | str:
        if isinstance(content, str):
            return "the message is damaged: it must be bytes, got a text"
        try:
            message = unpack(content)
            start = time.perf_counter()
            async with self._busy:
                waited = _since(start)
                found = await asyncio.to_thread(answer, self.policy, message)
        except ValueError as error:
            return str(error)
        except Exception:
            LOG.exception(FAILED)
            return FAILED
        found["server_timing"]["waited_ms"] = waited
        return pack(found)


def is_loopback(host: str) -> bool:
    """Whether only programs on this machine reach a host's name or address."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
