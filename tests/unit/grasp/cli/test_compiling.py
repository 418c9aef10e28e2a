"""Compilation at installation."""

import os

import pytest

from grasp.cli import compiling


def test_the_users_settings_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(compiling, "compile_simulation", lambda: seen.append(dict(os.environ)))
    monkeypatch.setenv("GRASP_CONFIG", "lab.toml")
    compiling.main()
    assert [environment.get("GRASP_CONFIG") for environment in seen] == [None]
