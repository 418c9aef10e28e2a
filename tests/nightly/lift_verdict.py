"""Problems of a lift on the emulated cell, found by an independent observer of the cell."""

import re

import msgspec

from grasp.control.monitors.checks import STOOD_STILL
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftOutcome, LiftResult
from scenarios.rigs.calibration import calibration
from scenarios.trial.result import JudgedTrial
from tests.nightly.cell_observer import LOOK_S, MOMENT_S, Aftermath
from tests.nightly.last_line import (
    CANNOT_COMMAND,
    MOST_N,
    SLID_M,
    STILL_MPS,
    TIMED_OUT,
    Known,
    false_statements,
    wrong_cause,
)

NOT_STARTED = "not opened"
STALL_S = 0.2  # between two observations of 50 ms: machine or cell stalled
LEAST_LOOKS = round(MOMENT_S / LOOK_S / 3)
NEVER = frozenset({
    "", LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE, LiftOutcome.INTERRUPTED,
    LiftOutcome.INTERNAL_ERROR,
})  # fmt: skip
# messages of a stall of this computer, whichever device they name
STALLED = r"clock stands still|program on the arm controller has ended"


class ObservedLift(msgspec.Struct, frozen=True):
    """Result of one lift."""

    faulty: frozenset[str]  # devices, by their names in ``last_line.DEVICE_WORDS``
    takes_hand: bool  # the hand cannot be commanded
    left: Aftermath
    outcome: str = NOT_STARTED
    message: str = ""
    arm: str = ""  # how it was left, by the last line
    hand: str = ""
    peak_n: float = 0.0  # true force
    force_byte: int = 0  # the highest that was sent to the hand

    def of(self, finished: JudgedTrial[LiftResult]) -> "ObservedLift":
        result, failure = finished.result, finished.failure
        assert result is not None
        peak_n = max((result.peak_force_n or {"": 0.0}).values())
        end = None if failure is None else failure.end
        return msgspec.structs.replace(
            self, outcome=result.outcome, message="" if failure is None else failure.message,
            arm="" if end is None else end.arm, hand="" if end is None else end.hand,
            peak_n=max(peak_n, self.left.peak_n),
        )  # fmt: skip


def problems(ended: ObservedLift, settings: LiftConfig) -> list[str]:
    """All problems, as text."""
    cap, left = calibration(settings).byte_at_most(settings.guard.force_limit_n), ended.left
    opened, held = ended.outcome != NOT_STARTED, ended.outcome in SUCCESSES
    lost = dropped(left)
    # a hand that cannot be commanded could not be closed, and the last line says so
    accepted = ended.takes_hand and re.search(CANNOT_COMMAND, ended.hand) is not None
    checks = {
        f"force byte {ended.force_byte} of {cap}": ended.force_byte > cap,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"the arm moves at {left.arm_mps:.4f} m/s after the end": left.arm_mps > STILL_MPS,
        f"fingers move at {left.fingers_mps:.4f} m/s after the end": left.fingers_mps > STILL_MPS,
        f"the object: {lost}": bool(lost) and not accepted,
        f"only {left.looks_later} looks after the end": (opened or bool(left.looks))
        and left.looks_later < LEAST_LOOKS,
        f"outcome {ended.outcome!r}: {ended.message}": ended.outcome in NEVER,
        f"{ended.outcome}, then {left.object}": held and left.object != "on the table",
        f"{ended.outcome}, and failed: {ended.message}": held and bool(ended.message),
        "no message": not opened and not ended.message,
        f"ended by a time-out: {ended.message}": re.search(TIMED_OUT, ended.message) is not None,
    }  # fmt: skip
    found = [text for text, is_wrong in checks.items() if is_wrong]
    if ended.outcome == LiftOutcome.FAULT:
        found += false_statements(cause(ended), ended.arm, ended.hand, known(ended))
    elif not opened and ended.message:
        found += filter(None, [wrong_cause(cause(ended), known(ended).wrong)])
    return found


def cause(ended: ObservedLift) -> str:
    """The message with the devices' common names; a message of a stall counts as lateness where the
    observer stalled too."""
    message = re.sub(r"\b(ur_rtde|RTDE)\b", "arm", ended.message)
    message = message.replace("TakkTile board", "tactile board")
    stalled = "loop" in known(ended).wrong and re.search(STALLED, message) is not None
    return f"{STOOD_STILL}: {message}" if stalled else message


def known(ended: ObservedLift) -> Known:
    left = ended.left
    wrong = ended.faulty | ({"loop"} if left.gap_s > STALL_S else set())
    return Known(wrong=wrong, pressed_n=left.pressed_n, opened=left.opened)


def dropped(left: Aftermath) -> str:
    """How the hand lost an object in the air; empty if it did not."""
    if left.lost_at_m:
        return f"lost at {left.lost_at_m * 1e3:.0f} mm"
    if left.slid_m > SLID_M:
        return f"slid {left.slid_m * 1e3:.0f} mm in the air"
    return left.object if left.object in ("slips", "falls") else ""
