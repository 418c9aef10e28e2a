"""Reading of recordings for scoring, and evidence of a rule."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import Recording, write
from scenarios.benchmark.scoring import contender, evidence, read_split
from tests.unit.detector.impact_recordings import impact_recording
from tests.unit.detector.toy_recordings import toy, toys
from tests.unit.scenarios.conftest import EAGER


def cut(recording: Recording, samples: int) -> Recording:
    parts = {
        name: array[:samples]
        for name in recording.__struct_fields__
        if isinstance(array := getattr(recording, name), np.ndarray)
    }
    return msgspec.structs.replace(recording, **parts)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A complete recording, and one that is too short."""
    write(tmp_path / "whole.npz", toy(1, "test"))
    write(tmp_path / "short.npz", cut(toy(2, "test"), 65))
    return tmp_path


def test_recording_too_short_to_be_scored_is_left_out_and_reported(folder: Path) -> None:
    lines: list[str] = []
    (found,) = read_split([folder], "test", lines.append)
    assert found.source.endswith("whole.npz")
    (line,) = lines
    assert "1 recordings of at most 100 samples" in line


def test_evidence_of_a_rule_counts_slips_without_taps() -> None:
    taps = [impact_recording((3.0, 0.003), n=500)]
    slips = toys("test", 2, 0)
    rule = contender("energy", slips, "test", assignments=[EAGER]).config.rule
    alone, both = (
        evidence(contender("energy", each, "test", assignments=[EAGER]).streams, rule)
        for each in (slips, [*slips, *taps])
    )
    assert both.slips == alone.slips > 0
    assert 0 < alone.caught <= alone.slips
    assert both.minutes > alone.minutes > 0.0
