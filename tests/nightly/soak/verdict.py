"""What of a soak test was not as it must be.

Nothing may grow, and there must have been enough lifts. In no lift may a true force pass limit and
overshoot, an object be lost in the air, or anything move after the end. A struck lift may end in a
fault whose last line is true; another only for lateness while the machine stalled.
"""

import re
from collections.abc import Sequence

import numpy as np

from grasp.doubt import STOOD_STILL
from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from scenarios.trial.execution import STALE
from tests.nightly.last_line import (
    CANNOT_COMMAND,
    LET_GO_M,
    MOST_N,
    SLID_M,
    SLIDES_MPS,
    STILL_MPS,
    TIMED_OUT,
    TOUCH_N,
    Known,
    misled,
)
from tests.nightly.soak.soak import NOT_OPENED, Count, Lift, Soak

SETTLED_S = 600.0  # caches are filled by then
# a float that each tick leaves behind makes 11.5 MB an hour
MOST_GROWTH_MB_H, MOST_SPREAD_MB = 4.0, 12.0
LEAST_LIFTS_A_MINUTE, LEAST_STRUCK = 2.0, 0.1
MOST_MISSED = 0.05  # of all periods, where the machine did not stall
LOST = frozenset({LiftOutcome.DROPPED, LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE})
NEVER = frozenset({"", NOT_OPENED, LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED})
TAKE_THE_HAND = frozenset({"gripper_freeze", "gripper_disconnect", "gripper_fault"})


def wrong(told: Soak) -> list[str]:
    """What may not be."""
    lifts, struck = len(told.lifts), sum(bool(made.struck) for made in told.lifts)
    found = growing(told.counts)
    if lifts < LEAST_LIFTS_A_MINUTE * told.minutes:
        found.append(f"{lifts} lifts in {told.minutes:g} minutes")
    if struck < int(LEAST_STRUCK * lifts):
        found.append(f"{struck} of {lifts} lifts were struck")
    calm = [made for made in told.lifts if not made.struck and not made.stall_s]
    periods, missed = sum(m.periods for m in calm), sum(m.missed for m in calm)
    if missed > MOST_MISSED * (periods + missed):
        found.append(f"missed {missed} periods, {periods} were kept")
    return found + [
        f"seed {made.seed}, {made.object}, {made.struck or 'not struck'}: {text}"
        for made in told.lifts for text in wrong_in(made)
    ]  # fmt: skip


def growing(counts: Sequence[Count]) -> list[str]:
    """What is not flat after ten minutes."""
    late = [c for c in counts if c.t_s > SETTLED_S]
    found = []
    for name in ("resident_mb", "children_mb", "descriptors", "threads", "children"):
        values = [float(getattr(c, name)) for c in late]
        if len(values) < 3:
            continue
        spread = max(values) - min(values)
        if not name.endswith("mb"):
            found += [f"{name}: {min(values):g} to {max(values):g}"] if spread else []
            continue
        slope = float(np.polyfit([c.t_s / 3600.0 for c in late], values, 1)[0])
        if slope > MOST_GROWTH_MB_H or spread > MOST_SPREAD_MB:
            found.append(f"{name} grows by {slope:.1f} MB an hour, spread {spread:.0f} MB")
    return found


def wrong_in(made: Lift) -> list[str]:
    """What may not be in one lift."""
    after, fault = made.after, made.outcome == LiftOutcome.FAULT
    cannot = fault and re.search(CANNOT_COMMAND, made.hand) is not None
    excused = made.struck in TAKE_THE_HAND and cannot  # only a closing could have held it
    slides = after is not None and after.height_m > LET_GO_M and after.slip_mps > SLIDES_MPS
    checks = {
        f"let go at {made.let_go_m * 1e3:.0f} mm": made.let_go_m > LET_GO_M and not excused,
        f"slid {made.slid_m * 1e3:.0f} mm in the air": made.slid_m > SLID_M and not excused,
        "goes on sliding": slides and not excused,
        "the arm moves after the end": after is not None and after.arm_mps > STILL_MPS,
        "the fingers move after the end": after is not None and after.fingers_mps > STILL_MPS,
        f"{made.outcome or 'no verdict'}: {made.message}": made.outcome in NEVER | LOST,
        f"{made.outcome}, not observed": made.outcome in SUCCESSES
        and (made.peak_n is None or after is None or not made.periods),
        f"a true force of {made.peak_n} N": made.peak_n is not None and made.peak_n > MOST_N,
        f"ended by a time-out: {made.message}": re.search(TIMED_OUT, made.message) is not None,
        f"failed by itself: {made.message}": fault and not made.struck and not late(made),
    }  # fmt: skip
    found = [text for text, is_wrong in checks.items() if is_wrong]
    return [*found, *misled(made.message, made.arm, made.hand, known(made))] if fault else found


def late(made: Lift) -> bool:
    """Whether it failed for lateness while the machine stalled."""
    said = made.kind in (STALE, "link_lost") or re.search(
        rf"{STOOD_STILL}|detector_late", made.message
    )
    return bool(said) and made.stall_s > 0.0


def known(made: Lift) -> Known:
    wrong = frozenset({made.device} - {""} | ({"loop"} if made.stall_s else set()))
    if made.after is not None:
        return Known(wrong=wrong, pressed_n=made.after.pressed_n, opened=made.after.opened)
    untouched = made.peak_n is not None and made.peak_n <= TOUCH_N
    return Known(wrong=wrong, pressed_n=0.0 if untouched else None)
