"""What a message to `gem-lite serve` takes besides the policy: python -m experiments.speed.serving

One client alone, and then two at once, send a thousand messages with the pictures of one or three cameras (640 x 480:
2.1 or 6.5 MB). Meanwhile ten other clients ask and go away. In the place of a policy stands a function that reads the
pictures and answers at once.

Most of the time is spent on getting memory from the system and on giving it back. With glibc, both programs keep it if
they are started with

    MALLOC_MMAP_THRESHOLD_=33554432 MALLOC_TRIM_THRESHOLD_=268435456
"""

import asyncio
import multiprocessing
import threading
import time

import numpy as np
import psutil
from openpi_client.websocket_client_policy import WebsocketClientPolicy
from websockets.sync.client import connect

from gem_lite.serving import server as serving
from gem_lite.serving.messages import pack

REQUESTS, GOING_AWAY = 1000, 10
CAMERA = {
    "colors": np.full((480, 640, 3), 90, np.uint8),
    "depths": np.full((480, 640), 0.9, np.float32),
    "intrinsics": np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]),
    "poses": np.array([[1.0, 0, 0, 0.5], [0, -1, 0, 0], [0, 0, -1, 1.05], [0, 0, 0, 1]]),
}


def at_once(policy, message):
    start = time.perf_counter()
    observation, _, _ = serving._read(message)
    spent = 1000 * (time.perf_counter() - start)
    return {"cameras": len(observation.views), "number": message["number"], "server_timing": {"infer_ms": spent}}


def serve(port):
    """The server's process. Sends its port."""
    serving.answer = at_once

    async def run():
        server = await serving.PolicyServer(None, {}).start("127.0.0.1", 0)
        port.send(server.sockets[0].getsockname()[1])
        await server.serve_forever()

    asyncio.run(run())


def measure(cameras, clients):
    """Print lost answers, times and memory."""
    message = {"prompt": "put the red block in the blue bowl"} | {name: [one] * cameras for name, one in CAMERA.items()}
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("spawn").Process(target=serve, args=(sender,), daemon=True)
    process.start()
    port, watched = receiver.recv(), psutil.Process(process.pid)
    besides, lost, memory = [], [], []

    def ask(first):
        robot = WebsocketClientPolicy("127.0.0.1", port)
        for number in range(first, first + REQUESTS // clients):
            start = time.perf_counter()
            answer = robot.infer(message | {"number": number})
            timing = answer["server_timing"]
            besides.append(1000 * (time.perf_counter() - start) - timing["infer_ms"] - timing["waited_ms"])
            lost.extend([number] * (answer["number"] != number))
            if number % 100 == 99:
                memory.append(watched.memory_info().rss / 2**20)

    robots = [threading.Thread(target=ask, args=(k * REQUESTS // clients,)) for k in range(clients)]
    for robot in robots:
        robot.start()
    for _ in range(GOING_AWAY):
        time.sleep(0.5)
        with connect(f"ws://127.0.0.1:{port}", max_size=None) as link:
            link.send(pack(message | {"number": -1}))
            link.socket.close()
    for robot in robots:
        robot.join()
    print(f"{cameras} cameras, {clients} clients: {len(besides)} answers, {len(lost)} lost or mixed up")
    print(f"besides the policy and waiting for another client: median {np.median(besides):.1f} ms")
    print(f"the server's memory: {memory[1]:.0f} MiB after a fifth, {memory[-1]:.0f} MiB at the end")
    process.kill()


def main():
    """Measure with one camera and with three, one client and two."""
    for clients in (1, 2):
        for cameras in (1, 3):
            measure(cameras, clients)


if __name__ == "__main__":
    main()
