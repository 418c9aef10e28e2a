"""Where success falls along an axis, and the frontier of a campaign's rows."""

import json
import sqlite3
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest

from grasp.cli.frontier_view import place, print_frontier
from grasp.cli.main import main
from scenarios.campaign.falls import Place, falling, places
from scenarios.campaign.frontier import summarize
from scenarios.campaign.run import run
from scenarios.campaign.spec import AT, MOVED, Task
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.worker import Finished, Row, error_row
from scenarios.studies.frontier_figure import draw_frontier


def trials(rates: dict[float, float], n: int = 40) -> tuple[list[float], list[bool]]:
    hard = [x for x in rates for _ in range(n)]
    return hard, [i < round(rate * n) for rate in rates.values() for i in range(n)]


def test_place_is_between_the_last_rate_above_the_level_and_the_first_below() -> None:
    at = places(*trials({0.0: 1.0, 1.0: 1.0, 2.0: 0.6, 3.0: 0.0}))
    assert [p.level for p in at] == [0.95, 0.5]
    assert at[0].at == pytest.approx(1.0 + 0.05 / 0.4)
    assert at[1].at == pytest.approx(2.0 + 0.1 / 0.6)
    for p in at:
        assert p.low is not None and p.at is not None and p.high is not None
        assert p.low <= p.at <= p.high


def test_what_never_falls_has_no_place_and_what_begins_below_has_the_first() -> None:
    never = places(*trials({0.0: 1.0, 1.0: 1.0}, n=20))
    assert [(p.at, p.high) for p in never] == [(None, None)] * 2
    assert never[1].low is None and never[0].low == 0.0  # twenty of twenty do not exclude 94 %
    begins = places(*trials({0.5: 0.2, 1.0: 0.0}))
    assert begins[0].at == begins[1].at == 0.5


def test_chance_failures_before_an_easier_success_do_not_count_as_a_fall() -> None:
    at = places(*trials({0.0: 1.0, 1.0: 0.925, 2.0: 1.0, 3.0: 1.0, 4.0: 0.0}))
    assert at[0].at is not None and at[0].at > 3.0


def test_fitted_rates_never_rise_and_keep_the_successes() -> None:
    rng = np.random.default_rng(0)
    n = rng.integers(1, 30, 20).astype(float)
    won = rng.binomial(n.astype(int), 0.5).astype(float)
    rate = falling(won, n)
    assert (np.diff(rate) <= 1e-12).all()
    assert (rate * n).sum() == pytest.approx(won.sum())


@pytest.mark.parametrize("level, true", [(0.5, 1.0), (0.95, 1.0 - 0.15 * np.log(19.0))])
def test_interval_covers_the_true_place_as_often_as_it_says(level: float, true: float) -> None:
    x = np.repeat(np.linspace(0.0, 2.0, 9), 18)
    inside = 0
    for seed in range(100):
        held = np.random.default_rng(seed).uniform(size=len(x)) < 1 / (1 + np.exp((x - 1.0) / 0.15))
        p = places(x.tolist(), held.tolist(), (level,))[0]
        assert p.low is not None
        inside += p.low <= true <= (p.high or np.inf)
    assert inside >= 93


def test_few_successes_do_not_make_a_place_sure() -> None:
    """Ten of ten say little about 95 %, a hundred of a hundred something."""
    few = places(*trials({0.0: 1.0, 1.0: 1.0, 2.0: 1.0, 3.0: 0.0}, n=10))[0]
    many = places(*trials({0.0: 1.0, 1.0: 1.0, 2.0: 1.0, 3.0: 0.0}, n=100))[0]
    assert few.low is not None and few.low < 2.0 and few.high == 3.0
    assert (many.low, many.high) == (2.0, 3.0)


