"""The page of results is made from CSV rows; parts that are done are not run again."""

import csv
import json
from pathlib import Path

import msgspec
import pytest

from grasp.settings import load, read_toml
from studies import results
from studies.results_page import Kept, Row, Topic, page, speed_chart

TOPICS = [
    {"title": "Beside the paper", "text": "Six rows.", "claims": [
        {"claim": "lift success, %", "paper": "72.5", "part": "lifts", "item": "can",
         "measure": "held, %"},
        {"claim": "real recording", "paper": "", "part": "real", "item": "tcn", "measure": "AUC"},
    ]},
    {"title": "Lifts", "text": "Two objects.", "tables": [
        ["lifts", "object", ["held, %", "default: slip p50, mm"]],
        ["lifts", "object", ["default: slip p50, mm", "default: delay p50, ms"]],
        ["nothing", "object", ["held, %"]],
    ]},
    {"title": "Evidence", "text": "", "lanes": True},
]  # fmt: skip
ROWS = [
    Row("can", "held, %", 97.46, 91.2, 99.97, 40),
    Row("can", "default: slip p50, mm", 1.0, None, 2.345, 40),
    Row("ball", "held, %", 100.0, 91.2, 100.0, 40),
    Row("ball", "default: slip p50, mm", float("inf"), None, float("inf"), 40),
    Row("ball", "default: delay p50, ms", 1234.5),
]


def kept(root: Path) -> Kept:
    found = Kept(root)
    found.add("lifts", ROWS, None, 90.0)
    return found


def test_rows_of_a_csv_file_are_read_as_they_were_written(tmp_path: Path) -> None:
    assert kept(tmp_path).rows("lifts") == ROWS
    assert (tmp_path / "results/lifts.csv").read_text().startswith("item,measure,value,low,high,n")
    assert json.loads((tmp_path / "results/run.json").read_text())["lifts"]["seconds"] == 90


def test_page_is_made_from_rows(tmp_path: Path) -> None:
    found = kept(tmp_path)
    (tmp_path / "results/faults.csv").write_text(
        "fault,state,runs,failures\na,lift,3,0\nb,lift,4,1\n"
    )
    text = page(msgspec.convert(TOPICS, list[Topic]), "All simulated.", found)
    lines = text.splitlines()
    assert lines[0] == "# Results" and "in 2 minutes" in lines[2] and "All simulated." in text
    command = "`make results ONLY="
    assert f"| lift success, % | 72.5 | 97.5 | 91.2–100.0 | {command}lifts` |" in lines
    assert f"| real recording |  | not given |  | {command}real` |" in lines
    assert f"Command: {command}lifts`" in lines
    assert "| can | 97.5 (91.2–100.0) | 1 (p90 2.35) |" in lines
    assert "| object | slip p50, mm | delay p50, ms |" in lines
    assert "| ball | never (p90 never) | 1,234 |" in lines
    assert "Not measured yet." in lines
    assert any("| 7 | 1 | `results/faults.csv` |" in line for line in lines)


def test_settings_name_parts_that_exist() -> None:
    settings = load(results.Settings, [read_toml(Path(results.__file__).with_suffix(".toml"))])
    named = {c.part for t in settings.topics for c in t.claims}
    named |= {part for t in settings.topics for part, *_ in t.tables}
    assert named <= results.PARTS.keys() and len(settings.topics[0].claims) == 6
    assert all(len(m) <= 5 for t in settings.topics for _, _, m in t.tables)


def test_a_part_that_is_done_is_run_again_only_when_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Path | None] = []

    def real(run: results.Run) -> list[Row]:
        calls.append(run.real)
        return [Row("tcn", "AUC", 0.5)]

    monkeypatch.setattr(results, "PARTS", {"real": real})
    words = ["--out", str(tmp_path), "--work", str(tmp_path / "work"), "--real", "clip.csv"]
    for more in ([], [], ["--again"]):
        assert results.main([*words, *more]) == 0
    assert calls == [Path("clip.csv")] * 2
    assert "| tcn |  | 0.5 |" in (tmp_path / "docs/results.md").read_text()
    with (tmp_path / "results/real.csv").open(newline="") as file:
        assert [line["value"] for line in csv.DictReader(file)] == ["0.5"]


def test_chart_has_a_curve_a_detector(tmp_path: Path) -> None:
    figures = pytest.importorskip("matplotlib.figure")
    from studies.results_page import ACCURACY, Curve

    figure = figures.Figure()
    points = [(50.0, 2.0), (40.0, 9.0), (None, 0.0)]
    speed_chart([Curve("tcn", points, Row("tcn", ACCURACY, 90.0, 88.0, 92.0))], figure)
    left, right = figure.axes
    assert left.lines[0].get_xydata().tolist() == [[40.0, 9.0], [300.0, 0.1]]
    assert right.lines[0].get_xydata().tolist() == [[50.0, 90.0]]
