"""The verdict on lifts on the emulated cell finds every problem, and no others."""

from typing import Any

import msgspec

from scenarios.campaign.config import load_config
from scenarios.world.truth import Truth
from tests.nightly.cell_observer import Aftermath, Snapshot, aftermath
from tests.nightly.lift_verdict import ObservedLift, problems

SETTINGS = load_config("can", "emulated").for_lift()


def snapshot_at(
    height_m: float, touched: bool, slip_m: float = 0.0, arm_mps: float = 0.0
) -> Snapshot:
    force_n = (9.8, 5.0, 5.0) if touched else (0.0, 0.0, 0.0)
    truth = Truth(
        t_ns=0, height_m=height_m, speed_mps=0.0, slip_distance_m=slip_m, slip_speed_mps=0.0,
        normal_n=force_n, shear_n=(0.0, 0.0, 0.0), peak_n=force_n, slip_onset_s=None,
        force_rise_s=None, flank_slope=0.0,
    )  # fmt: skip
    return Snapshot(truth, arm_mps, 0.0, 0.05 if touched else 0.0)


def later(looks: list[Snapshot]) -> Aftermath:
    return aftermath(looks, len(looks) - 8)


HELD = [snapshot_at(0.0, True), snapshot_at(0.03, True), *[snapshot_at(0.06, True, 0.002)] * 8]
DROPPED = later([*HELD, snapshot_at(0.05, False), *[snapshot_at(0.0, False)] * 8])
CLOSED = "the hand is closed to the limit of 10 N, its force is not measured"
ALONE = (
    "the hand cannot be commanded and holds by itself: at its last status it was closed with its "
    "previous grip, at (60, 55, 55) counts, 2.0 N measured at finger A"
)
FINE = ObservedLift(frozenset({"fingertips"}), False, later(HELD), "fault",
             "stale: no fresh fingertip sample", "the arm is stationary", CLOSED, 10.1)  # fmt: skip
LOST = msgspec.structs.replace(
    FINE, faulty=frozenset({"gripper"}), takes_hand=True, left=DROPPED, hand=ALONE,
    message="stale: gripper status",
)  # fmt: skip


def test_problems_are_found_and_no_others() -> None:
    assert problems(FINE, SETTINGS) == problems(LOST, SETTINGS) == []
    moving = later([*HELD, snapshot_at(0.06, True, 0.002, arm_mps=0.01)])
    success = {"outcome": "held", "message": "", "arm": "", "hand": ""}
    cases: tuple[tuple[ObservedLift, dict[str, Any], str], ...] = (
        (FINE, {"force_byte": 1}, "force byte 1 of 0"),
        (FINE, {"peak_n": 11.4}, "11.4 N"),
        (FINE, {"left": moving}, "the arm moves at 0.0100 m/s"),
        (FINE, {"left": DROPPED}, "lost at 60 mm"),
        (LOST, {"hand": CLOSED}, "lost at 60 mm"),
        (LOST, {"takes_hand": False}, "lost at 60 mm"),
        (FINE, {"left": aftermath([*HELD, snapshot_at(0.03, True, 0.03)], 4)}, "slid 30 mm"),
        (FINE, {"left": aftermath(HELD, len(HELD) - 1)}, "1 looks after the end"),
        (FINE, success, "then held in the air"),
        (FINE, {"outcome": "dropped"}, "dropped"),
        (FINE, {"message": "the arm is silent"}, "nothing is wrong with the arm"),
        (FINE, {"faulty": frozenset()}, "nothing is wrong with the fingertips"),
        (FINE, {"message": "phase grasp.tare lasted longer than 30 s"}, "time-out"),
        (FINE, {"hand": "the hand is open"}, "the hand is not open"),
    )
    for made, changes, expected in cases:
        assert expected in "; ".join(problems(msgspec.structs.replace(made, **changes), SETTINGS))
