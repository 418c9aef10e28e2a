"""What RTDE tells its clients of a cycle, without a wire."""

import struct
import weakref

import pytest

from drivers.ur.emulator.rtde import RtdeConnection, RtdeServer, Told
from drivers.ur.emulator.rtde_wire import Cells, PacketType, Recipe, packet
from drivers.ur.emulator.settings import PROFILES

VALUES = {"timestamp": (1.5,), "actual_q": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), "robot_mode": (7,)}


def client(server: RtdeServer, names: str) -> RtdeConnection:
    one = RtdeConnection(server)
    assert one.feed(packet(PacketType.OUTPUTS, struct.pack(">d", 125.0) + names.encode()))[3] == 1
    one.feed(packet(PacketType.START))
    return one


def test_those_who_ask_for_the_same_are_told_from_one_packing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those who ask for something else, or for the same in another order, are told that."""
    server = RtdeServer(PROFILES["cb3"])
    packed: list[Recipe] = []
    pack = Recipe.pack

    def counted(recipe: Recipe, cells: Cells) -> bytes:
        packed.append(recipe)
        return pack(recipe, cells)

    monkeypatch.setattr(Recipe, "pack", counted)
    asked = ["timestamp,actual_q", "timestamp,actual_q", "actual_q,timestamp", "robot_mode"]
    clients, cycle = [client(server, names) for names in asked], Told(VALUES, server.profile)
    told = [one.sample(1, cycle) for one in clients]
    time, joints = struct.pack(">d", 1.5), struct.pack(">6d", *VALUES["actual_q"])
    header = lambda body: struct.pack(">HBB", 4 + len(body), PacketType.DATA, 1) + body  # noqa: E731
    assert told[0] == told[1] == header(time + joints)
    assert told[2] == header(joints + time)
    assert told[3] == header(struct.pack(">i", 7))
    assert len(packed) == 3


def test_recipe_of_clients_who_have_gone_is_kept_no_longer() -> None:
    server = RtdeServer(PROFILES["cb3"])
    one = client(server, "timestamp")
    kept = weakref.ref(server.outputs(["timestamp"]))
    assert kept() is server.outputs(["timestamp"])
    one.feed(packet(PacketType.OUTPUTS, struct.pack(">d", 125.0) + b"actual_q"))
    assert kept() is None
