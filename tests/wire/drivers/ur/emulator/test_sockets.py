"""What clients of the emulator's ports find when it ends."""

import contextlib
import socket
import time

from drivers.ur.emulator.sockets import LineTalk, Server

PATIENCE_S = 20.0


def test_who_asks_while_many_are_told_the_state_does_not_wait_for_all_of_them():
    """Nor does it matter that some of them go meanwhile."""
    heard = []
    with contextlib.ExitStack() as serving:
        server = Server()
        serving.callback(server.close)
        port = server.listen(
            "127.0.0.1", 0, lambda: (LineTalk(lambda line: heard.append(line) or line), b""),
            most=32,
        )  # fmt: skip
        clients = [
            serving.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
            for _ in range(30)
        ]
        deadline = time.monotonic() + PATIENCE_S
        while len(server.talks()) < len(clients) and time.monotonic() < deadline:
            server.serve(0.01)
        heard_at = []

        def sample(talk):
            if not heard_at:
                clients[-1].sendall(b"is anybody there?\n")
                clients[-2].close()
            until = time.thread_time() + 1e-3
            while time.thread_time() < until:
                pass
            heard_at.append(list(heard))
            return b"."

        server.broadcast(sample)
        assert len(heard_at) == 29
        assert heard_at[2] == ["is anybody there?"]
