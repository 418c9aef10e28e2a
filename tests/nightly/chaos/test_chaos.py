"""Lifts over wires that delay, cut up, double and reset what passes: each ends in time, says why,
drops nothing that could be held, and sends no stronger command than it may.

`make test-chaos PLANS=200` makes more of them; FROM is the first plan's number.
"""

import os
import signal
import subprocess
import sys

import msgspec
import pytest

from scenarios.world.truth import Truth
from tests.nightly.chaos import one_lift
from tests.nightly.chaos.one_lift import Ended, config, stated_s
from tests.nightly.chaos.onlooker import Left, Look, left
from tests.nightly.chaos.plans import AMOUNTS, WIRES, Trouble, drawn
from tests.nightly.chaos.proxy import Commands, Passed
from tests.nightly.chaos.verdict import dropped, problems, takes_the_hand

PLANS, FROM = int(os.environ.get("PLANS", "20")), int(os.environ.get("FROM", "0"))
SETTINGS = config()
TIPS, GRIPPER = 8, 2  # plans: hardly any trouble of the fingertips; trouble of the hand's wire


@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(FROM, FROM + PLANS))
def test_lift_over_spoilt_wires_ends_in_time_and_says_why(number: int) -> None:
    command = [sys.executable, "-P", "-m", one_lift.__name__, str(number)]
    lifting = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        said, complaint = lifting.communicate(timeout=2 * stated_s(SETTINGS))
    except subprocess.TimeoutExpired:
        os.killpg(lifting.pid, signal.SIGKILL)  # with its cell and its proxy
        _, complaint = lifting.communicate()
        pytest.fail(f"{drawn(number)}: did not end: {complaint[-2000:]}")
    assert not lifting.returncode and "Traceback" not in complaint, complaint[-2000:]
    ended = msgspec.json.decode(said.splitlines()[-1], type=Ended)
    found = problems(ended, SETTINGS)
    assert not found, f"{drawn(number)}: {'; '.join(found)}: {ended}"


def looked(height_m: float, touched: bool, slip_m: float = 0.0, arm_mps: float = 0.0) -> Look:
    force_n = (9.8, 5.0, 5.0) if touched else (0.0, 0.0, 0.0)
    truth = Truth(
        t_ns=0, height_m=height_m, speed_mps=0.0, slip_distance_m=slip_m, slip_speed_mps=0.0,
        normal_n=force_n, shear_n=(0.0, 0.0, 0.0), peak_n=force_n, slip_onset_s=None,
        force_rise_s=None, flank_slope=0.0,
    )  # fmt: skip
    return Look(truth, arm_mps, 0.0, 0.05 if touched else 0.0)


HELD = [looked(0.0, True), looked(0.03, True), *[looked(0.06, True, 0.002)] * 8]
LET_GO = [*HELD, looked(0.05, False), *[looked(0.0, False)] * 8]
SET_DOWN = [*HELD, looked(0.0, True), *[looked(0.0, False)] * 8]
CLOSED = "the hand is closed to the limit of 10 N, its force is not measured"
ALONE = (
    "the hand cannot be told anything and holds by itself: when last heard it was closed with the "
    "grip that it had, at (60, 55, 55) counts, 2.0 N measured at finger A"
)


def later(looks: list[Look]) -> Left:
    return left(looks, len(looks) - 8)


def ended(**changed: object) -> Ended:
    """A lift that failed as it must, through a plan that spoils the fingertips' wire."""
    plain = Ended(TIPS, "fault", "stale", "stale: no fresh fingertip sample", "the arm stands",
                  CLOSED, 9.0, 10.1, later(HELD), Passed(writes=8))  # fmt: skip
    return msgspec.structs.replace(plain, **changed)


def test_the_verdict_finds_what_must_not_be_and_nothing_else() -> None:
    held = {"outcome": "held", "kind": "", "message": "", "arm": "", "hand": ""}
    success = ended(**held, left=later(SET_DOWN))
    lost = ended(number=GRIPPER, left=later(LET_GO), hand=ALONE, message="stale: gripper status")
    for fine in (ended(), success, lost):
        assert problems(fine, SETTINGS) == []
    moving = [*HELD, looked(0.06, True, 0.002, arm_mps=0.01)]
    for made, expected in (
        (ended(passed=Passed(writes=8, most_force=1)), "force byte 1 of 0"),
        (ended(peak_n=11.4), "11.4 N"),
        (ended(seconds=stated_s(SETTINGS) + 0.1), " s"),
        (ended(left=later(moving)), "the arm moves at 0.0100 m/s"),
        (ended(left=later(LET_GO)), "let go at 60 mm"),
        (msgspec.structs.replace(lost, hand=CLOSED), "let go at 60 mm"),
        (msgspec.structs.replace(lost, number=TIPS), "let go at 60 mm"),
        (ended(left=left(HELD, len(HELD) - 1)), "1 after the end"),
        (ended(**held, left=later(HELD)), "then held in the air"),
        (ended(outcome="", kind=""), "outcome ''"),
        (ended(message=""), "no word of the cause"),
        (ended(message="the arm is silent"), "nothing is wrong with the arm"),
        (ended(message="phase rest lasted longer than 30 s"), "time-out"),
        (ended(hand="the hand is open"), "the hand is not open"),
        (ended(hand="the hand is fine"), "no such hand"),
        (ended(hand=ALONE), "the hand was heard"),
    ):
        assert expected in "; ".join(problems(made, SETTINGS)), expected


def test_the_object_is_followed_and_a_wire_that_takes_the_hand_is_known() -> None:
    assert (dropped(later(HELD)), dropped(later(SET_DOWN))) == ("", "")
    assert "slid 30 mm" in dropped(left([*HELD, looked(0.03, True, 0.03)], 4))
    slow, quick = (Trouble("gripper", 0.0, 600.0, latency_s=s) for s in (0.2, 0.19))
    assert takes_the_hand(slow, 0.4) and not takes_the_hand(quick, 0.4)


def test_plans_spoil_every_wire_in_every_way() -> None:
    troubles = [trouble for number in range(200) for trouble in drawn(number).troubles]
    for kind in AMOUNTS:
        assert {t.wire for t in troubles if getattr(t, kind)} == set(WIRES)


def test_force_bytes_are_read_from_frames_however_they_are_cut() -> None:
    image = bytes([9, 0, 0, 60, 255, 150, 0, 0, 20, 0, 0, 0, 0, 0, 0, 0])
    pdu = bytes([16, 0, 0, 0, 8, 16]) + image
    frame = bytes([0, 1, 0, 0, 0, len(pdu) + 1, 2]) + pdu
    passed = Passed()
    commands = Commands(passed)
    for byte in frame + bytes([0, 2, 0, 0, 0, 9, 2, 16, 0, 2, 0, 1, 2, 0, 199]):  # rFRA alone
        commands.take(bytes([byte]))
    assert (passed.writes, passed.most_force) == (2, 199)
