"""The page of an evaluation: its scores and its worst misses."""

import re
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from scenarios.benchmark.score_file import ScoreFile, Source, write_scores
from scenarios.benchmark.scoring import contender
from scenarios.benchmark.slips import evaluated
from scenarios.report.page import BOTTOM, LEFT, RIGHT, TOP, Axis, Curve, Mark, Plot, plot_svg
from scenarios.report.score_page import score_page
from tests.unit.detector.toy_recordings import toys


def made(path: Path, names: tuple[str, ...] = ("energy", "psd-fair"), data: str = "toys") -> Path:
    """An evaluation file on a few synthetic recordings."""
    kept = []
    for name in names:
        each = contender(name, toys("test", 3, 50), data)
        kept.append(evaluated(each, each.evaluation()))
    file = ScoreFile(
        source=Source(data, "", "slip"), command="grasp detector evaluate",
        versions={"grasp": "0"}, detectors=kept,
    )  # fmt: skip
    write_scores(path, file)
    return path


def test_trace_shows_the_threshold_of_the_rule(tmp_path: Path) -> None:
    content = msgspec.json.decode(made(tmp_path / "one.json", ("psd-fair",)).read_bytes())
    content["detectors"][0]["rule"] |= {"threshold": 0.765, "kind": "consecutive"}
    (tmp_path / "one.json").write_bytes(msgspec.json.encode(content))
    page = score_page(tmp_path / "one.json")
    y = round(BOTTOM - 0.765 * (BOTTOM - TOP), 1)
    assert "threshold 0.765" in page and f'points="{LEFT},{y} {RIGHT},{y}"' in page
    content["detectors"][0]["rule"]["kind"] = "cusum"
    (tmp_path / "one.json").write_bytes(msgspec.json.encode(content))
    assert "threshold 0.765" not in score_page(tmp_path / "one.json")


def test_an_undefined_figure_is_a_dash_and_the_best_detectors_are_named(tmp_path: Path) -> None:
    path = made(tmp_path / "one.json")
    content = msgspec.json.decode(path.read_bytes())
    for each, area, missed in zip(content["detectors"], (0.8, 0.7), (2, 1), strict=True):
        each["figures"] |= {
            "auc": {"value": area}, "slips": {"value": 4}, "missed": {"value": missed},
            "recall": {"value": 1 - missed / 4}, "update_p50_us": {"value": None},
        }  # fmt: skip
    path.write_bytes(msgspec.json.encode(content))
    page = score_page(path)
    assert "energy has the highest AUC (0.800); psd-fair detected most slips, 3 of 4." in page
    assert "<td>75.0" in page and "<td>–" in page


@pytest.mark.parametrize(("low", "high"), [(-37.0, 495.0), (-1.0, 201.0), (-79.1, 100.0), (0, 1)])
def test_a_rounded_axis_has_a_tick_at_each_end_and_every_value_between(
    low: float, high: float
) -> None:
    axis = Axis("", low, high).rounded()
    assert axis.low <= low and axis.high >= high
    first, *_, last = axis.ticks()
    assert (first, last) == (axis.low, axis.high)


def test_numbers_of_points_at_one_place_do_not_cover_each_other() -> None:
    marks = [Mark(30.0, score, str(i), score, score) for i, score in enumerate((62, 60, 58.5, 58))]
    curves = [Curve(mark.text, [(30.0, mark.y)], marks=[mark]) for mark in marks]
    drawn = plot_svg(Plot("", Axis("", 0.0, 400.0), Axis("", 0.0, 100.0), curves))
    numbers = re.findall(r'<text class="mark" x="([\d.]+)" y="([\d.]+)">\d<', drawn)
    heights = [float(y) for x, y in numbers if float(x) < LEFT + 40.0][: len(marks)]
    assert len(heights) == len(marks)
    assert all(below - above >= 9.9 for above, below in pairwise(sorted(heights)))
