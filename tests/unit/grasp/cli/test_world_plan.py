"""`grasp world plan` and the verbs of the physics charts."""

import json
from typing import Any

import pytest

from grasp.cli import exits, physics
from grasp.cli.main import main


def test_plan_explains_its_choice_in_a_few_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "plan", "tap", "--object", "box", "--tolerance", "1mm"]) == exits.SUCCESS
    lines = capsys.readouterr().out.splitlines()
    assert 3 <= len(lines) <= 7
    assert any(line.startswith("choice: L") for line in lines)


def test_plan_as_json_has_the_choice_and_the_explanation(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["world", "plan", "lift", "--tolerance", "0.5mm", "--rotation", "2deg", "--json"]
    assert main(words) == exits.SUCCESS
    found = json.loads(capsys.readouterr().out)
    assert found["answer"]["level"] == 1
    assert found["tolerance"]["rotation_rad"] == pytest.approx(0.0349, abs=1e-4)
    assert found["explanation"]


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
