"""The page of results is made from CSV rows; parts that are done are not run again."""

import csv
import json
from pathlib import Path

import msgspec
import pytest

from grasp.settings import load, read_toml
from studies import make_results, results_page
from studies.results_page import ROOT, Kept, Row, Topic, page
from studies.results_run import Run, Settings

TOPICS = [
    {"title": "Beside the paper", "text": "Six rows.", "claims": [
        ["lift success, %", "72.5", "lifts", "can", "held, %"],
        ["real recording", "", "benchmark", "tcn", "AUC"],
    ]},
    {"title": "Lifts", "text": "Two objects.", "tables": [
        ["lifts", "object", {"held, %": "held, %", "slip, mm": "default: slip p50, mm"}],
        ["lifts", "object", {"slip, mm": "default: slip p50, mm", "ms": "default: delay p50, ms"}],
        ["nothing", "object", {"held, %": "held, %"}],
    ], "figure": "missing"},
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
    folder = tmp_path / "studies/results"
    assert (folder / "lifts.csv").read_text().startswith("item,measure,value,low,high,n")
    assert json.loads((folder / "run.json").read_text())["lifts"]["seconds"] == 90


def test_page_is_made_from_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results_page, "ROOT", tmp_path)
    found = kept(tmp_path)
    (tmp_path / "studies/results/faults.csv").write_text(
        "fault,state,runs,failures\na,lift,3,0\nb,lift,4,1\n"
    )
    text = page(msgspec.convert(TOPICS, list[Topic]), "All simulated.", found)
    lines = text.splitlines()
    assert lines[0] == "# Results" and "in 2 minutes" in lines[2] and "All simulated." in text
    assert "| lift success, % | 72.5 | 97.5 | 91.2–100.0 |" in lines
    assert "| real recording |  | not given |  |" in lines
    assert '`make results ONLY="lifts benchmark" REAL=FILE`' in lines
    assert "| can | 97.5 (91.2–100.0) | 1 (2.35) |" in lines
    assert "| object | slip, mm | ms |" in lines
    assert "| ball | never (never) | 1,234 |" in lines
    assert "Not measured yet." in lines and "![" not in text
    assert any("| 7 | 1 | `studies/results/faults.csv` |" in line for line in lines)


def test_settings_name_parts_that_exist() -> None:
    settings = load(Settings, [read_toml(ROOT / "studies/results.toml")])
    named = {c.part for t in settings.topics for c in t.claims}
    named |= {part for t in settings.topics for part, *_ in t.tables}
    assert named <= make_results.PARTS.keys() and len(settings.topics[0].claims) == 6
    assert all(len(m) <= 5 for t in settings.topics for _, _, m in t.tables)


def test_a_part_that_is_done_is_run_again_only_when_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Path | None] = []

    def benchmark(run: Run) -> list[Row]:
        calls.append(run.real)
        return [Row("tcn", "right, %", 50.0)]

    monkeypatch.setattr(make_results, "PARTS", {"benchmark": benchmark})
    monkeypatch.delenv("REAL", raising=False)
    words = ["--out", str(tmp_path), "--work", str(tmp_path / "work"), "--real", "clip.csv"]
    for more in ([], [], ["--again"]):
        assert make_results.main([*words, *more]) == 0
    assert calls == [Path("clip.csv")] * 2
    assert "| tcn | 50.0 |" in (tmp_path / "docs/results.md").read_text()
    with (tmp_path / "studies/results/benchmark.csv").open(newline="") as file:
        assert [line["value"] for line in csv.DictReader(file)] == ["50"]
