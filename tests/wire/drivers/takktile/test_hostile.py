"""What no client of the emulated board may do to another."""

import socket

import pytest

from drivers.takktile.emulator import hop
from drivers.takktile.emulator.hop import HopReply, HopRequest, Op
from tests.wire.cases import case


def dial(bench):
    host, port = bench.server.url.removeprefix("tcp://").split(":")
    return socket.create_connection((host, int(port)), timeout=10)


def ask(connection, request):
    hop.send(connection, request)
    return hop.receive(connection, HopReply)


LIST = HopRequest(Op.LIST)


def test_more_connections_than_there_are_places_are_closed(bench) -> None:
    held = [dial(bench) for _ in range(33)]
    try:
        with pytest.raises(OSError):
            ask(held[-1], LIST)
        assert ask(held[0], LIST).errno == 0
    finally:
        for one in held:
            one.close()


def test_who_is_silent_for_longest_makes_room(bench, monkeypatch) -> None:
    monkeypatch.setattr("drivers.fairness.IDLE_S", 0.0)
    held = [dial(bench) for _ in range(32)]
    try:
        for one in held[1:]:
            assert ask(one, LIST).errno == 0
        newcomer = dial(bench)
        assert ask(newcomer, LIST).errno == 0
        newcomer.close()
        assert held[0].recv(1) == b""
        assert ask(held[1], LIST).errno == 0
    finally:
        for one in held:
            one.close()


def test_what_is_no_request_ends_its_connection_alone(bench, device) -> None:
    for message in [
        hop.encode((Op.BULK_READ, 1, 0x81, 0, 0, 0, -5, 0)),
        hop.encode((Op.CONTROL, 1, 0xC0, 0, 0, 0, 1 << 40, 0)),
        hop.encode((Op.LIST, 1 << 63)),
        hop.encode((99,)),
        b"\xff" * 40,
        b"\x91" * 4000,
    ]:
        with case(message):
            connection = dial(bench)
            connection.sendall(len(message).to_bytes(4) + message)
            assert connection.recv(1) == b""
            connection.close()
            assert device.ctrl_transfer(0xC0, 0x5C, 0, 0, 64)


def test_handle_of_another_is_not_guessed(bench, device) -> None:
    device.ctrl_transfer(0xC0, 0x5C, 0, 0, 64)  # opened
    stranger = dial(bench)
    for handle in range(1, 50):
        ask(stranger, HopRequest(Op.CLOSE, handle))
    stranger.close()
    assert device.ctrl_transfer(0xC0, 0x5C, 0, 0, 64)
