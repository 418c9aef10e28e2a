"""The trace of a run: whether and at which height the hand lost the object."""

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from grasp.control.states import State
from scenarios.trial.trace import Trace
from tests.unit.scenarios.safety_probes import HELD, ZERO

HELD_AT, LOST_AT = True, False


def of(*steps: tuple[State, bool, float]) -> Trace:
    """A trace of steps, each with phase, contact and height of the object."""
    trace = Trace()
    for phase, touched, height_m in steps:
        slip = SimpleNamespace(event=False)
        tick: Any = SimpleNamespace(
            decision=SimpleNamespace(state=phase, slip=slip),
            issued=(),
            observation=SimpleNamespace(reported=(), estimated_n=ZERO, frame=None),
        )
        normal_n = HELD.normal_n if touched else ZERO
        trace.add(tick, msgspec.structs.replace(HELD, normal_n=normal_n, height_m=height_m))
    return trace


def test_object_that_was_lost_briefly_and_held_again_counts_as_held() -> None:
    up = (State.LIFT, HELD_AT, 0.02), (State.LIFT, LOST_AT, 0.019), (State.LIFT, HELD_AT, 0.02)
    down = (State.HOLD, HELD_AT, 0.2), (State.DESCEND, HELD_AT, 0.1), (State.FEEL, HELD_AT, 0.001)
    run = of(*up, *down, (State.OPEN, LOST_AT, 0.0))
    assert run.lost_at_m == 0.001
    assert run.end is not None and run.end.height_m == 0.2


@pytest.mark.parametrize("phase", [State.DESCEND, State.FEEL, State.OPEN, State.FAULT])
def test_height_of_a_loss_after_the_top_is_recorded(phase: State) -> None:
    run = of((State.HOLD, HELD_AT, 0.2), (phase, HELD_AT, 0.11), (phase, LOST_AT, 0.1))
    assert run.lost_at_m == 0.11
