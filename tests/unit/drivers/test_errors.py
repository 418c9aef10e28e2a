"""Expected errors: one line, one remedy, and the same in another process."""

import ast
import builtins
import pickle
from pathlib import Path

import pytest

from drivers import errors
from drivers.errors import (
    BadFile,
    ConfigError,
    CouldNotRecord,
    DeviceFault,
    GraspError,
    LinkLost,
    Refused,
    Stale,
    UsageError,
)

PLAIN = (LinkLost, DeviceFault, Refused, Stale, UsageError, CouldNotRecord)


@pytest.mark.parametrize(
    "error",
    [
        *(kind("what happened", "what to do") for kind in PLAIN),
        BadFile("file.csv", "has no column p5", "another file", 1),
        ConfigError("file.toml", "section.key", "too high", "0 to 1"),
    ],
)
def test_an_error_survives_another_process(error: GraspError) -> None:
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert (str(back), back.message, back.remedy) == (str(error), error.message, error.remedy)
    assert "what to do" not in str(back)


def test_all_errors_stand_in_one_file_but_what_models_and_emulators_signal_within() -> None:
    root = Path(__file__).parents[3]
    known = {**vars(builtins), **vars(errors)}
    bases = {
        name
        for name, kind in known.items()
        if isinstance(kind, type) and issubclass(kind, Exception)  # a signal is no error
    }
    strays = [
        f"{path.relative_to(root)}: {node.name}"
        for package in ("grasp", "drivers", "detector", "scenarios")
        for path in (root / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and any(isinstance(base, ast.Name) and base.id in bases for base in node.bases)
        and path != root / "drivers" / "errors.py"
        and not {"model", "emulator"} & {*path.parts, path.stem}
    ]
    assert strays == []
