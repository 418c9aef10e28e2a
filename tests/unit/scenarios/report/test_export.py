"""A run as a table, and the layout in which viewers show it."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp.cli.main import main
from grasp.messages import TRUTH
from grasp.settings import config_dir
from scenarios.report.export import as_csv
from scenarios.report.run_record import read_run
from scenarios.trial import pictures
from scenarios.trial.run_folder import RUN_CHANNELS
from tests.unit.scenarios.report.conftest import changed

LAYOUT = config_dir() / "viewers" / "foxglove.json"


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(text.splitlines()))


def numbers(table: list[dict[str, str]], column: str) -> Any:
    return np.array([float(row[column] or "nan") for row in table])


def test_a_table_has_a_row_a_step_and_the_numbers_of_the_recording(recorded: Path) -> None:
    run, table = read_run(recorded), rows(as_csv(recorded))
    assert "nan" not in as_csv(recorded)
    assert run.truth is not None
    np.testing.assert_allclose(numbers(table, "t_s"), run.t_s, atol=1e-6)
    for i, finger in enumerate("ABC"):
        felt_n = np.where(np.isnan(run.counts[:, i, 0]), np.nan, run.felt_n[:, i])
        np.testing.assert_allclose(numbers(table, f"{finger}_felt_n"), felt_n, rtol=1e-5)
        known = run.truth.normal_n[:, i]
        np.testing.assert_allclose(numbers(table, f"{finger}_true_n"), known, rtol=1e-5)
        counts = run.counts[:, i, 5]
        np.testing.assert_array_equal(numbers(table, f"taxel_{finger}5_counts"), counts)
    slip_m = numbers(table, "true_slip_m")
    np.testing.assert_allclose(slip_m, run.truth.slip_m, rtol=1e-5, atol=1e-12)
    phases = list(dict.fromkeys(row["phase"] for row in table))
    assert phases == list(dict.fromkeys(change.phase for change in run.phases))


def test_what_nobody_knows_is_no_column(recorded: Path, tmp_path: Path) -> None:
    run = changed(recorded, tmp_path / "run", lambda m: None if m[0] == TRUTH else m)
    assert not [name for name in rows(as_csv(run))[0] if name.startswith("true") or "true" in name]


def test_export_says_where_it_wrote_and_overwrites_its_own_alone(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = changed(recorded, tmp_path / "run")
    for _ in range(2):
        assert main(["report", str(run), "--to", "csv"]) == 0
        assert capsys.readouterr().out == f"{run / 'recording.csv'}\n"
    (run / "recording.csv").write_text("mine")
    assert main(["report", str(run), "--to", "csv"]) == 2
    assert "is there already" in capsys.readouterr().err
    for _ in range(2):
        assert main(["report", str(run), "--to", "layout"]) == 0
    assert (run / "foxglove-layout.json").read_text() == LAYOUT.read_text()


@pytest.mark.parametrize("words", [("--to", "svg"), ("--out", "run.png")], ids=["svg", "png"])
def test_a_picture_is_drawn_by_its_kind_or_by_its_name(
    words: tuple[str, ...], recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    run = changed(recorded, tmp_path / "run")
    monkeypatch.chdir(run)
    assert main(["report", str(run), *words]) == 0
    begins = {"svg": b"<?xml", "png": b"\x89PNG"}[words[1][-3:]]
    assert (run / f"run.{words[1][-3:]}").read_bytes().startswith(begins)


def test_a_picture_of_no_known_kind_is_refused(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "run.xyz"
    assert main(["report", str(recorded), "--to", "svg", "--out", str(out)]) == 2
    assert "ends in .svg, .png, .pdf" in capsys.readouterr().err
    assert not out.exists()


def test_a_campaign_becomes_a_table_of_its_trials_beside_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "a.sqlite", tmp_path / "a.csv"
    words = ["run", "tap", "--rig", "simulated", "--detector", "energy", "--trials", "1"]
    assert main([*words, "--runs", str(tmp_path), "--out", str(file)]) == 0
    capsys.readouterr()
    assert main(["report", str(file), "--to", "csv"]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    assert [row["scenario"] for row in rows(out.read_text())] == ["tap"]
    assert main(["report", str(file), "--to", "svg"]) == 2
    assert "is a campaign" in capsys.readouterr().err


def test_the_layout_shows_topics_that_are_recorded() -> None:
    layout = json.loads(LAYOUT.read_text())
    topics = {*RUN_CHANNELS, *pictures.CHANNELS}
    panels = layout["configById"]
    named = {*panels["3D!grasp"]["topics"], panels["RosOut!log"]["topicToRender"]}
    paths = [path for panel in panels.values() for path in panel.get("paths", [])]
    assert paths and named <= topics
    for path in paths:
        topic, field = re.fullmatch(r"(/\w+)\.(\w+)(\[\d\])?", path["value"]).groups()[:2]  # type: ignore[union-attr]
        assert field in RUN_CHANNELS[topic].__struct_fields__

    def leaves(part: Any) -> list[str]:
        return [part] if isinstance(part, str) else leaves(part["first"]) + leaves(part["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)