def rows() -> list[Row]:
    found = []
    for value, share, outcomes in (
        (0.6, 0.4, ["held"] * 9 + ["never_slipped"]),
        (1.0, 0.7, ["held"] * 10),
        (1.6, 1.1, ["dropped"] * 9 + ["held"]),
    ):
        for outcome in outcomes:
            at = {"mass": [value, share]}
            if value == 0.6:
                at["friction"] = [0.7, 0.5]
            swept = json.dumps({MOVED: "mass" if value > 0.6 else "", AT: at})
            found.append(
                Row(
                    trial=len(found), scenario="lift", object="can", profile="default",
                    detector="energy", swept=swept, repetition=0, seed=0, status="done",
                    success=outcome == "held", outcome=outcome, config_hash="", detector_hash="",
                )
            )  # fmt: skip
    return found


def test_line_has_the_settings_as_they_are_first_and_what_never_slipped_apart() -> None:
    frontier = summarize("x", rows())
    lines = {line.axis: line for line in frontier.lines}
    mass = lines["mass"]
    assert [(t.value, t.held, t.tested, t.never_slipped) for t in mass.tried] == [
        (0.6, 9, 9, 1), (1.0, 10, 10, 0), (1.6, 1, 10, 0),
    ]  # fmt: skip
    assert mass.tried[0].outcomes == {"held": 9, "never_slipped": 1}
    assert mass.bound == pytest.approx((1.0 / 0.7, 0.6 / 0.4))
    half = mass.falls[1]
    assert half.at == pytest.approx(1.0 + 0.5 / 0.9 * 0.6)
    assert mass.falls_share[1].at == pytest.approx(0.7 + 0.5 / 0.9 * 0.4)


def test_grips_that_never_slip_are_no_proof_of_holding() -> None:
    """Were they successes, nine of them at the hardest place would move the fall beyond it."""
    rested = [
        msgspec.structs.replace(row, outcome="never_slipped", success=False)
        if row.outcome == "dropped"
        else row
        for row in rows()
    ]
    (mass,) = (line for line in summarize("x", rested).lines if line.axis == "mass")
    assert [(t.held, t.tested) for t in mass.tried] == [(9, 9), (10, 10), (1, 1)]
    assert mass.falls[0].at is None and mass.falls[0].high is None


def test_line_on_which_nothing_slips_has_no_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = [msgspec.structs.replace(r, outcome="never_slipped", success=False) for r in rows()]
    frontier = summarize("x", still)
    assert all(p.at is None and p.low is None for line in frontier.lines for p in line.falls)
    print_frontier(frontier)
    assert "100%" not in capsys.readouterr().out
    draw_frontier([frontier], tmp_path / "f.svg")


def test_axis_that_gets_harder_downwards_is_told_in_its_own_unit() -> None:
    found = []
    for k, row in enumerate(rows()):
        swept = json.loads(row.swept)
        value, share = swept[AT]["mass"]
        moved = "friction" if swept[MOVED] else ""
        text = json.dumps({MOVED: moved, AT: {"friction": [1.0 - value / 2, share]}})
        found.append(msgspec.structs.replace(row, trial=k, swept=text))
    (line,) = summarize("x", found).lines
    assert [t.value for t in line.tried] == pytest.approx([0.7, 0.5, 0.2])
    assert line.falls[1].at is not None and 0.2 < line.falls[1].at < 0.5


def test_errors_are_no_failures() -> None:
    broken = [msgspec.structs.replace(row, status="error", success=None) for row in rows()[20:]]
    frontier = summarize("x", rows()[:20] + broken)
    assert frontier.errors == 10
    assert sum(t.tested for line in frontier.lines if line.axis == "mass" for t in line.tried) == 19


def test_tables_and_picture_show_every_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frontier = summarize("x", rows())
    print_frontier(frontier)
    shown = capsys.readouterr().out
    assert "mass, kg; bound 1.43 to 1.5" in shown
    assert "10% (2-40)" in shown and "9 dropped" in shown
    draw_frontier([frontier], tmp_path / "f.svg")
    text = (tmp_path / "f.svg").read_text()
    assert "default, energy" in text or text.count("<path") > 50


