"""What commands are in a person's words."""

import pytest

from grasp.commands import (
    BeginRest,
    CloseFast,
    Command,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
    describe,
)

SIDES = (True, False, True)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (MoveFingers((1, 2, 3), 0.05, 7.5),
         "fingers to (1, 2, 3) counts at 50 mm/s, at most 7.5 N"),
        (CloseFast(9.0, SIDES, (4, 5, 6), 0.03), "close AC at 30 mm/s, at most 9 N"),
        (CloseFast(9.0, SIDES, (4, 5, 6), 0.03, more=True),
         "close AC to (4, 5, 6) counts at 30 mm/s, at most 9 N"),
        (OpenFingers(0.11), "open all fingers"),
        (HoldFingers(), "hold all fingers"),
        (BeginRest(), "take rest counts"),
        (MoveArm((0.1, 0.2, 0.3004), 0.04, 0.6), "arm to (0.100, 0.200, 0.300) m at 40 mm/s"),
        (StopArm(2.0), "stop the arm"),
    ],
)  # fmt: skip
def test_each_command_says_what_it_asks_for(command: Command, words: str) -> None:
    assert describe(command) == words
