"""The soak test (`make test-soak MINUTES=60`), and its verdict on made-up hours."""

import os
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tests.nightly.soak.soak import After, Count, Lift, Soak, soak
from tests.nightly.soak.verdict import wrong

MINUTES = float(os.environ.get("MINUTES", "3"))
DOWN, GRIPPED = After(0.0, 0.0, 0.0, True, 0.0, 0.0), After(0.0, 0.0, 9.8, False, 0.06, 0.0)
ALONE = (
    "the hand cannot be told anything and holds by itself: when last heard it was closed to the "
    "limit of 10 N, 9.5 N measured at finger A"
)
HELD = Lift(1, "can", "", "", "held", "", "", "", "", 1_000, 2, 10.2, 0.0, 0.001, 0.0, DOWN)
STRUCK = replace(
    HELD, struck="gripper_disconnect", device="gripper", outcome="fault", kind="link_lost",
    message="gripper: connection closed", arm="the arm stands", hand=ALONE, after=GRIPPED,
)  # fmt: skip
COUNTS = [Count(14.0 * n, 200.0, 24, 5, 5, 470.0) for n in range(257)]
HOUR = Soak(60.0, [STRUCK if n % 4 == 1 else HELD for n in range(257)], COUNTS)


@pytest.mark.timeout(900 + 90 * MINUTES)
def test_lifts_go_on_and_nothing_grows_or_goes_wrong(tmp_path: Path) -> None:
    found = wrong(soak(MINUTES, tmp_path))
    assert not found, "\n".join(found)


def test_an_hour_without_trouble_is_not_blamed() -> None:
    assert wrong(HOUR) == []


@pytest.mark.parametrize(
    ("made", "changes", "expected"),
    [
        (HELD, {"let_go_m": 0.05}, "let go at 50 mm"),
        (STRUCK, {"let_go_m": 0.05, "struck": "gripper_drop"}, "let go at 50 mm"),
        (HELD, {"slid_m": 0.02}, "slid 20 mm"),
        (HELD, {"after": replace(DOWN, arm_mps=0.01)}, "the arm moves after the end"),
        (HELD, {"after": replace(DOWN, fingers_mps=0.01)}, "the fingers move after the end"),
        (HELD, {"peak_n": 11.4}, "a true force of 11.4 N"),
        (HELD, {"outcome": "dropped"}, "dropped"),
        (HELD, {"outcome": ""}, "no verdict"),
        (HELD, {"after": None}, "not observed"),
        (STRUCK, {"message": "the run did not end in time"}, "time-out"),
        (STRUCK, {"struck": "", "device": ""}, "failed by itself"),
        (STRUCK, {"message": "the arm is silent"}, "nothing is wrong with the arm"),
        (STRUCK, {"hand": "the hand is open"}, "the hand is not open"),
        (STRUCK, {"arm": ""}, "no word of the arm"),
    ],
)
def test_what_must_not_be_in_a_lift_is_found(
    made: Lift, changes: dict[str, Any], expected: str
) -> None:
    told = wrong(replace(HOUR, lifts=[*HOUR.lifts, replace(made, **changes)]))
    assert expected in "; ".join(told)


def test_growth_and_too_little_to_judge_by_are_found() -> None:
    def counted(**each: float) -> list[Count]:
        return [
            replace(c, **{name: getattr(c, name) + rate * c.t_s / 3600.0
                          for name, rate in each.items()})
            for c in COUNTS
        ]  # fmt: skip

    for name, rate in (("resident_mb", 5.0), ("children_mb", 5.0), ("descriptors", 1.0)):
        assert name in "; ".join(wrong(replace(HOUR, counts=counted(**{name: rate}))))
    assert not wrong(replace(HOUR, counts=counted(resident_mb=3.0)))
    assert "3 lifts" in "; ".join(wrong(replace(HOUR, lifts=HOUR.lifts[:3])))
    assert "struck" in "; ".join(wrong(replace(HOUR, lifts=[HELD] * 257)))
    assert "missed" in "; ".join(wrong(replace(HOUR, lifts=[replace(HELD, missed=90)] * 257)))