def outcome_by_mass(task: Task) -> Finished:
    """In place of a trial: what weighs more than a kilogram is dropped."""
    body = task.config.object
    held = body.mass_kg + body.added_mass_kg < 1.0
    row = msgspec.structs.replace(
        error_row(task, ""), status="done", success=held, outcome="held" if held else "dropped"
    )
    return Finished(row)


def run_small(folder: Path, monkeypatch: pytest.MonkeyPatch, more: str) -> Path:
    monkeypatch.setattr("scenarios.campaign.run.run", partial(run, work=outcome_by_mass))
    file, out = folder / "small.toml", folder / "small.sqlite"
    file.write_text(f'name = "small"\nobjects = ["can", "box"]\nrepetitions = 4\n{more}')
    words = ["campaign", "run", str(file), "--detector", "energy", "--jobs", "1", "--out", str(out)]
    assert main([*words, "--json"]) == 0
    return out


def test_campaign_with_axes_is_summed_up_as_a_frontier_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = run_small(tmp_path, monkeypatch, "[axes]\nmass = [0.8, 1.2]\n")
    (line,) = json.loads(capsys.readouterr().out)["lines"]
    assert [(t["value"], t["held"], t["tested"]) for t in line["tried"]] == [
        (None, 8, 8), (0.8, 8, 8), (1.2, 0, 8),
    ]  # fmt: skip
    assert line["falls"][1]["at"] == pytest.approx(1.0)
    assert main(["campaign", "summary", str(out)]) == 0
    assert "below 95 %" in capsys.readouterr().out
    picture = tmp_path / "f.svg"
    assert main(["chart", "frontier", str(out), "--out", str(picture)]) == 0
    assert picture.exists()
    assert json.loads((tmp_path / "f.json").read_text())[0]["lines"][0]["axis"] == "mass"


@pytest.mark.parametrize(
    "more", ["[axes]\nmass = [0.8, 1.2]\n", 'draws = 2\n[unknowns."object.mass_kg"]\nlow=1\nhigh=2']
)
def test_frontier_and_range_are_gone_on_with_where_they_were_left(
    more: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = run_small(tmp_path, monkeypatch, more)
    with CampaignStore.open(out) as store:
        whole = store.rows()
    with sqlite3.connect(out) as db:
        db.execute("DELETE FROM trials WHERE trial IN (1, 5)")
    db.close()
    words = ["campaign", "run", str(tmp_path / "small.toml"), "--detector", "energy", "--out"]
    assert main([*words, str(out), "--resume", "--jobs", "1", "--json"]) == 0
    with CampaignStore.open(out) as store:
        assert [(r.trial, r.swept) for r in store.rows()] == [(r.trial, r.swept) for r in whole]


def test_chart_of_a_campaign_without_axes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = run_small(tmp_path, monkeypatch, "")
    assert main(["chart", "frontier", str(out), "--out", str(tmp_path / "f.svg")]) == 2
    assert "without axes" in capsys.readouterr().err


def test_campaign_over_unknowns_is_summed_up_as_a_range(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    unknown = '[unknowns."object.mass_kg"]\nlow = 0.5\nhigh = 5.0\ntimes = true\n'
    out = run_small(tmp_path, monkeypatch, f"draws = 5\n{unknown}")
    (column,) = json.loads(capsys.readouterr().out)["columns"]
    assert (column["draws"], column["log_likelihood"]) == (5, None)  # two objects of six
    assert {(c["least"], c["most"]) for c in column["cells"]} == {(0.0, 1.0)}
    assert column["tendencies"][0]["with_rate"] < -0.8
    assert main(["campaign", "summary", str(out)]) == 0
    assert "object.mass_kg: rank correlation" in capsys.readouterr().out


def test_place_beyond_what_was_tried_is_a_dash() -> None:
    assert place(Place(0.95, None, 1.23456, None)) == "- (1.23 to -)"
