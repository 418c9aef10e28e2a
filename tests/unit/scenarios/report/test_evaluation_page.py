"""The page of an evaluation: what was missed is at the top, thresholds are the rule's own."""

import json
import math
from pathlib import Path

import msgspec
import pytest

from drivers.errors import BadFile
from grasp.cli.main import main
from scenarios.benchmark.evaluation_file import EvaluationFile, evaluated
from scenarios.benchmark.scoring import contender
from scenarios.campaign.config import load_config
from scenarios.report.charts import BOTTOM, LEFT, RIGHT, TOP, Axis, Curve, Mark, curves
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


def test_a_page_names_what_the_issue_of_it_is(file: Path) -> None:
    page = evaluation_page(file)
    for title in (
        "False events against delay", "Accuracy against compute", "Calibration", "The worst misses",
    ):  # fmt: skip
        assert title in page
    assert "<script" not in page
    assert len(page) < 400_000


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


def test_a_page_says_which_weights_and_rule_it_is_of(tmp_path: Path) -> None:
    """An evaluation of an older version, which does not, still has a page."""
    file = made(tmp_path / "one.json", ("energy",))
    told = msgspec.json.decode(file.read_bytes())
    kept = load_config("can", "simulated", "energy").detector_hash()
    assert told["detectors"][0]["sheet"].pop("detector_hash") == kept
    assert f"energy {kept}" in evaluation_page(file)
    file.write_bytes(msgspec.json.encode(told))
    assert "energy not kept" in evaluation_page(file)


def test_delays_of_nine_slips_in_ten_stand_beside_the_median_and_a_miss_is_drawn(
    tmp_path: Path,
) -> None:
    file = made(tmp_path / "one.json", ("energy",))
    told = msgspec.json.decode(file.read_bytes())
    (each,) = told["detectors"]
    each["sheet"]["delay_ms"] |= {"p50": 40.0, "p90": None, "p99": None}
    each["sheet"]["false_events_per_min_hand"] = 1.0
    each["choices"] = []
    file.write_bytes(msgspec.json.encode(told))
    page = evaluation_page(file)
    words = "energy by its rule: 1.00 a minute, 40 ms (90 %: never, 99 %: never)"
    of_median, of_ninety = (line for line in page.splitlines() if words in line)
    assert f'cy="{TOP}"' in of_ninety and f'cy="{TOP}"' not in of_median


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


def test_numbers_stand_where_their_axes_say() -> None:
    x, y = Axis("", 0.1, 1000.0, log=True), Axis("", 0.0, 100.0)
    plot = curves("", x, y, [Curve("one", [(1.0, 50.0), (10.0, 100.0)], stairs=True)], [(10, 1e9)])
    step = (RIGHT - LEFT) / 4
    middle = (TOP + BOTTOM) / 2
    points = [tuple(map(float, p.split(","))) for p in plot.lines[0].points.split()]
    wanted = [(1, middle), (2, middle), (2, TOP), (2, TOP)]
    assert points == [(pytest.approx(LEFT + n * step, abs=0.06), height) for n, height in wanted]
    assert [tick.text for tick in plot.x_ticks] == ["0.1", "1", "10", "100", "1000"]
    (span,) = plot.spans
    assert span.x + span.width == pytest.approx(RIGHT, abs=0.06)


def test_what_lies_beyond_an_axis_is_drawn_at_its_edge() -> None:
    mark = Mark(0.0, 150.0, -5.0, math.inf, "")
    plot = curves("", Axis("", 0.0, 1.0), Axis("", 0.0, 100.0), [Curve("one", (), [mark])])
    (dot,) = plot.lines[0].dots
    assert (dot.y, dot.low, dot.high) == (TOP, BOTTOM, TOP)


def test_a_sheet_that_lacks_a_number_is_no_evaluation(tmp_path: Path) -> None:
    file = made(tmp_path / "toys.json")
    told = json.loads(file.read_bytes())
    del told["detectors"][0]["sheet"]["n_samples"]
    file.write_text(json.dumps(told))
    with pytest.raises(BadFile, match="n_samples"):
        evaluation_page(file)
