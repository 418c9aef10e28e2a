"""The picture of a run: its own threshold, its onset named, names that do not overlap."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from scenarios.report.run_figure import NAMES_APART, _draw_decision, _draw_slip, _shade, title
from scenarios.report.run_record import RunRecord, read_run

pytest.importorskip("matplotlib")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes


@pytest.fixture
def run(recorded: Path) -> RunRecord:
    return read_run(recorded)


@pytest.fixture
def axes() -> "Axes":
    plt.switch_backend("Agg")
    figure, found = plt.subplots()
    yield found
    plt.close(figure)


def named(axes: "Axes") -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_the_threshold_is_that_of_the_rule(run: RunRecord, axes: "Axes") -> None:
    rule = RuleSettings(fusion="mean", threshold=0.83)
    told = msgspec.structs.replace(run.told, rule=rule)
    _draw_decision(axes, msgspec.structs.replace(run, told=told))
    assert named(axes) == ["all fingers, mean of log-odds", "threshold 0.83"]
    assert {0.83} == {y for line in axes.lines if line.get_ls() == ":" for y in line.get_ydata()}


def test_sums_stand_on_a_scale_of_their_own(run: RunRecord, axes: "Axes") -> None:
    told = msgspec.structs.replace(run.told, rule=RuleSettings(kind="cusum", limit=7.0))
    _draw_decision(axes, msgspec.structs.replace(run, told=told))
    (beside,) = [other for other in axes.figure.axes if other is not axes]
    assert named(beside) == ["limit 7"]
    assert not [line for line in axes.lines if line.get_ls() == ":"]


def test_names_of_phases_do_not_overlap_and_the_onset_has_one(run: RunRecord, axes: "Axes") -> None:
    _shade(axes, run, named=True)
    first, last = axes.get_xlim()
    places = [text.xy[0] for text in axes.texts]
    assert len(places) > 4
    assert (np.diff(places) >= 0.999 * NAMES_APART * (last - first)).all()
    assert [line.get_label() for line in axes.lines] == ["slip begins"]


def test_the_title_says_what_was_run_and_what_came_of_it(run: RunRecord) -> None:
    assert title(run) == "lift of can, seed 0, energy: held within 6 cm"


def test_motion_aside_is_shown_where_there_is_any(run: RunRecord, axes: "Axes") -> None:
    assert run.truth is not None
    _draw_slip(axes, run)
    assert [line.get_label() for line in axes.lines] == ["down"]
    axes.clear()
    truth = msgspec.structs.replace(run.truth, across_m=run.truth.across_m - 0.003)
    _draw_slip(axes, msgspec.structs.replace(run, truth=truth))
    assert [line.get_label() for line in axes.lines] == ["down", "aside"]
    assert axes.get_ylim()[0] <= -3.0
