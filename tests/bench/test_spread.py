"""What the benches of lifts and taps make of misses; nothing is measured here."""

from types import SimpleNamespace
from typing import Any

from tests.bench import test_detectors_in_lifts as detectors_in_lifts
from tests.bench import test_lift_table as lift_table
from tests.bench.spread import slipped, three


def lift(late_ms: float | None, onset_s: float | None = 1.0, slid_m: float = 0.002) -> Any:
    """What the benches read of a lift's result; ``late_ms`` None: nobody heard it."""
    return SimpleNamespace(
        success=late_ms is not None, outcome="held", slip_onset_s=onset_s, slip_distance_m=slid_m,
        detection_latency_ms=late_ms, reaction_latency_ms=late_ms, phases=[],
    )  # fmt: skip


EIGHT_OF_TEN = [*(lift(10.0 * k) for k in range(8)), lift(None), lift(None)]


def test_what_never_came_is_infinitely_late_and_not_left_out() -> None:
    assert three([1.0, 2.0, 3.0, None]) == "2 / inf / inf"
    assert three([0.04, 0.16], 1) == "0.0 / 0.2 / 0.2"
    assert three([]) == "-"


def test_a_lift_in_which_nothing_slid_is_no_miss() -> None:
    at_once, still = lift(0.0), lift(None, None)
    assert slipped([at_once, still]) == [at_once]


def test_the_tables_of_lifts_hold_their_misses_and_a_delay_of_nothing() -> None:
    still = lift(None, None)
    row = lift_table.row("can", [*EIGHT_OF_TEN, still])
    assert row == "| can | 8 of 11 | 40 / inf / inf | 2 / 2 / 2 |"
    row = detectors_in_lifts.row("can", "gru", 0.14, [*EIGHT_OF_TEN, still])
    assert row == "| can | gru | 140 | 11 held | 40 / inf / inf | 2.0 / 2.0 / 2.0 | 0 |"
