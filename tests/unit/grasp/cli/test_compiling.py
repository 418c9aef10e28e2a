"""Compilation at installation."""

import os

import pytest
from numba.core import event

from grasp.cli import compiling
from scenarios.rigs.compilation import tell_of_compilation
from scenarios.world import laws


def test_the_users_settings_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(compiling, "compile_simulation", lambda: seen.append(dict(os.environ)))
    monkeypatch.setenv("GRASP_CONFIG", "lab.toml")
    compiling.main()
    assert [environment.get("GRASP_CONFIG") for environment in seen] == [None]


def test_progress_is_one_line_in_two_seconds() -> None:
    said: list[str] = []
    with tell_of_compilation(said.append):
        for function in (laws.advance, laws.advance):
            data = {"dispatcher": function}
            event.start_event("numba:compile", data)
            event.end_event("numba:compile", data)
    assert len(said) == 1
    assert ": 1 of " in said[0]
