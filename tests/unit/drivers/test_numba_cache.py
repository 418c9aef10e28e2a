"""Compiled functions whose kept files were damaged."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SOURCE = """
from drivers.numba_cache import compiled

@compiled()
def twice(x):
    return 2 * x

@compiled(fastmath=True)
def three_times(x):
    return 3 * x
"""


def program(folder: Path) -> Any:
    """The module as a new process would import it."""
    path = folder / "program.py"
    if not path.exists():
        path.write_text(SOURCE)
    spec = importlib.util.spec_from_file_location("program", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert (module.twice(4), module.three_times(4)) == (8, 12)
    return module


def hits(module: Any) -> list[int]:
    return [sum(f.stats.cache_hits.values()) for f in (module.twice, module.three_times)]


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
@pytest.mark.parametrize(
    "damaged",
    [lambda b: b"", lambda b: b[: len(b) // 2], lambda b: b[:-1], lambda b: b"\0" * len(b)],
)  # fmt: skip
def test_a_function_whose_file_was_damaged_is_compiled_again_and_named(
    ending: str, damaged: Callable[[bytes], bytes], tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert hits(program(tmp_path)) == [0, 0]
    assert hits(program(tmp_path)) == [1, 1] and capsys.readouterr().err == ""
    for file in tmp_path.rglob(f"*{ending}"):
        file.write_bytes(damaged(file.read_bytes()))
    assert hits(program(tmp_path)) == [0, 0]
    assert capsys.readouterr().err.splitlines() == [
        f"grasp: {name}: damaged file, compiled again" for name in ("twice", "three_times")
    ]
    assert hits(program(tmp_path)) == [1, 1] and capsys.readouterr().err == ""
