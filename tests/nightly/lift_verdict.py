"""What of a lift on the emulated cell was not as it must be, by what an onlooker saw of it."""

import re

import msgspec

from grasp.monitors.checks import STOOD_STILL
from scenarios.lift.lift import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftOutcome, LiftResult
from scenarios.rigs.rig import calibration
from scenarios.trial.result import FinishedRun
from tests.nightly.last_line import (
    CANNOT_COMMAND,
    MOST_N,
    SLID_M,
    STILL_MPS,
    TIMED_OUT,
    Known,
    blames_another,
    misled,
)
from tests.nightly.onlooker import LOOK_S, MOMENT_S, Left

NOT_OPENED = "not opened"
AWAY_S = 0.2  # between two looks of 50 ms: machine or cell stalled
LEAST_LOOKS = round(MOMENT_S / LOOK_S / 3)
NEVER = frozenset({
    "", LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE, LiftOutcome.INTERRUPTED,
    LiftOutcome.INTERNAL_ERROR,
})  # fmt: skip
# says that this computer stalled, whichever device it names
STALLED = r"clock stands still|program on the arm controller has ended"


class Ended(msgspec.Struct, frozen=True):
    """Result of one lift."""

    struck: frozenset[str]  # devices, by their names in ``last_line.BLAMED``
    takes_hand: bool  # the hand cannot be commanded
    left: Left
    outcome: str = NOT_OPENED
    message: str = ""
    arm: str = ""  # how it was left, by the last line
    hand: str = ""
    peak_n: float = 0.0  # true force
    force_byte: int = 0  # the highest that was sent to the hand

    def of(self, finished: FinishedRun[LiftResult]) -> "Ended":
        result, failure = finished.result, finished.failure
        assert result is not None
        peak_n = max((result.peak_force_n or {"": 0.0}).values())
        end = None if failure is None else failure.end
        return msgspec.structs.replace(
            self, outcome=result.outcome, message="" if failure is None else failure.message,
            arm="" if end is None else end.arm, hand="" if end is None else end.hand,
            peak_n=max(peak_n, self.left.peak_n),
        )  # fmt: skip


def problems(ended: Ended, settings: LiftConfig) -> list[str]:
    """What was not as it must be."""
    cap, left = calibration(settings).byte_at_most(settings.guard.force_limit_n), ended.left
    opened, held = ended.outcome != NOT_OPENED, ended.outcome in SUCCESSES
    lost = dropped(left)
    # only a closing could have held it, and the last line says so
    excused = ended.takes_hand and re.search(CANNOT_COMMAND, ended.hand) is not None
    checks = {
        f"force byte {ended.force_byte} of {cap}": ended.force_byte > cap,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"the arm moves at {left.arm_mps:.4f} m/s after the end": left.arm_mps > STILL_MPS,
        f"fingers move at {left.fingers_mps:.4f} m/s after the end": left.fingers_mps > STILL_MPS,
        f"the object: {lost}": bool(lost) and not excused,
        f"only {left.looks_later} looks after the end": (opened or bool(left.looks))
        and left.looks_later < LEAST_LOOKS,
        f"outcome {ended.outcome!r}: {ended.message}": ended.outcome in NEVER,
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
    wrong = ended.struck | ({"loop"} if left.gap_s > AWAY_S else set())
    return Known(wrong=wrong, pressed_n=left.pressed_n, opened=left.opened)


def dropped(left: Left) -> str:
    """Whether the hand lost an object in the air."""
    if left.let_go_m:
        return f"let go at {left.let_go_m * 1e3:.0f} mm"
    if left.slid_m > SLID_M:
        return f"slid {left.slid_m * 1e3:.0f} mm in the air"
    return left.object if left.object in ("slips", "falls") else ""
