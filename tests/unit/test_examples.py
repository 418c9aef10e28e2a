"""Every script and notebook of `examples` runs unchanged, from any folder."""

import json
import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
TRAINING = EXAMPLES / "train_ppo.py"  # needs torch, and minutes
SCRIPTS = sorted({*EXAMPLES.glob("*.py")} - {TRAINING})
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
MOST_LINES = 40


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_example_scripts_run_and_print(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert len(script.read_text().splitlines()) <= MOST_LINES
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    out, err = capsys.readouterr()
    assert out and err == ""


@pytest.mark.train
def test_the_training_example_trains_and_compares(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", [str(TRAINING), "--decisions", "1", "--episodes", "1"])
    runpy.run_path(str(TRAINING), run_name="__main__")
    out, _ = capsys.readouterr()
    assert out.count("held") == 4 and "careless policy: held 0%" in out


def run_notebook(path: Path) -> list[Any]:
    """Run a notebook; returns the output of each cell's last expression."""
    import ast

    names: dict[str, Any] = {"__name__": "__main__"}
    shown = []
    for cell in json.loads(path.read_text())["cells"]:
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, path.name, "exec"), names)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), path.name, "eval"), names))
    return shown


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_example_notebooks_run_and_show_verdicts(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert json.loads(path.read_text())["nbformat"] == 4
    shown = run_notebook(path)
    shown_html = [value._repr_html_() for value in shown if hasattr(value, "_repr_html_")]
    assert any("held" in picture for picture in shown_html)
    assert not any("<script" in picture or "http" in picture for picture in shown_html)
