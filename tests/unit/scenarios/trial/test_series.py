"""Series of trials on one open rig: which are repeated, and where they begin."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from drivers.errors import Refused
from scenarios.lift.lift import Lift, lift
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial import series
from scenarios.trial.experiment import TrialContext
from scenarios.trial.final_state import FinalState
from scenarios.trial.result import Failure, JudgedTrial
from tests.unit.scenarios.conftest import config

OPEN = FinalState("the arm is stationary", "the hand is open", "", open=True)
STALE = Failure("stale", "stale: gripper status too old", "", OPEN)


class InstantOperator:
    """Places every object at once."""

    def __init__(self) -> None:
        self.prompts: list[str] = []

    def say(self, text: str) -> None:
        self.prompts.append(text.split(". Put", maxsplit=1)[0])

    def poll(self) -> str:
        return ""


@pytest.fixture(scope="module")
def lifted() -> JudgedTrial[Any]:
    return lift.run(config(), 0, None)


def run_two(
    lifted: JudgedTrial[Any], failures: list[Failure | None], patch: pytest.MonkeyPatch,
    raised_m: float = 0.0, ends: FinalState | None = None, fingers: int | None = None,
    placed: bool = False,
) -> "tuple[list[str], list[Any]]":  # fmt: skip
    """Prompts to the operator and homes of two trials with these failures. ``ends``: their final
    state; ``fingers``: position before, counts."""
    wired = msgspec.structs.replace(config(), rig="hardware")
    operator, homes, remaining_failures = InstantOperator(), list[Any](), iter(failures)

    @contextmanager
    def opened(*_: object) -> Iterator[GraspRig]:
        with open_rig(config(), 0, paced=False) as rig:
            state = rig.devices.arm.state
            assert state is not None
            x, y, z = state.position_m
            rig.devices.arm.move_to((x, y, z + raised_m), 0.1, 0.5)
            if fingers is not None:
                rig.devices.gripper.move_to((fingers, fingers, fingers), 0.1, 10.0)
            for _ in range(100):
                rig.wait_and_poll()
            yield rig

    class Scripted(Lift):
        def prepare(self, config: Any, *_: Any) -> Any:
            return config

        def run_on(self, rig: Any, used: Any, seed: int, context: Any, home: Any = None) -> Any:
            homes.append(home)
            failure = next(remaining_failures)
            return JudgedTrial(msgspec.structs.replace(lifted.result, end=ends), failure)

    def begins(number: int, of: int) -> None:
        assert placed or operator.prompts[-1].startswith(f"Trial {number} of {of}")

    with patch.context() as patched:
        patched.setattr(series, "open_rig", opened)
        context = TrialContext(operator=operator, on_trial=begins, placed=placed)
        list(series.run_series(Scripted(), wired, (0, 1), context))
    return operator.prompts, homes


def test_trial_that_leaves_a_closed_hand_ends_the_series_with_its_verdict(
    lifted: JudgedTrial[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = FinalState("the arm is stationary", "the hand is closed", "let go")
    prompts, _ = run_two(lifted, [None, None], monkeypatch, ends=closed)
    assert prompts == ["Trial 1 of 2"]
    prompts, _ = run_two(lifted, [None, None], monkeypatch, ends=OPEN)
    assert prompts == ["Trial 1 of 2", "Trial 2 of 2"]


def test_hand_that_is_not_open_is_refused_before_the_first_prompt(
    lifted: JudgedTrial[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(Refused, match=r"the hand is not open, at .* it may hold something"):
        run_two(lifted, [None, None], monkeypatch, fingers=120)


def test_trial_with_stale_device_data_is_repeated(
    lifted: JudgedTrial[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    prompts, homes = run_two(lifted, [STALE, None, None], monkeypatch)
    again = "Trial 1 of 2 again, because device data was stale or implausible"
    assert prompts == ["Trial 1 of 2", again, "Trial 2 of 2"]
    assert lifted.result is not None
    assert homes == [None, lifted.result.home_m, lifted.result.home_m]


def test_number_of_repetitions_is_limited(
    lifted: JudgedTrial[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    prompts, _ = run_two(lifted, [STALE] * 9, monkeypatch)
    assert len(prompts) == 1 + series.MAX_REPEATS


@pytest.mark.parametrize(
    "failure",
    [
        Failure("stale", "", "", msgspec.structs.replace(OPEN, open=False)),
        Failure(
            "implausible", "", "", msgspec.structs.replace(OPEN, unconfirmed=("the arm moves",))
        ),
        Failure("stale", "", ""),
        Failure("safety_stop", "", "", OPEN),
        Failure("link_lost", "", "", OPEN),
        Failure("interrupted", "", "", OPEN),
    ],
    ids=["hand closed", "arm not stationary", "unknown", "safety stop", "link lost", "stopped"],
)
def test_any_other_failure_ends_the_series(
    failure: Failure, lifted: JudgedTrial[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    prompts, _ = run_two(lifted, [failure], monkeypatch)
    assert prompts == ["Trial 1 of 2"]
