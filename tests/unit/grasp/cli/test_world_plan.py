"""`grasp world plan` and the verbs of the physics charts."""

import json
from pathlib import Path
from typing import Any

import pytest

from grasp.cli import exits, physics
from grasp.cli.main import main


def test_plan_explains_its_choice_in_a_few_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "plan", "tap", "--object", "box", "--tolerance", "1mm"]) == exits.SUCCESS
    lines = capsys.readouterr().out.splitlines()
    assert 3 <= len(lines) <= 7
    assert any(line.startswith("choice: L") for line in lines)


def test_plan_says_how_exactly_it_was_asked_and_when_it_cannot_be_had(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["world", "plan", "tap", "--tolerance", "0.5mm", "--rotation", "2deg"]) == 0
    out = capsys.readouterr().out
    assert "asked within 0.5 mm, 2 deg" in out
    assert "NOT KEPT" not in out
    assert main(["world", "plan", "tap", "--tolerance", "0.000001um"]) == 0
    assert "TOLERANCE NOT KEPT" in capsys.readouterr().out


def test_plan_of_a_lift_that_drops_the_object_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "plan", "lift", "--object", "ball"]) == exits.SUCCESS
    assert "the object is lost: slip" in capsys.readouterr().out
    assert main(["world", "plan", "lift", "--object", "can"]) == exits.SUCCESS
    assert "lost" not in capsys.readouterr().out


def test_plan_as_json_has_the_choice_and_the_explanation(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["world", "plan", "lift", "--tolerance", "0.5mm", "--rotation", "2deg", "--json"]
    assert main(words) == exits.SUCCESS
    found = json.loads(capsys.readouterr().out)
    assert found["answer"]["level"] == 1
    assert found["tolerance"]["rotation_rad"] == pytest.approx(0.0349, abs=1e-4)
    assert found["explanation"]


@pytest.mark.parametrize(
    "words",
    [["--tolerance", "1 mile"], ["--tolerance", "1"], ["--tolerance", "-1mm"],
     ["--tolerance", "nan"], ["--rotation", "2"], ["--rotation", "3mm"],
     ["--object", "no-such-thing"], ["--set", "scene.aside_m=7"]],
)  # fmt: skip
def test_plan_refuses_what_it_cannot_read(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["world", "plan", "lift", *words]) == exits.USAGE
    assert capsys.readouterr().err.startswith("grasp: ")


@pytest.mark.parametrize("error", [
    RuntimeError("cannot cache function 'f': no locator available for file 'laws.py'"), EOFError(),
])  # fmt: skip
def test_compiled_functions_that_can_be_kept_nowhere_are_told_with_what_to_do(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = "/usr/lib/python3/site-packages/numba/core/caching.py"
    scope: dict[str, Any] = {"error": error}
    exec(compile("def fails(args): raise error", file, "exec"), scope)
    monkeypatch.setattr(physics, "show_plan", scope["fails"])
    assert main(["world", "plan", "tap"]) == exits.USAGE
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err


def test_a_blow_is_named_as_in_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["world", "plan", "tap", "--object", "foam", "--tolerance", "0.2mm"]
    assert main([*words, "--direction", "side"]) == exits.SUCCESS
    side = capsys.readouterr().out
    assert "a side load" in side
    assert main([*words, "--set", "scene.direction=side"]) == exits.SUCCESS
    assert capsys.readouterr().out == side
    assert main([*words, "--direction", "top"]) == exits.SUCCESS
    assert capsys.readouterr().out != side


def test_blow_along_the_closing_axis_is_planned_for_the_peak_force_that_it_ends_in(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["world", "plan", "tap", "--direction", "closing", "--json"]
    assert main([*words, "--force", "0.2N"]) == exits.SUCCESS
    exact = json.loads(capsys.readouterr().out)["answer"]
    assert main(words) == exits.SUCCESS
    rough = json.loads(capsys.readouterr().out)["answer"]
    assert 15.0 < exact["peak_force_n"] < 30.0
    assert exact["step_s"] < rough["step_s"]


@pytest.mark.parametrize(
    ("words", "said"),
    [(["side-tap"], "tap --direction side"), (["nap"], "one of lift, tap, hold"),
     (["tap", "--direction", "under"], "'top', 'side'"),
     (["lift", "--direction", "side"], "leave it out")],
)  # fmt: skip
def test_plan_refuses_other_names_with_the_right_ones(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["world", "plan", *words]) == exits.USAGE
    assert said in capsys.readouterr().err


def test_check_runs_the_detector_of_every_run_and_names_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from scenarios.studies.physics import levels

    asked: list[object] = []
    monkeypatch.setattr(levels, "check", lambda *told: asked.append(told[2]) or iter(()))
    monkeypatch.setattr(levels, "table", lambda draws: "table")
    assert main(["world", "check", "--draws", "2"]) == exits.SUCCESS
    assert main(["world", "check", "--draws", "2", "--detector", "energy"]) == exits.SUCCESS
    assert asked == ["tcn", "energy"]
    assert capsys.readouterr().out.startswith("detector tcn\n")
    assert main(["world", "check", "--draws", "2", "--detector", "ear"]) == exits.USAGE
    assert len(asked) == 2


def test_plan_takes_the_object_of_a_file_that_runs_take(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "flask.toml"
    file.write_text('[object]\ncentre_aside_m = 0.009\n[tap]\ndirection = "side"\n')
    assert main(["world", "plan", "lift"]) == exits.SUCCESS
    plain = capsys.readouterr().out
    assert main(["world", "plan", "lift", "--config", str(file)]) == exits.SUCCESS
    own = capsys.readouterr().out
    assert "a lever" in own and "a lever" not in plain
    assert main(["world", "plan", "lift", "--set", "object.centre_aside_m=0.009"]) == 0
    assert capsys.readouterr().out == own
