"""The server for robots: openpi's own client reads it; what is wrong is said; clients may come and go."""

import asyncio
import contextlib
import os
import subprocess
import sys
import threading

import msgpack
import numpy as np
import pytest
from openpi_client.websocket_client_policy import WebsocketClientPolicy
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from gem_lite import clip
from gem_lite.cli import main
from gem_lite.rgbd.observation import Observation
from gem_lite.serving import server as serving
from gem_lite.serving.messages import pack, unpack

SCENE = Observation.load(clip.DATA / "foreign-scenes" / "workbench")
SENTENCE = "put the red block in the blue bowl"


def request(prompt=SENTENCE, **changes):
    views = SCENE.views
    return {
        "prompt": prompt,
        "colors": [view.rgb for view in views],
        "depths": [view.depth for view in views],
        "intrinsics": [np.array(view.camera.intrinsics) for view in views],
        "poses": [np.array(view.camera.pose) for view in views],
    } | changes


@contextlib.contextmanager
def serve(policy=None, token=""):
    """The port of a server in a thread of this process."""
    ready, ports, loop = threading.Event(), [], asyncio.new_event_loop()

    async def run():
        server = await serving.PolicyServer(policy, {"method": "gem"}, token).start("127.0.0.1", 0)
        ports.append(server.sockets[0].getsockname()[1])
        ready.set()
        await server.serve_forever()

    def work():
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(task)

    task = loop.create_task(run())
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    assert ready.wait(30)
    try:
        yield ports[0]
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(30)
        assert not thread.is_alive()


@pytest.fixture
def echo(monkeypatch):
    """Answers of a policy that takes no time: the number of the message."""

    def answer(policy, message):
        return {"number": message["number"], "server_timing": {}}

    monkeypatch.setattr(serving, "answer", answer)


def test_openpis_client_gets_poses_a_refusal_and_times_from_the_command(multi, tmp_path):
    policy = str(clip.DATA / "gem-multi.safetensors")
    line = [sys.executable, "-m", "gem_lite.cli", "serve", policy, "--port", "0"]
    with subprocess.Popen(
        line, stdout=subprocess.PIPE, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"}
    ) as process:
        said = process.stdout.readline()
        try:
            robot = WebsocketClientPolicy(said.split()[-1])
            assert robot.get_server_metadata()["method"] == "gem-multi"
            found = robot.infer(request())
            expected = serving.answer(multi, request())
            assert found["kind"] == "pick and place" and found["refusal"] == ""
            assert np.allclose(found["pick"], expected["pick"]) and np.allclose(found["place"], expected["place"])
            assert np.allclose(found["pick"][:2, 3], [0.40, 0.25], atol=0.02) and 0 < found["confidence"] <= 1
            times = found["server_timing"]
            assert set(times) == {"read_ms", "look_ms", "decide_ms", "infer_ms", "waited_ms"}
            assert times["infer_ms"] == pytest.approx(
                sum(times[f"{part}_ms"] for part in ("read", "look", "decide")), 0.01
            )
            assert "purple mug" in robot.infer(request("put the purple mug in the blue bowl"))["refusal"]
            with pytest.raises(RuntimeError, match="prompt must be a text, got int"):
                robot.infer(request(5))
            away = robot.infer(request(empty_picks=np.array([[*found["pick"][:2, 3], 0.0]])))
            assert np.linalg.norm(away["pick"][:2, 3] - found["pick"][:2, 3]) > multi.config.empty_radius
        finally:
            process.kill()  # An interrupt may be ignored where the tests run in the background.


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\xc1", "the message is damaged"),
        (pack(request())[:1000], "the message is damaged"),
        ("words", "it must be bytes, got a text"),
        (pack([1, 2]), "a message must be a dict, got list"),
        (pack({"prompt": SENTENCE}), "the message lacks colors, depths, intrinsics, poses"),
        (pack(request(depths=[np.zeros(3)] * len(SCENE.views))), "depths (H, W), got"),
        (pack(request(colors=7)), "colors must be a list with an array for each camera, got int"),
        (pack(request(colors=np.array(7))), "colors must be a list with an array for each camera, got ndarray"),
        (pack(request(poses=[])), "must be equally many"),
        (pack(request(empty_picks=np.zeros(2))), "empty_picks must be an array (N, 3)"),
        (pack(request(empty_picks={"a": 1})), "empty_picks must be an array (N, 3)"),
        (pack(request(empty_picks=np.array([[0.5, 0, 0], [np.nan, 0, 0]]))), "empty_picks must be finite numbers"),
        (msgpack.packb({b"__npgeneric__": True, b"data": 300, b"dtype": "|i1"}), "the message is damaged"),
        (msgpack.packb({b"__ndarray__": True, b"data": b"ab", b"dtype": "|O", b"shape": [1]}), "must hold numbers"),
        (
            msgpack.packb({b"__ndarray__": True, b"data": b"ab", b"dtype": "<f4", b"shape": [9]}),
            "the message is damaged",
        ),
        (msgpack.packb({b"__ndarray__": True, b"dtype": "hello"}), "the message is damaged"),
        (pack(request("fly to the moon")), "moon"),
    ],
)
def test_what_is_wrong_is_said_and_the_connection_stays(multi, content, said):
    with serve(multi) as port, connect(f"ws://127.0.0.1:{port}", max_size=None) as link:
        link.recv()
        for _ in range(2):
            link.send(content)
            reply = link.recv()
            assert isinstance(reply, str) and said in reply


