"""What of a lift over spoilt wires was not as it must be."""

import math
import re

import msgspec

from grasp.doubt import STOOD_STILL
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.rigs.cell_process import READY_S
from scenarios.rigs.rig import ACTIVATION_TIMEOUT_S, calibration
from tests.nightly.chaos.onlooker import LOOK_S, MOMENT_S, Left
from tests.nightly.chaos.proxy import WIRES, Passed, Plan, Trouble
from tests.nightly.last_line import (
    MOST_N,
    SLID_M,
    STILL_MPS,
    TIMED_OUT,
    Known,
    blames_another,
    misled,
)

NOT_OPENED = "not opened"
SLACK_S = 2.0
AWAY_S = 0.2  # between two looks of 50 ms: machine or cell stalled
LEAST_LOOKS = round(MOMENT_S / LOOK_S / 3)
NEVER = frozenset({
    "", LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE, LiftOutcome.INTERRUPTED,
    LiftOutcome.INTERNAL_ERROR,
})  # fmt: skip
# says that this computer stalled, whichever device it names
STALLED = r"worker process says nothing|for \d+\.\d\d s this computer did not keep it alive in time"
FRAME_BYTES = 30  # of a request to the hand, or its answer


class Ended(msgspec.Struct, frozen=True):
    """Result of one lift."""

    plan: Plan
    outcome: str
    message: str
    arm: str  # how it was left, by the last line
    hand: str
    seconds: float
    peak_n: float
    left: Left
    passed: Passed


def stated_s(settings: LiftConfig) -> float:
    """The longest run by its time-outs, each once: to open, run, stop and close."""
    ur, loop = settings.ur, settings.loop
    opening_s = READY_S + ACTIVATION_TIMEOUT_S + 3 * ur.step_timeout_s + ur.start_timeout_s
    closing_s = ur.leave_timeout_s + ur.command_timeout_s
    return opening_s + loop.deadline_s + loop.stop_s + closing_s + SLACK_S


def problems(ended: Ended, settings: LiftConfig) -> list[str]:
    """What was not as it must be."""
    cap, left = calibration(settings).byte_at_most(settings.guard.force_limit_n), ended.left
    opened, held = ended.outcome != NOT_OPENED, ended.outcome in SUCCESSES
    lost = dropped(left)
    checks = {
        f"force byte {ended.passed.most_force} of {cap}": ended.passed.most_force > cap,
        "no command to the hand passed": held and not ended.passed.writes,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"{ended.seconds:.1f} s": ended.seconds > stated_s(settings),
        f"the arm moves at {left.arm_mps:.4f} m/s after the end": left.arm_mps > STILL_MPS,
        f"fingers move at {left.fingers_mps:.4f} m/s after the end": left.fingers_mps > STILL_MPS,
        f"the object: {lost}": bool(lost) and not could_not_be_held(ended, settings),
        f"only {left.looks_later} looks after the end": (opened or bool(left.looks))
        and left.looks_later < LEAST_LOOKS,
        f"outcome {ended.outcome!r}": ended.outcome in NEVER,
        f"{ended.outcome}, then {left.object}": held and left.object != "on the table",
        f"{ended.outcome}, and failed: {ended.message}": held and bool(ended.message),
        "no word": not opened and not ended.message,
        f"ended by a time-out: {ended.message}": re.search(TIMED_OUT, ended.message) is not None,
    }  # fmt: skip
    found = [text for text, is_wrong in checks.items() if is_wrong]
    if ended.outcome == LiftOutcome.FAULT:
        found += misled(cause(ended), ended.arm, ended.hand, known(ended))
    elif not opened and ended.message:
        found += filter(None, [blames_another(cause(ended), known(ended).wrong)])
    return found


def cause(ended: Ended) -> str:
    """The message with the devices' common names; one that blames a stall of this computer counts
    as lateness where the onlooker was kept waiting too."""
    told = re.sub(r"\b(ur_rtde|RTDE)\b", "arm", ended.message)
    told = told.replace("TakkTile board", "tactile board")
    away = "loop" in known(ended).wrong and re.search(STALLED, told) is not None
    return f"{STOOD_STILL}: {told}" if away else told


def known(ended: Ended) -> Known:
    left = ended.left
    struck = {WIRES[trouble.wire] for trouble in ended.plan.troubles}
    return Known(
        wrong=frozenset(struck | ({"loop"} if left.gap_s > AWAY_S else set())),
        pressed_n=left.pressed_n, opened=left.opened,
    )  # fmt: skip


def dropped(left: Left) -> str:
    """Whether the hand lost an object in the air."""
    if left.let_go_m:
        return f"let go at {left.let_go_m * 1e3:.0f} mm"
    if left.slid_m > SLID_M:
        return f"slid {left.slid_m * 1e3:.0f} mm in the air"
    return left.object if left.object in ("slips", "falls") else ""


def could_not_be_held(ended: Ended, settings: LiftConfig) -> bool:
    """The hand could not be commanded to close, and the last line says so."""
    taken = any(takes_the_hand(t, settings.modbus.timeout_s) for t in ended.plan.troubles)
    return taken and "cannot be told anything" in ended.hand


def takes_the_hand(trouble: Trouble, timeout_s: float) -> bool:
    """Whether its wire is cut, garbles frames, or delays an answer beyond the time-out."""
    pieces = math.ceil(FRAME_BYTES / trouble.slice_bytes) if trouble.slice_bytes else 1
    broken = trouble.reset_share > 0.0 or trouble.twice_share > 0.0
    late = 2.0 * pieces * trouble.latency_s >= timeout_s
    return trouble.wire == "gripper" and (broken or late)
