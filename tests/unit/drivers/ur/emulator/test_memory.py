"""What one client can make an emulated arm keep: the parts of the budget in docs/emulators.md."""

import gc
import struct
import tracemalloc
from collections.abc import Callable

import pytest

from drivers.ur.emulator.rtde import RtdeConnection, RtdeServer
from drivers.ur.emulator.rtde_wire import PacketType, packet
from drivers.ur.emulator.settings import PROFILES
from drivers.ur.emulator.sockets import LineTalk, ScriptTalk
from drivers.ur.emulator.urscript.parse import MAX_CHARS


def kept_mb(make: Callable[[], object]) -> float:
    gc.collect()
    tracemalloc.start()
    try:
        made = make()
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert made is not None
    return most / 1e6


def fed(talk: ScriptTalk | LineTalk, data: bytes) -> object:
    for at in range(0, len(data), 1000):
        talk.feed(data[at : at + 1000])
        assert not talk.broken
    return talk


@pytest.mark.parametrize("line", ["a\n", "\n", "é\n", "\U0001f600\n", "x" * 100_000 + "\n"])
def test_program_that_is_not_at_its_end_is_kept_as_it_came(line: str) -> None:
    loaded: list[str] = []
    data = b"def f():\n" + line.encode() * ((MAX_CHARS - 2000) // len(line.encode()))
    assert kept_mb(lambda: fed(ScriptTalk(loaded.append), data)) < 1.0
    assert not loaded


def test_program_with_letters_of_several_bytes_is_put_together_again() -> None:
    loaded: list[str] = []
    data = 'def f():\n textmsg("äöü")\nend\n'.encode()
    talk = ScriptTalk(loaded.append)
    for at in range(len(data)):
        talk.feed(data[at : at + 1])
    assert loaded == [data.decode()]


def test_client_of_rtde_keeps_little() -> None:
    names = [b"input_double_register_%d" % (n % 48) for n in range(1000)]
    asked = packet(PacketType.INPUTS, b",".join(names)) * 300
    outputs = ",".join((sorted(PROFILES["cb3"].output_types) * 3)[:1000]).encode()
    asked += packet(PacketType.OUTPUTS, struct.pack(">d", 125.0) + outputs)

    def client() -> object:
        one = RtdeConnection(RtdeServer(PROFILES["cb3"]))
        for at in range(0, len(asked), 1000):
            one.feed(asked[at : at + 1000])
        return one

    assert kept_mb(client) < 2.0
