"""Plausibility of a status."""

import msgspec

from drivers.robotiq.protocol import AxisStatus, StatusRegisters, implausible_values

# open, and done: manual, 2014 p. 74
OPEN = StatusRegisters.from_bytes(bytes.fromhex("F9FF0000070000060000060000890000"))
replace = msgspec.structs.replace


def test_status_examples_of_the_manual_are_plausible() -> None:
    reset = StatusRegisters()
    moving = StatusRegisters.from_bytes(bytes.fromhex("39C000FF080F00081000080F00890000"))
    closed = StatusRegisters.from_bytes(bytes.fromhex("B9EA00FFBC0000C10000BD0000890000"))
    for status in (OPEN, reset, moving, closed):
        assert implausible_values(status, status) == []
    moved = replace(moving, a=replace(moving.a, position=60))
    assert implausible_values(moved, moving) == []
    for busy in (1, 2):  # activates, changes its mode
        started = replace(OPEN, go_to=False, initialization=busy, active=busy == 1 or OPEN.active)
        moved = replace(started, a=replace(started.a, position=60))
        assert implausible_values(moved, started) == []


def test_impossible_values_are_found() -> None:
    for status, text in [
        (replace(OPEN, active=False), "not activated and yet obeys"),
        (replace(OPEN, fault=0x03), "unknown fault"),
        (replace(OPEN, a=AxisStatus(0, 7, 255, 3)), "draws 2550 mA"),
        (replace(OPEN, b=AxisStatus(0, 255, 0, 3)), "beyond its mechanical end"),
        (replace(OPEN, c=AxisStatus(0, 60, 0, 3)), "is reported as stopped"),
    ]:
        found = implausible_values(status, OPEN)
        assert any(text in finding for finding in found), (status, text)
