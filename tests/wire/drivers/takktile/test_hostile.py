"""What no client of the emulated board may do to another."""

import contextlib
import errno
import itertools
import socket
import time

import pytest
import usb.core
import usb.util

from drivers.takktile.emulator import hop
from drivers.takktile.emulator.hop import HopReply, HopRequest, Op


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


def test_a_crowd_that_never_spoke_leaves_all_places_behind(bench) -> None:
    for _ in range(2):
        held = [dial(bench) for _ in range(120)]
        for one in held:
            one.close()
    deadline = time.monotonic() + 20.0
    replies: list[int] = []
    while replies != [0] * 32:
        assert time.monotonic() < deadline, replies
        with contextlib.ExitStack() as stack:
            those = [stack.enter_context(dial(bench)) for _ in range(32)]
            replies = [ask(one, LIST).errno for one in those]


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


@pytest.mark.parametrize(
    "message",
    [
        hop.encode((Op.BULK_READ, 1, 0x81, 0, 0, 0, -5, 0)),
        hop.encode((Op.CONTROL, 1, 0xC0, 0, 0, 0, 1 << 40, 0)),
        hop.encode((Op.LIST, 1 << 63)),
        hop.encode((99,)),
        b"\xff" * 40,
        b"\x91" * 4000,
    ],
)
def test_what_is_no_request_ends_its_connection_alone(bench, device, message) -> None:
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


def test_handles_of_one_connection_are_bounded(bench) -> None:
    connection = dial(bench)
    replies = [ask(connection, HopRequest(Op.OPEN, index=1)).errno for _ in range(20)]
    connection.close()
    assert replies[0] == 0 and replies[-1] == errno.EMFILE


def test_flood_leaves_the_sampling_its_time(bench, device) -> None:
    """A stranger may have a part of the time, and no more."""
    device.set_configuration()
    device.ctrl_transfer(0xC0, 0xC7, 100, 1, 1)
    strangers = [dial(bench) for _ in range(4)]
    message = hop.encode(LIST)
    for one in strangers:
        one.setblocking(False)
    frames, started = 0, time.monotonic()
    for one in itertools.cycle(strangers):
        with contextlib.suppress(BlockingIOError):
            one.send((len(message).to_bytes(4) + message) * 20)
        with contextlib.suppress(BlockingIOError):
            one.recv(1 << 16)
        assert device.read(0x81, 512, 5000)
        frames += 1
        if time.monotonic() - started > 1.0:
            break
    for one in strangers:
        one.close()
    assert frames > 20
    usb.util.dispose_resources(device)
