"""The Python API of `import grasp`: light, typed, frozen, and without access to real devices."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasp
from drivers.errors import ConfigError, GraspError, UsageError
from scenarios.library.results import Lift

ROOT = Path(__file__).parents[4]


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
    start = "import sys; before = set(sys.modules)"  # with what a distribution adds to Python
    program = f"{start}; import grasp; grasp.__all__; dir(grasp); print(*set(sys.modules) - before)"
    foreign = {name.split(".")[0] for name in fresh(program)} - set(sys.stdlib_module_names)
    assert {name for name in foreign if not name.startswith("_")} == {"grasp"}


def test_a_lift_is_typed_and_has_a_row_for_every_step(lift: Lift) -> None:
    n = len(lift.t_s)
    assert lift.result.success is True
    assert lift.failure is None
    assert np.allclose(np.diff(lift.t_s), 0.01)
    assert lift.probabilities.shape == lift.estimated_force_n.shape == (n, 3)
    assert lift.counts.shape == (n, 3, 6)
    assert lift.true_force_n is not None and lift.slip_m is not None
    assert 0.0 < (lift.result.slip_distance_m or 0.0) <= np.nanmax(lift.slip_m)
    assert repr(lift).startswith("<Lift in /") and len(repr(lift)) < 400
    assert lift.registered.any()


def test_result_cannot_be_changed(lift: Lift) -> None:
    with pytest.raises(AttributeError):
        lift.failure = None  # type: ignore[misc]
    for array in (lift.t_s, lift.counts, lift.registered, lift.true_force_n, lift.slip_m):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_replay_reports_whether_all_is_as_recorded(lift: Lift) -> None:
    again = grasp.replay(lift.folder)
    assert again.same  # type: ignore[union-attr]
    assert "as recorded" in again._repr_html_()
    with pytest.raises(UsageError, match="recorded with"):
        grasp.replay(lift.folder, settings={"rule.threshold": 0.9})


# No access to a real device


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1},
        {"seed": "x"},
        {"seed": True},
        {"object": 3},
        {"detector": 5},
        {"settings": 5},
        {"rig": "sim"},
        {"runs": 5},
        {"config": 5},
        {"config": [5]},
        {"rig": None},
        {"profile": None},
        {"seed": 2**70},
        {"settings": [1]},
    ],
)
def test_wrong_arguments_raise_an_error_of_the_project(wrong: dict[str, Any]) -> None:
    ((name, value),) = wrong.items()
    with pytest.raises(GraspError) as error:
        grasp.lift(**wrong)
    assert name in error.value.message and str(value).strip("[]") in error.value.message
    if name not in ("object", "seed", "runs"):
        with pytest.raises(GraspError, match=re.escape(error.value.message)):
            grasp.reflex(**wrong)
    assert error.value.__notes__ == [f"remedy: {error.value.remedy}"]


def test_wrong_arguments_of_a_detector_are_named(tmp_path: Path) -> None:
    for wrong in ({"name": 5}, {"fingers": "x"}, {"fingers": -1}, {"taxels": 2.5}):
        with pytest.raises(UsageError, match=f": {next(iter(wrong.values()))!r} is n"):
            grasp.detector(**{"name": "energy", **wrong})
    with pytest.raises(UsageError, match="detector: 5 is neither"):
        grasp.replay(tmp_path / "fingertip.csv", detector=5)  # type: ignore[arg-type]


def test_an_empty_name_is_refused() -> None:
    for wrong in ({"runs": ""}, {"config": ""}, {"profile": ""}):
        with pytest.raises(UsageError, match=f"{next(iter(wrong))}: '' is neither"):
            grasp.lift(detector="energy", **wrong)


def test_a_wrong_setting_is_named_by_the_argument_and_not_by_the_option() -> None:
    for call in (grasp.lift, lambda settings: grasp.detector("tcn", settings=settings)):
        for wrong in ({1: 2}, {"object.mass_kg": object()}):
            with pytest.raises(UsageError, match="settings: "):
                call(settings=wrong)
        with pytest.raises(ConfigError, match=r"^settings: guard\.force_limit_n: ") as error:
            call(settings={"guard.force_limit_n": "x"})
        with pytest.raises(ConfigError, match=r"^settings: guard\.force_limit_n: "):
            call(settings={"guard": {"force_limit_n": "x"}})
        assert "--set" not in f"{error.value} {error.value.remedy}"
