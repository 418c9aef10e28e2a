"""What clients of the emulator's ports find when it ends."""

import contextlib
import socket
import time

import pytest

from drivers.ur.emulator.sockets import Farewell, LineTalk, ScriptTalk, Server

PATIENCE_S = 20.0


def test_line_of_every_client_is_cut_with_the_server_also_of_one_that_was_refused():
    server = Server()
    with contextlib.ExitStack() as serving, contextlib.ExitStack() as clients:
        serving.callback(server.close)
        port = server.listen(
            "127.0.0.1", 0, lambda: (Farewell(), b"hello"), most=1, refusal=lambda why: why.encode()
        )
        first, second = (
            clients.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
            for _ in range(2)
        )
        second.setblocking(False)
        deadline, told = time.monotonic() + PATIENCE_S, b""
        while not told and time.monotonic() < deadline:
            server.serve(0.01)
            with contextlib.suppress(BlockingIOError):
                told = second.recv(1024)
        assert b"too many connections" in told
        assert first.recv(1024) == b"hello"
        serving.close()
        for client in (first, second):
            client.settimeout(PATIENCE_S)
            with pytest.raises(ConnectionError):
                while time.monotonic() < deadline:
                    client.sendall(b"anybody there?")
                    time.sleep(0.01)


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


def test_program_of_a_client_that_has_gone_is_taken_before_its_line_is_closed():
    """Also where the state was told to it, twice, before there was time to read."""
    loaded = []
    with contextlib.ExitStack() as serving:
        server = Server()
        serving.callback(server.close)
        port = server.listen(
            "127.0.0.1", 0, lambda: (ScriptTalk(loaded.append, "cycle"), b""), most=32
        )
        text = "def f():\n" + " a = 1\n" * 1000 + "end\n"
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as client:
            deadline = time.monotonic() + PATIENCE_S
            while not server.talks() and time.monotonic() < deadline:
                server.serve(0.01)
            client.sendall(text.encode())
        while server.talks() and time.monotonic() < deadline:
            server.broadcast(lambda talk: b"state")
            time.sleep(0.01)
    assert loaded == [text]
