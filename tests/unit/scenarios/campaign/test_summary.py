"""Summary of a campaign: intervals, and quantiles in which a dropped object counts as infinite."""

import math

import msgspec
import pytest

from grasp.cli.campaign import _shown, print_summary
from scenarios.campaign.summary import summarize, wilson
from scenarios.campaign.worker import Row


def row(number: int, name: str, outcome: str, slip_m: float | None = 0.02, **more: object) -> Row:
    values: dict[str, object] = {
        "trial": number, "scenario": "lift", "object": name, "profile": "default",
        "detector": "energy", "swept": "{}", "repetition": number, "seed": number,
        "status": "done", "set_down": False, "config_hash": "", "detector_hash": "",
        "success": outcome.startswith("held"), "outcome": outcome,
        "slip_distance_m": slip_m, **more,
    }  # fmt: skip
    return msgspec.convert(values, Row)


def test_wilson_interval() -> None:
    for successes, n, low, high in [
        (7, 20, 0.181, 0.567),
        (20, 20, 0.839, 1.0),
        (0, 20, 0.0, 0.161),
    ]:
        assert wilson(successes, n) == pytest.approx((low, high), abs=5e-4), (
            successes,
            n,
            low,
            high,
        )


def test_a_lost_object_counts_as_infinitely_far() -> None:
    rows = [row(0, "ball", "held"), row(1, "ball", "dropped", slip_m=0.3)]
    (cell,) = summarize("x", rows).variants[0].cells
    assert (cell.slip_distance_mm.p10, cell.slip_distance_mm.p90) == (20.0, math.inf)


def test_false_start_counts_as_undetected_for_the_later_slip() -> None:
    held = [row(i, "ball", "held", detection_latency_ms=5.0, reaction_latency_ms=60.0,
                peak_force_n=9.0) for i in (0, 1)]  # fmt: skip
    early = row(2, "ball", "false_start", detection_latency_ms=-300.0, reaction_latency_ms=-240.0,
                peak_force_n=9.0)  # fmt: skip
    (cell,) = summarize("x", [*held, early]).variants[0].cells
    for q, least in ((cell.detection_latency_ms, 5.0), (cell.reaction_latency_ms, 60.0)):
        assert q is not None and (q.p10, q.max) == (least, math.inf)


def test_excluded_trials_are_listed_beside_the_rate() -> None:
    tap = {"scenario": "tap", "slip_m": 0.005}
    rows = [row(i, "ball", "registered", success=True, moved=True, **tap) for i in range(3)]
    rows.append(row(3, "ball", "unmoved_registered", success=False, moved=False, **tap))
    rows.append(row(4, "ball", "never_nominal", success=False, **tap))
    (variant,) = summarize("x", rows).variants
    (cell,) = variant.cells
    assert (cell.rate, cell.rate_of_all) == (1.0, 0.6)
    assert (variant.average, variant.average_of_all) == (1.0, 0.6)
    assert cell.excluded == {"unmoved_registered": 1, "never_nominal": 1}
    shown = _shown(cell)
    assert "n 3 of 5: 60% of all" in shown
    assert "1 never_nominal, excluded" in shown and "1 unmoved_registered, excluded" in shown


def test_errors_are_counted_separately_from_failures() -> None:
    rows = [row(0, "ball", "held"), row(1, "ball", "dropped"), row(2, "ball", "held")]
    rows[2] = msgspec.structs.replace(rows[2], status="error", success=None, outcome=None)
    summary = summarize("x", rows)
    (cell,) = summary.variants[0].cells
    assert (cell.trials, cell.successes, cell.errors, summary.errors) == (2, 1, 1, 1)


def test_table_names_the_rig_that_ran(capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(summarize("x", [row(0, "ball", "held")]), "emulated")
    assert capsys.readouterr().out.splitlines()[0].strip() == "object lift, rig emulated"


def test_all_swept_settings_are_shown_whole(capsys: pytest.CaptureFixture[str]) -> None:
    swept = '{"loop.decision_delay_s":0.02,"controller.closing_speed_mps":[0.05,0.1]}'
    print_summary(summarize("x", [row(0, "ball", "held", swept=swept)]), "simulated")
    shown = capsys.readouterr().out
    assert "loop.decision_delay_s = 0.02" in shown
    assert "controller.closing_speed_mps = [0.05, 0.1]" in shown
