"""Trials on one open rig: which are asked for again, and where they begin."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from drivers.errors import Refused
from scenarios.lift.lift import lift
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial import series
from scenarios.trial.ending import End
from scenarios.trial.result import Failure, FinishedRun
from scenarios.trial.series import Begun, Bench
from tests.unit.scenarios.conftest import config

OPEN = End("the arm stands", "the hand is open", "", open=True)
STALE = Failure("stale", "stale: gripper status too old", "", OPEN)


class Person:
    """Puts every object in place at once."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def say(self, text: str) -> None:
        self.heard.append(text.split(". Put", maxsplit=1)[0])

    def poll(self) -> str:
        return ""


@pytest.fixture(scope="module")
def lifted() -> FinishedRun[Any]:
    return lift.run(config(), 0, None)


def told(
    lifted: FinishedRun[Any], failures: list[Failure | None], patch: pytest.MonkeyPatch,
    begun: Begun | None = None, raised_m: float = 0.0, ends: End | None = None,
    fingers: int | None = None, placed: bool = False,
) -> "tuple[list[str], list[Any]]":  # fmt: skip
    """What a person is asked when two trials end like this, and the homes that they begin from.
    ``ends``: how they left arm and hand; ``fingers``: where they stand before, counts."""
    wired = msgspec.structs.replace(config(), rig="hardware")
    person, homes, left = Person(), list[Any](), iter(failures)

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

    def attempt(seed: int, rig: GraspRig, home: Any) -> Any:
        homes.append(home)
        assert lifted.result is not None
        failure = next(left)
        result = msgspec.structs.replace(lifted.result, end=ends)
        return FinishedRun(result, failure), lifted.result.home_m

    def begins(number: int, of: int) -> None:
        assert placed or person.heard[-1].startswith(f"Trial {number} of {of}")

    with patch.context() as patched:
        patched.setattr(series, "open_rig", opened)
        bench = Bench(operator=person, begun=begun, on_trial=begins, placed=placed)
        list(series.run_series(wired, (0, 1), bench, attempt))
    return person.heard, homes


def test_trial_that_leaves_a_closed_hand_ends_the_series_with_its_verdict(
    lifted: FinishedRun[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = End("the arm stands", "the hand is closed", "let go")
    heard, _ = told(lifted, [None, None], monkeypatch, ends=closed)
    assert heard == ["Trial 1 of 2"]
    heard, _ = told(lifted, [None, None], monkeypatch, ends=OPEN)
    assert heard == ["Trial 1 of 2", "Trial 2 of 2"]


def test_hand_that_is_not_open_is_refused_before_anybody_is_asked(
    lifted: FinishedRun[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(Refused, match=r"the hand is not open, at .* it may hold something"):
        told(lifted, [None, None], monkeypatch, fingers=120)


def test_trial_in_which_a_device_was_not_heard_is_asked_for_again(
    lifted: FinishedRun[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    heard, homes = told(lifted, [STALE, None, None], monkeypatch)
    again = "Trial 1 of 2 again, for a device was not heard or not believed"
    assert heard == ["Trial 1 of 2", again, "Trial 2 of 2"]
    assert lifted.result is not None
    assert homes == [None, lifted.result.home_m, lifted.result.home_m]


def test_the_same_trial_is_not_asked_for_without_end(
    lifted: FinishedRun[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    heard, _ = told(lifted, [STALE] * 9, monkeypatch)
    assert len(heard) == 1 + series.MOST_AGAIN


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
    ids=["hand closed", "arm not seen to stand", "unknown", "its own end", "link lost", "stopped"],
)
def test_what_else_ends_a_trial_ends_the_series(
    failure: Failure, lifted: FinishedRun[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    heard, _ = told(lifted, [failure], monkeypatch)
    assert heard == ["Trial 1 of 2"]
