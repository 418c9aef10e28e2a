"""What a series of trials says with its exit code."""

from pathlib import Path

import pytest

from grasp.cli.main import main

DEAF = ("--detector", "energy", "--set", "energy.threshold_counts=400")


@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_series_that_was_complete_before_has_the_verdict_of_its_rows(
    scenario: str, tmp_path: Path
) -> None:
    words = ["run", scenario, "--rig", "simulated", "--trials", "1", *DEAF]
    words += ["--runs", str(tmp_path), "--out", str(tmp_path / "rows.sqlite"), "--json"]
    assert main(words) == 1
    assert main([*words, "--resume"]) == 1
