"""The page of an evaluation: what was missed is at the top, thresholds are the rule's own."""

from pathlib import Path

import msgspec
import pytest

from scenarios.benchmark.evaluation_file import EvaluationFile, evaluated
from scenarios.benchmark.scoring import contender
from scenarios.report.evaluation_page import evaluation_page
from scenarios.report.page import BOTTOM, LEFT, RIGHT, TOP
from tests.unit.detector.toy_recordings import toys


def made(path: Path, names: tuple[str, ...] = ("energy", "psd-fair"), data: str = "toys") -> Path:
    """An evaluation's file of a few toys."""
    kept = []
    for name in names:
        each = contender(name, toys("test", 3, 50), data)
        kept.append(evaluated(each, each.evaluation()))
    file = EvaluationFile(
        data=data, label="slip", command="grasp detector evaluate", versions={"grasp": "0"},
        detectors=kept,
    )  # fmt: skip
    path.write_bytes(msgspec.json.encode(file))
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("evaluations") / "toys.json")


def test_the_threshold_of_a_trace_is_the_rules_own(tmp_path: Path) -> None:
    told = msgspec.json.decode(made(tmp_path / "one.json", ("psd-fair",)).read_bytes())
    told["detectors"][0]["rule"] |= {"threshold": 0.765, "kind": "consecutive"}
    (tmp_path / "one.json").write_bytes(msgspec.json.encode(told))
    page = evaluation_page(tmp_path / "one.json")
    y = round(BOTTOM - 0.765 * (BOTTOM - TOP), 1)
    assert "threshold 0.765" in page and f'points="{LEFT},{y} {RIGHT},{y}"' in page
    told["detectors"][0]["rule"]["kind"] = "cusum"
    (tmp_path / "one.json").write_bytes(msgspec.json.encode(told))
    assert "threshold 0.765" not in evaluation_page(tmp_path / "one.json")


def test_accuracy_is_charted_against_the_cost_of_an_update(file: Path) -> None:
    told = msgspec.json.decode(file.read_bytes())
    for each, cost_us in zip(told["detectors"], (10.0, 100.0), strict=True):
        each["sheet"] |= {"accuracy": 0.75, "compute_us": {"p50": cost_us}}
    file.write_bytes(msgspec.json.encode(told))
    page = evaluation_page(file)
    for x in (LEFT, (LEFT + RIGHT) / 2):  # a decade of two: the middle
        assert f'cx="{x}" cy="{(TOP + BOTTOM) / 2}"' in page
