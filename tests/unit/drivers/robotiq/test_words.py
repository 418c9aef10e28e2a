"""Registers in words, and what no hand says."""

import msgspec

from drivers.robotiq.protocol import AxisStatus, StatusRegisters, doubts

# open, and done: manual, 2014 p. 74
OPEN = StatusRegisters.from_bytes(bytes.fromhex("F9FF0000070000060000060000890000"))
replace = msgspec.structs.replace


def test_hands_of_the_manual_are_not_doubted() -> None:
    reset = StatusRegisters()
    moving = StatusRegisters.from_bytes(bytes.fromhex("39C000FF080F00081000080F00890000"))
    closed = StatusRegisters.from_bytes(bytes.fromhex("B9EA00FFBC0000C10000BD0000890000"))
    for status in (OPEN, reset, moving, closed):
        assert doubts(status, status) == []
    further = replace(moving, a=replace(moving.a, position=60))
    assert doubts(further, moving) == []  # it moves
    for busy in (1, 2):  # activates, changes its mode
        started = replace(OPEN, go_to=False, initialization=busy, active=busy == 1 or OPEN.active)
        there = replace(started, a=replace(started.a, position=60))
        assert doubts(there, started) == []


def test_what_no_hand_says_is_doubted() -> None:
    for said, word in [
        (replace(OPEN, active=False), "not activated, and that it obeys"),
        (replace(OPEN, fault=0x03), "unknown fault"),
        (replace(OPEN, a=AxisStatus(0, 7, 255, 3)), "draws 2550 mA"),
        (replace(OPEN, b=AxisStatus(0, 255, 0, 3)), "beyond its mechanical end"),
        (replace(OPEN, c=AxisStatus(0, 60, 0, 3)), "is said to stand"),
    ]:
        assert any(word in doubt for doubt in doubts(said, OPEN)), (said, word)
