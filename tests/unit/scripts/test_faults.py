"""The words of the fault campaign's script."""

import sys
from pathlib import Path

import pytest

from scripts import faults


@pytest.mark.parametrize(("word", "count"), [("--most", "-1"), ("--most", "0"), ("--jobs", "0")])
def test_a_count_below_one_is_refused_before_a_run_is_made(
    word: str, count: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "faults.sqlite"
    monkeypatch.setattr(sys, "argv", ["faults.py", "run", "--out", str(out), word, count])
    with pytest.raises(SystemExit) as ended:
        faults.main()
    assert ended.value.code == 2
    assert not out.exists()


def test_a_number_that_is_no_run_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["faults.py", "show", "99999"])
    assert faults.main() == 2
    assert "no run 99999" in capsys.readouterr().err
