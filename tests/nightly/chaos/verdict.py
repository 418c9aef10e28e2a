"""What of a lift over spoilt wires was not as it must be."""

import math
import re

from grasp.doubt import STOOD_STILL
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.rigs.rig import calibration
from tests.nightly.chaos.one_lift import NOT_OPENED, Ended, stated_s
from tests.nightly.chaos.onlooker import LOOK_S, MOMENT_S, Left
from tests.nightly.chaos.plans import WIRES, Trouble, drawn
from tests.nightly.last_line import (
    FELT_N,
    MOST_N,
    SLID_M,
    STILL_MPS,
    TIMED_OUT,
    Known,
    blames_another,
    misled,
)

AWAY_S = 0.2  # between two looks of 50 ms: machine or cell stalled
LEAST_LOOKS = round(MOMENT_S / LOOK_S / 3)
KINDS = {"", "link_lost", "device_fault", "stale", "doubted", "safety_stop", "refused"}
NEVER = frozenset({
    "", LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE, LiftOutcome.INTERRUPTED,
    LiftOutcome.INTERNAL_ERROR,
})  # fmt: skip
# says that this computer stalled, whichever device it names
STALLED = r"worker process says nothing|for \d+\.\d\d s this computer did not keep it alive in time"
FRAME_BYTES = 30  # of a request to the hand, or its answer


def problems(ended: Ended, settings: LiftConfig) -> list[str]:
    """What was not as it must be."""
    cap, left = calibration(settings).byte_at_most(settings.guard.force_limit_n), ended.left
    opened, held = ended.outcome != NOT_OPENED, ended.outcome in SUCCESSES
    lost = dropped(left)
    checks = {
        f"force byte {ended.passed.most_force} of {cap}": ended.passed.most_force > cap,
        "no command to the hand passed": (held or ended.peak_n > FELT_N)
        and not ended.passed.writes,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"{ended.seconds:.1f} s": ended.seconds > stated_s(settings),
        f"the arm moves at {left.arm_mps:.4f} m/s after the end": left.arm_mps > STILL_MPS,
        f"fingers move at {left.fingers_mps:.4f} m/s after the end": left.fingers_mps > STILL_MPS,
        f"the object: {lost}": bool(lost) and not could_not_be_held(ended, settings),
        f"only {left.looks} looks, {left.looks_later} after the end": (opened or bool(left.looks))
        and left.looks_later < LEAST_LOOKS,
        f"kind {ended.kind}: {ended.message}": ended.kind not in KINDS,
        f"outcome {ended.outcome!r}": ended.outcome in NEVER,
        f"{ended.outcome}, lifted {left.lifted_m * 1e3:.0f} mm, then {left.object}": held
        and (left.lifted_m < settings.controller.lift_height_m / 2
             or left.object != "on the table"),
        f"{ended.outcome}, and failed: {ended.message}": held and bool(ended.kind or ended.message),
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
    struck = {WIRES[trouble.wire] for trouble in drawn(ended.number).troubles}
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
    troubles = drawn(ended.number).troubles
    taken = any(takes_the_hand(trouble, settings.modbus.timeout_s) for trouble in troubles)
    return taken and "cannot be told anything" in ended.hand


def takes_the_hand(trouble: Trouble, timeout_s: float) -> bool:
    """Whether its wire is cut, garbles frames, or delays an answer beyond the time-out."""
    pieces = math.ceil(FRAME_BYTES / trouble.slice_bytes) if trouble.slice_bytes else 1
    way_s = pieces * (trouble.latency_s + trouble.jitter_s)
    way_s += FRAME_BYTES / trouble.bytes_per_s if trouble.bytes_per_s else 0.0
    broken = trouble.reset_share > 0.0 or trouble.twice_share > 0.0
    return trouble.wire == "gripper" and (broken or 2.0 * way_s >= timeout_s)
