"""The soak test (`make test-soak MINUTES=60`), and its verdict on made-up lifts.

Nothing may grow, and there must have been enough lifts. In no lift may a true force pass limit and
overshoot, an object be lost in the air, or anything move after the end. A struck lift may end in a
fault whose last line is true; another only for lateness while the machine stalled.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from scenarios.lift.scoring import SUCCESSES, LiftOutcome
from tests.nightly.last_line import (
    CANNOT_COMMAND,
    LATE,
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
from tests.nightly.soak.lifts import NOT_OPENED, After, Count, Lift, soak

MINUTES = float(os.environ.get("MINUTES", "3"))
SETTLED_S = 600.0  # caches are filled by then
# a float that each tick leaves behind makes 11.5 MB an hour
MOST_GROWTH_MB_H, MOST_SPREAD_MB = 4.0, 12.0
LEAST_LIFTS_A_MINUTE, LEAST_STRUCK = 2.0, 0.1
NEVER = frozenset({
    "", NOT_OPENED, LiftOutcome.INTERNAL_ERROR, LiftOutcome.INTERRUPTED, LiftOutcome.DROPPED,
    LiftOutcome.EXPELLED, LiftOutcome.OVER_FORCE,
})  # fmt: skip
TAKE_THE_HAND = frozenset({"gripper_freeze", "gripper_disconnect", "gripper_fault"})


@pytest.mark.timeout(900 + 90 * MINUTES)
def test_lifts_go_on_and_nothing_grows_or_goes_wrong(tmp_path: Path) -> None:
    lifts, counts = soak(MINUTES, tmp_path)
    assert len(lifts) >= LEAST_LIFTS_A_MINUTE * MINUTES
    assert sum(bool(made.struck) for made in lifts) >= int(LEAST_STRUCK * len(lifts))
    assert growing(counts) == []
    assert [(made, found) for made in lifts if (found := wrong(made))] == []


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


def wrong(made: Lift) -> list[str]:
    """What may not be in one lift."""
    after, fault = made.after, made.outcome == LiftOutcome.FAULT
    cannot = fault and re.search(CANNOT_COMMAND, made.hand) is not None
    excused = made.struck in TAKE_THE_HAND and cannot  # only a closing could have held it
    slides = after is not None and after.height_m > LET_GO_M and after.slip_mps > SLIDES_MPS
    late = made.stalled and re.search(LATE, made.message) is not None
    checks = {
        f"let go at {made.let_go_m * 1e3:.0f} mm": made.let_go_m > LET_GO_M and not excused,
        f"slid {made.slid_m * 1e3:.0f} mm in the air": made.slid_m > SLID_M and not excused,
        "goes on sliding": slides and not excused,
        "the arm moves after the end": after is not None and after.arm_mps > STILL_MPS,
        "the fingers move after the end": after is not None and after.fingers_mps > STILL_MPS,
        f"{made.outcome or 'no verdict'}: {made.message}": made.outcome in NEVER,
        f"{made.outcome}, not observed": made.outcome in SUCCESSES
        and (made.peak_n is None or after is None),
        f"a true force of {made.peak_n} N": made.peak_n is not None and made.peak_n > MOST_N,
        f"ended by a time-out: {made.message}": re.search(TIMED_OUT, made.message) is not None,
        f"failed by itself: {made.message}": fault and not made.struck and not late,
    }  # fmt: skip
    found = [text for text, is_wrong in checks.items() if is_wrong]
    return [*found, *misled(made.message, made.arm, made.hand, known(made))] if fault else found


def known(made: Lift) -> Known:
    wrong = frozenset({made.device} - {""} | ({"loop"} if made.stalled else set()))
    if made.after is not None:
        return Known(wrong=wrong, pressed_n=made.after.pressed_n, opened=made.after.opened)
    untouched = made.peak_n is not None and made.peak_n <= TOUCH_N
    return Known(wrong=wrong, pressed_n=0.0 if untouched else None)


DOWN, GRIPPED = After(0.0, 0.0, 0.0, True, 0.0, 0.0), After(0.0, 0.0, 9.8, False, 0.06, 0.0)
ALONE = (
    "the hand cannot be told anything and holds by itself: when last heard it was closed to the "
    "limit of 10 N, 9.5 N measured at finger A"
)
HELD = Lift("can", "", "", "held", "", "", "", 10.2, 0.0, 0.001, False, DOWN)
STRUCK = Lift("can", "gripper_disconnect", "gripper", "fault", "gripper: connection closed",
              "the arm stands", ALONE, 10.2, 0.0, 0.001, False, GRIPPED)  # fmt: skip


def test_what_must_not_be_in_a_lift_is_found() -> None:
    assert wrong(HELD) == wrong(STRUCK) == []
    cases: tuple[tuple[Lift, dict[str, Any], str], ...] = (
        (HELD, {"let_go_m": 0.05}, "let go at 50 mm"),
        (STRUCK, {"let_go_m": 0.05, "struck": "gripper_garble"}, "let go at 50 mm"),
        (HELD, {"slid_m": 0.02}, "slid 20 mm"),
        (HELD, {"after": replace(DOWN, arm_mps=0.01)}, "the arm moves after the end"),
        (HELD, {"after": replace(DOWN, fingers_mps=0.01)}, "the fingers move after the end"),
        (HELD, {"peak_n": 11.4}, "a true force of 11.4 N"),
        (HELD, {"outcome": "dropped"}, "dropped"),
        (HELD, {"after": None}, "not observed"),
        (STRUCK, {"message": "the run did not end in time"}, "time-out"),
        (STRUCK, {"struck": "", "device": ""}, "failed by itself"),
        (STRUCK, {"hand": "the hand is open"}, "the hand is not open"),
    )
    for made, changes, expected in cases:
        assert expected in "; ".join(wrong(replace(made, **changes))), expected


def test_growth_is_found() -> None:
    flat = [Count(14.0 * n, 200.0, 24, 5, 5, 470.0) for n in range(257)]
    assert growing(flat) == []
    for name, rate in (("resident_mb", 5.0), ("children_mb", 5.0), ("descriptors", 1.0)):
        grown = [replace(c, **{name: getattr(c, name) + rate * c.t_s / 3600.0}) for c in flat]
        assert name in "; ".join(growing(grown))