def test_an_oversized_message_ends_its_own_connection_alone(echo, monkeypatch):
    monkeypatch.setattr(serving, "LARGEST_MESSAGE", 1000)
    with serve() as port, connect(f"ws://127.0.0.1:{port}") as other, connect(f"ws://127.0.0.1:{port}") as link:
        link.recv(), other.recv()
        with pytest.raises(ConnectionClosed):
            link.send(bytes(2000))
            link.recv()
        other.send(pack({"number": 4}))
        assert unpack(other.recv())["number"] == 4


def test_no_answer_is_lost_when_clients_come_and_go(echo):
    with serve() as port:
        lost = []

        def ask(first):
            with connect(f"ws://127.0.0.1:{port}") as link:
                link.recv()
                for number in range(first, first + 500):
                    link.send(pack({"number": number}))
                    lost.extend([number] * (unpack(link.recv())["number"] != number))

        clients = [threading.Thread(target=ask, args=(first,)) for first in (0, 500)]
        for client in clients:
            client.start()
        for number in range(10):  # They ask and go away without the answer.
            with connect(f"ws://127.0.0.1:{port}") as link:
                link.recv()
                link.send(pack({"number": number}))
                link.socket.close()
        for client in clients:
            client.join(60)
        assert lost == [] and not any(client.is_alive() for client in clients)


def test_who_listens_elsewhere_asks_for_a_token(echo, monkeypatch, capsys):
    with serve(token="open sesame") as port:
        for headers in ({}, {"Authorization": "Api-Key open"}):
            with pytest.raises(InvalidStatus, match="401"):
                connect(f"ws://127.0.0.1:{port}", additional_headers=headers)
        robot = WebsocketClientPolicy("127.0.0.1", port, api_key="open sesame")
        assert robot.infer({"number": 3})["number"] == 3
    monkeypatch.delenv("GEM_LITE_TOKEN", raising=False)
    policy = str(clip.DATA / "gem-put-block-in-bowl.safetensors")
    assert main(["serve", policy, "--host", "0.0.0.0", "--port", "0"]) == 2
    assert "host '0.0.0.0' can be reached from other machines: a token is needed" in capsys.readouterr().err


def test_a_web_page_may_not_ask_and_a_failure_is_told_from_a_wrong_message(echo, caplog):
    with serve() as port:
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://127.0.0.1:{port}", origin="http://example.org")
        with connect(f"ws://127.0.0.1:{port}") as link:
            link.recv()
            link.send(pack({}))  # The stand-in for a policy fails: it wants a number.
            assert link.recv() == serving.FAILED and "KeyError" in caplog.text
            link.send(pack({"number": 8}))
            assert unpack(link.recv())["number"] == 8
    with pytest.raises(ValueError, match="must be of ASCII"):
        serving.PolicyServer(None, {}, "für dich")


def test_a_push_has_a_start_and_an_end(multi, monkeypatch):
    monkeypatch.setattr("gem_lite.serving.server.refusal", lambda *_: None)  # The table holds no such square.
    found = serving.answer(multi, request("push the pile of red blocks into the blue square"))
    assert found["kind"] == "push" and found["start"].shape == found["end"].shape == (2,)


def test_messages_come_back_as_they_were():
    message = {
        "a": [1, 2.5, "text", None, True],
        "b": np.arange(6, dtype=np.float32).reshape(2, 3),
        "c": np.float32(2.0),
    }
    found = unpack(pack(message))
    assert found["a"] == message["a"] and np.array_equal(found["b"], message["b"]) and found["b"].dtype == np.float32
    assert found["c"] == 2.0 and isinstance(found["c"], np.float32)
    assert not found["b"].flags.writeable and unpack(pack(np.array([1.0], ">f4"))).dtype == np.float32
    for value, said in ((set(), "holds no set"), (np.array([object()]), "no numbers of the type object")):
        with pytest.raises(TypeError, match=said):
            pack({"a": value})
