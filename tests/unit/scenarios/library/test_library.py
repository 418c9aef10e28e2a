"""`import grasp` as a library: light, typed, frozen, and no way to a real device."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasp
from drivers.errors import ConfigError, UsageError
from scenarios.library.html import picture, table
from scenarios.library.results import Lift
from scenarios.rigs import opening as hardware_room

ROOT = Path(__file__).parents[4]
LAB = {
    "gripper.calibration": "paper", "modbus.host": "127.0.0.99", "modbus.port": 9,
    "usb.url": "tcp://127.0.0.99:9", "ur.host": "127.0.0.99",
}  # fmt: skip


@pytest.fixture(scope="module")
def lift() -> Lift:
    return grasp.lift(object="can", detector="energy", seed=3)


def fresh(program: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    return done.stdout.split()


def test_importing_it_loads_nothing_outside_the_standard_library() -> None:
    program = "import sys, grasp; grasp.__all__; dir(grasp); print(*sys.modules)"
    foreign = {name.split(".")[0] for name in fresh(program)} - set(sys.stdlib_module_names)
    assert {name for name in foreign if not name.startswith("_")} == {"grasp"}


def test_its_names_are_there_when_they_are_asked_for() -> None:
    program = "import grasp; print(*sorted(grasp.__all__)); print(callable(grasp.lift))"
    assert fresh(program) == ["campaign", "detector", "lift", "replay", "tap", "True"]
    with pytest.raises(AttributeError, match="no attribute 'squeeze'"):
        getattr(grasp, "squeeze")  # noqa: B009


def test_a_lift_is_typed_and_has_a_row_for_every_step(lift: Lift) -> None:
    n = len(lift.t_s)
    assert lift.result.success is True
    assert lift.failure is None
    assert np.allclose(np.diff(lift.t_s), 0.01)
    assert lift.probabilities.shape == lift.felt_force_n.shape == (n, 3)
    assert lift.counts.shape == (n, 3, 6)
    assert lift.true_force_n is not None and lift.slip_m is not None
    assert 0.0 < (lift.result.slip_distance_m or 0.0) <= np.nanmax(lift.slip_m)
    assert repr(lift).startswith("<Lift in /") and len(repr(lift)) < 400
    assert lift.registered.any()


def test_nothing_of_a_result_can_be_changed(lift: Lift) -> None:
    with pytest.raises(AttributeError):
        lift.failure = None  # type: ignore[misc]
    for array in (lift.t_s, lift.counts, lift.registered, lift.true_force_n, lift.slip_m):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_settings_are_those_of_the_command_line(tmp_path: Path) -> None:
    file = tmp_path / "heavy.toml"
    file.write_text("[object]\nmass_kg = 0.25\n")
    lift = grasp.lift(detector="energy", config=file, settings={"controller.lift_speed_mps": 0.1})
    assert lift.record.settings["object"]["mass_kg"] == 0.25
    assert lift.record.settings["controller"]["lift_speed_mps"] == 0.1
    with pytest.raises(ConfigError, match="did you mean"):
        grasp.lift(settings={"object.mass": 1})
    with pytest.raises(ConfigError, match="unknown"):
        grasp.lift(object="elephant")


def test_what_a_notebook_shows_is_escaped_and_has_gaps_where_nothing_is_known() -> None:
    assert "<b>" not in table("<b>", ("<b>",), [("<b>",)])
    values = np.array([[0.0] * 3, [np.nan] * 3, [1.0] * 3, [1.0] * 3])
    drawn = picture("<b>", np.arange(4.0), values, 0.5, 1.0)
    assert "<b>" not in drawn
    assert "nan" not in drawn
    assert drawn.count("M") == 6


def test_a_replay_says_whether_all_is_as_recorded(lift: Lift) -> None:
    again = grasp.replay(lift.folder)
    assert again.same  # type: ignore[union-attr]
    assert "as recorded" in again._repr_html_()
    with pytest.raises(UsageError, match="recorded with"):
        grasp.replay(lift.folder, settings={"rule.threshold": 0.9})


def test_a_campaign_gives_rows_and_columns(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text('name = "c"\nobjects = ["can"]\ndetectors = ["energy"]\nrepetitions = 2\n')
    done = grasp.campaign(file, jobs=0)
    assert [row.status for row in done.rows] == ["done", "done"]
    assert done.column("slip_distance_m").shape == (2,)
    assert done.column("outcome").dtype.kind == "U"
    assert done.column("moved").dtype == np.float64
    assert "2 of 2" in done._repr_html_()
    assert done.file is None
    kept = grasp.campaign(file, jobs=0, out=tmp_path / "c.sqlite")
    assert kept.file == tmp_path / "c.sqlite"


# No way to a real device


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    found: list[str] = []

    def wired_devices(config: Any, clock: Any) -> Any:
        found.append(config.rig)
        raise AssertionError("real devices were opened")

    monkeypatch.setattr(hardware_room, "wired_devices", wired_devices)
    return found


@pytest.mark.parametrize("call", [grasp.lift, grasp.tap])
def test_no_call_opens_a_real_device(call: Any, opened: list[str], tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="moves no real devices"):
        call(rig="hardware", settings=LAB, runs=tmp_path)
    with pytest.raises(ConfigError, match="is no setting"):
        call(settings={**LAB, "rig": "hardware"}, runs=tmp_path)
    with pytest.raises(TypeError):
        call(rig="hardware", settings=LAB, permit=object())
    assert opened == []
    assert list(tmp_path.iterdir()) == []
