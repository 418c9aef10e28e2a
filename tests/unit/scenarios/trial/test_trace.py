"""What is kept of a run to judge it by: when the hand lost the object, and where."""

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from grasp.states import State
from scenarios.trial.trace import Trace
from tests.unit.scenarios.safety_probes import HELD, ZERO

HELD_AT, LOST_AT = True, False


def of(*steps: tuple[State, bool, float]) -> Trace:
    """A run of phase, whether the hand touches the object, and its height."""
    trace = Trace()
    for phase, touched, height_m in steps:
        slip = SimpleNamespace(event=False)
        tick: Any = SimpleNamespace(
            decision=SimpleNamespace(state=phase, slip=slip),
            issued=(),
            observation=SimpleNamespace(reported=()),
            measured_n=ZERO,
            frame=None,
        )
        normal_n = HELD.normal_n if touched else ZERO
        trace.add(tick, msgspec.structs.replace(HELD, normal_n=normal_n, height_m=height_m))
    return trace


def test_an_object_that_slid_for_a_moment_and_was_held_again_was_not_let_go() -> None:
    up = (State.LIFT, HELD_AT, 0.02), (State.LIFT, LOST_AT, 0.019), (State.LIFT, HELD_AT, 0.02)
    down = (State.HOLD, HELD_AT, 0.2), (State.DESCEND, HELD_AT, 0.1), (State.FEEL, HELD_AT, 0.001)
    run = of(*up, *down, (State.OPEN, LOST_AT, 0.0))
    assert run.lost_at_m == 0.001
    assert run.end is not None and run.end.height_m == 0.2


@pytest.mark.parametrize("phase", [State.DESCEND, State.FEEL, State.OPEN, State.FAULT])
def test_an_object_is_let_go_from_where_the_hand_loses_it_after_the_top(phase: State) -> None:
    run = of((State.HOLD, HELD_AT, 0.2), (phase, HELD_AT, 0.11), (phase, LOST_AT, 0.1))
    assert run.lost_at_m == 0.11
