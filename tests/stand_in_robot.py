"""A robot's controller, as a process of its own: it answers each line, and prints what it got.

python stand_in_robot.py WORD ANSWER: commands that contain WORD get ANSWER ("silence": none), all others get "done".
"""

import socketserver
import sys
import threading

WORD, ANSWER = sys.argv[1:]
stopped = threading.Event()


class Controller(socketserver.StreamRequestHandler):
    """Answers one command."""

    def handle(self) -> None:
        """Read a line, print it, answer."""
        line = self.rfile.readline().decode().strip()
        print(line, flush=True)
        if '"stop"' in line:
            stopped.set()
        elif WORD in line and ANSWER == "silence":
            stopped.wait(30)
            return
        answer = ANSWER if WORD in line else "done"
        self.wfile.write(f"{answer}\n".encode())


class Server(socketserver.ThreadingTCPServer):
    """Several connections at a time: a stop comes while a motion goes on."""

    daemon_threads = True


with Server(("127.0.0.1", 0), Controller) as server:
    print(server.server_address[1], flush=True)
    server.serve_forever()
