"""What of a plan's lift was not as it must be."""

import math
import re

import msgspec

from grasp.doubt import STOOD_STILL
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.rigs.rig import calibration
from scenarios.studies.faults.last_line import (
    FELT_N,
    STILL_MPS,
    TIMED_OUT,
    Known,
    blames_another,
    misled,
)
from scenarios.studies.faults.verdict import MOST_N, SAID, SLID_M
from tests.wire.scenarios.chaos.one_lift import NOT_OPENED, Ended, stated_s
from tests.wire.scenarios.chaos.onlooker import LOOK_S, MOMENT_S, NEVER_THERE, Left
from tests.wire.scenarios.chaos.plans import Trouble, drawn

GONE_S = 10.0  # for the interpreter to end, on a busy machine too
AWAY_S = 0.2  # that an onlooker who looks every 50 ms was kept waiting: machine or cell stood still
LEAST_LOOKS = round(MOMENT_S / LOOK_S / 3)  # in the moment long after the end
KINDS = {"", "link_lost", "device_fault", "stale", "doubted", "safety_stop", "refused"}
NEVER = frozenset({
    "", LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE, LiftOutcome.INTERRUPTED,
    LiftOutcome.INTERNAL_ERROR,
})  # fmt: skip
# what says that this computer was not there, whichever device it speaks of
NOT_RUN = r"worker process says nothing|for \d+\.\d\d s this computer did not keep it alive in time"
UNHEARD = "cannot be told anything"  # of the hand
FRAME_BYTES = 30  # of a question to the hand, or its answer
DEVICES = {"gripper": "gripper", "tactile": "fingertips", "arm": "arm"}  # at the end of each wire


def judged(
    number: int, code: int, said: str, complaint: str, now_s: float, settings: LiftConfig
) -> tuple[Ended | None, str]:
    """What a process left that has ended: what came of its lift, and what of it was not as it must
    be."""
    if code or "Traceback" in complaint:
        return None, f"{drawn(number)}: {code}: {complaint[-2000:]}"
    ended = msgspec.json.decode(said.splitlines()[-1], type=Ended)
    found = problems(ended, settings)
    if now_s - ended.told_s > GONE_S:
        found.append(f"its process ended {now_s - ended.told_s:.1f} s later")
    return ended, f"{drawn(number)}: {'; '.join(found)}" if found else ""


def problems(ended: Ended, settings: LiftConfig) -> list[str]:
    """What was not as it must be."""
    cap, left = calibration(settings).byte_at_most(settings.guard.force_limit_n), ended.left
    most_s, opened = stated_s(settings), ended.outcome != NOT_OPENED
    held, high_m = ended.outcome in SUCCESSES, settings.controller.lift_height_m / 2
    pressed = ended.peak_n > FELT_N
    unseen = not left.looks and (opened or left.object != NEVER_THERE)
    blind = bool(left.looks) and left.looks_later < LEAST_LOOKS
    checks = {
        f"force byte {ended.passed.most_force} of {cap}": ended.passed.most_force > cap,
        "no command to the hand was seen": (held or pressed) and not ended.passed.writes,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"{ended.seconds:.1f} s": ended.seconds > most_s,
        f"waited too long: {', '.join(map(str, ended.overdue))}": bool(ended.overdue),
        f"the arm moves at {left.arm_mps:.4f} m/s after the end": left.arm_mps > STILL_MPS,
        f"fingers move at {left.fingers_mps:.4f} m/s after the end": left.fingers_mps > STILL_MPS,
        f"the object: {dropped(left)}; told {ended.message}; {ended.arm}; {ended.hand}":
            bool(dropped(left)) and not could_not_be_held(ended, settings),
        f"{left.object}, in {left.looks} looks, {left.looks_later} after the end": unseen or blind,
        f"kind {ended.kind}: {ended.message}": ended.kind not in KINDS,
        f"outcome {ended.outcome!r}": ended.outcome in NEVER,
        f"{ended.outcome}, and was lifted {left.lifted_m * 1e3:.0f} mm, then {left.object}": held
        and (left.lifted_m < high_m or left.object != "on the table"),
        f"{ended.outcome}, and failed: {ended.kind}: {ended.message}": held
        and bool(ended.kind or ended.message),
        "no word": not opened and not ended.message,
        f"ended by a time-out: {ended.message}": re.search(TIMED_OUT, ended.message) is not None,
    }  # fmt: skip
    found = [text for text, is_wrong in checks.items() if is_wrong]
    if ended.outcome == LiftOutcome.FAULT:
        found += misled(cause(ended), ended.arm, ended.hand, known(ended))
        found += [f"no such {name}: {said!r}" for name, said in
                  (("arm", ended.arm), ("hand", ended.hand))
                  if said and re.fullmatch(SAID[name], said) is None]  # fmt: skip
    elif not opened and ended.message:
        found += filter(None, [blames_another(cause(ended), known(ended).wrong)])
    return found


def cause(ended: Ended) -> str:
    """As it is told, by the devices' common names: ur_rtde speaks of itself, and a board that is
    not there is asked for by its maker. That this computer was not there is so, and blames no
    device, where the onlooker was kept waiting too."""
    told = re.sub(r"\b(ur_rtde|RTDE)\b", "arm", ended.message)
    told = told.replace("TakkTile board", "tactile board")
    away = "loop" in known(ended).wrong and re.search(NOT_RUN, told) is not None
    return f"{STOOD_STILL}: {told}" if away else told


def known(ended: Ended) -> Known:
    """What the cell knows of it."""
    left = ended.left
    struck = {DEVICES[trouble.wire] for trouble in drawn(ended.number).troubles}
    return Known(
        wrong=frozenset(struck | ({"loop"} if left.gap_s > AWAY_S else set())),
        pressed_n=left.pressed_n, opened=left.opened,
    )  # fmt: skip


def dropped(left: Left) -> str:
    """An object that the hand had in the air is let go there, or slides down and out."""
    if left.let_go_m:
        return f"let go at {left.let_go_m * 1e3:.0f} mm"
    if left.slid_m > SLID_M:
        return f"slid {left.slid_m * 1e3:.0f} mm in the air"
    return left.object if left.object in ("slips", "falls") else ""


def could_not_be_held(ended: Ended, settings: LiftConfig) -> bool:
    """Only a closing could have held it, the hand could not be told, and the last line says so."""
    troubles = drawn(ended.number).troubles
    taken = any(takes_the_hand(trouble, settings.modbus.timeout_s) for trouble in troubles)
    return taken and UNHEARD in ended.hand


def takes_the_hand(trouble: Trouble, timeout_s: float) -> bool:
    """Whether its wire is cut, frames on it are none any more, or an answer takes too long."""
    pieces = math.ceil(FRAME_BYTES / trouble.slice_bytes) if trouble.slice_bytes else 1
    way_s = pieces * (trouble.latency_s + trouble.jitter_s)
    way_s += FRAME_BYTES / trouble.bytes_per_s if trouble.bytes_per_s else 0.0
    broken = trouble.reset_share > 0.0 or trouble.twice_share > 0.0
    return trouble.wire == "gripper" and (broken or 2.0 * way_s >= timeout_s)
