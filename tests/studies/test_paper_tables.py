"""The paper's tables from a tiny grid, and the arithmetic behind them."""

from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import write
from drivers.errors import UsageError
from studies import paper_tables as study
from studies.runner import main
from tests.unit.detector.toy_recordings import toy, toys


def cells(folder: Path) -> Path:
    for k, (motion, speed, surface) in enumerate(study.LEAST_RECORDINGS * study.KEYS):
        made = toy(k % 7, "test", n=300)
        about = msgspec.structs.replace(
            made.metadata, motion=motion, speed_mps=speed, surface=surface
        )
        write(folder / f"{k}.npz", msgspec.structs.replace(made, metadata=about))
    return folder


def test_small_study_gives_both_tables_with_swept_thresholds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    (tmp_path / "cells").mkdir(), data.mkdir()
    for recording in [*toys("train", 2, 0), *toys("test", 2, 50)]:
        write(data / f"{recording.source}.npz", recording)
    words = ["psd", "--data", str(data), "--cells", str(cells(tmp_path / "cells"))]
    assert main("paper_tables", study.STUDY, [*words, "--jobs", "1", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "| `psd` | 57.4 / " in text and "| primary 5 cm/s, planar | 92.5 | " in text
    assert "| rotation is worst | " in text and "`psd` psd.threshold" in text
    with pytest.raises(UsageError, match="with --data and --cells"):
        main("paper_tables", study.STUDY, ["psd", "--data", str(data), "--cells", str(data)])


def test_a_cell_with_too_few_recordings_is_refused() -> None:
    with pytest.raises(UsageError, match="28 of 28 cells"):
        study.require_cells(toys("test", 2, 0))


def row(wrong_in: Mapping[study.Key, int], spread: int = 0) -> study.Row:
    """Every cell with its wrong samples of a hundred, spread over its recordings."""
    found = []
    for key in study.KEYS:
        for k in range(study.LEAST_RECORDINGS):
            wrong = wrong_in.get(key, 10) + spread * (k - study.LEAST_RECORDINGS // 2)
            found.append(study.Counts(key, (50 - wrong, wrong, 0, 50), [20.0, np.inf]))
    return study.Row("tcn-paper", "", found, found)


def verdicts(made: study.Row) -> list[str]:
    lines = study.statements_table(made, study.f1_by_cell(made.cells)).splitlines()[2:]
    return [line.split("|")[2].strip() for line in lines]


def test_statements_hold_do_not_or_are_not_resolved() -> None:
    worse = {"sphere": 8, "cylinder-y": 8, "cylinder-x": 4, 0.05: 6, "primary": 2, "rotation": 16}
    as_in_the_paper = {key: 2 + sum(worse.get(part, 0) for part in key) for key in study.KEYS}
    assert verdicts(row(as_in_the_paper)) == 5 * ["holds"]
    opposite = {key: 30 if key[1] == 0.1 else 10 for key in study.KEYS}
    assert verdicts(row(opposite))[2] == "does not"
    assert verdicts(row({}, spread=2)) == 5 * ["not resolved"]
