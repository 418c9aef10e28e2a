"""The control channel of a cell: invalid requests are refused and do no harm."""

import json
import socket

import pytest

from scenarios.rigs.emulated_cell import ControlServer
from tests.wire.cases import case

HOST = "127.0.0.9"


@pytest.fixture
def requests():
    return []


@pytest.fixture
def serve(requests):
    opened = []

    def execute(request):
        if request["verb"] == "dance":
            raise KeyError("dance")
        requests.append(request)
        return {}

    def start(token=""):
        opened.append(ControlServer(HOST, execute, token))
        return opened[-1].__enter__()

    yield start
    for server in opened:
        server.__exit__()


def ask(server, line, more=""):
    with (
        socket.create_connection((HOST, server.port), timeout=10) as sock,
        sock.makefile("rw") as f,
    ):
        f.write(line + "\n" + more)
        f.flush()
        return json.loads(f.readline())


INVALID_REQUESTS = (
    "", "null", "[]", "{", '{"verb": NaN}', "[" * 60_000, '{"verb": "a", "x": 1e999}', "\x00",
    "{}", '{"verb": "dance"}',
)  # fmt: skip


def test_reply_to_an_invalid_request_is_an_error(serve, requests) -> None:
    server = serve()
    for line in INVALID_REQUESTS:
        with case(line):
            assert "error" in ask(server, line)
    assert not requests
    assert ask(server, '{"verb": "truth"}') == {}


def test_requests_without_the_token_are_refused(serve, requests) -> None:
    server = serve("secret")
    for wrong in ("{}", '{"token": "secre"}', '{"token": null}', '{"token": ["secret"]}'):
        assert "token" in ask(server, wrong)["error"]
    assert not requests
    assert ask(server, '{"verb": "truth", "token": "secret"}') == {}
    assert requests == [{"verb": "truth"}]
