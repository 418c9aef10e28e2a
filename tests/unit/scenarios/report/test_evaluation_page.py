"""The page of an evaluation: what was missed is at the top, thresholds are the rule's own."""

from pathlib import Path

import msgspec
import pytest

from grasp.cli.main import main
from scenarios.benchmark.evaluation_file import EvaluationFile, evaluated
from scenarios.benchmark.scoring import contender
from scenarios.report.charts import BOTTOM, LEFT, RIGHT, TOP
from scenarios.report.evaluation_page import evaluation_page
from tests.unit.detector.toys import toys

HOSTILE = "</p><script>alert(1)</script>"


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


def test_what_a_file_says_is_text_and_never_part_of_the_page(tmp_path: Path) -> None:
    page = evaluation_page(made(tmp_path / "bad.json", ("energy",), HOSTILE))
    assert HOSTILE not in page and "&lt;script&gt;" in page


def test_detectors_that_heard_nothing_have_a_page_too(tmp_path: Path) -> None:
    told = msgspec.json.decode(made(tmp_path / "one.json", ("energy",)).read_bytes())
    (each,) = told["detectors"]
    never = {"count": 3, "p10": None, "p50": None, "p90": None, "p99": None, "max": None}
    each["sheet"] |= {"delay_ms": never, "auc": None, "compute_us": None}
    each |= {"choices": [], "reliability": [], "worst": []}
    each["slips"] = [{**slip, "delay_ms": None, "speed_mps": None} for slip in each["slips"]]
    (tmp_path / "one.json").write_bytes(msgspec.json.encode(told))
    page = evaluation_page(tmp_path / "one.json")
    assert "– / – / –" in page
    assert "Accuracy against compute" not in page and "Nothing slipped" in page


def test_the_command_line_keeps_an_evaluation_and_makes_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from detector.recordings import write

    for recording in toys("test", 2, 50):
        write(tmp_path / f"{recording.source}.npz", recording)
    out = tmp_path / "scores.json"
    words = ["detector", "evaluate", "energy", "--data", str(tmp_path), "--out", str(out)]
    assert main(words) == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(out)
    assert main(["report", str(out)]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'scores.html'}\n"
    assert " ".join(words[:5]) in (tmp_path / "scores.html").read_text()
    (tmp_path / "other.json").write_text("{}")
    assert main([*words[:-1], str(tmp_path / "other.json")]) == 2
    assert main(["report", str(tmp_path / "other.json")]) == 2
    assert "is no evaluation" in capsys.readouterr().err
