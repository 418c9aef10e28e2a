"""What is kept of a run to judge it by: when the hand lost the object, and where."""

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from grasp.phases import Phase
from scenarios.trial.trace import Trace
from tests.unit.scenarios.safety_probes import HELD, ZERO

HELD_AT, LOST_AT = True, False


def of(*steps: tuple[Phase, bool, float]) -> Trace:
    """A run of phase, whether the hand touches the object, and its height."""
    trace = Trace()
    for phase, touched, height_m in steps:
        slip = SimpleNamespace(event=False)
        tick: Any = SimpleNamespace(
            decision=SimpleNamespace(phase=phase, slip=slip),
            issued=(),
            observation=SimpleNamespace(reported=()),
            measured_n=ZERO,
            frame=None,
        )
        normal_n = HELD.normal_n if touched else ZERO
        trace.add(tick, msgspec.structs.replace(HELD, normal_n=normal_n, height_m=height_m))
    return trace


def test_an_object_that_slid_for_a_moment_and_was_held_again_was_not_let_go() -> None:
    up = (Phase.LIFT, HELD_AT, 0.02), (Phase.LIFT, LOST_AT, 0.019), (Phase.LIFT, HELD_AT, 0.02)
    down = (Phase.HOLD, HELD_AT, 0.2), (Phase.LOWER, HELD_AT, 0.1), (Phase.PROBE, HELD_AT, 0.001)
    run = of(*up, *down, (Phase.RELEASE, LOST_AT, 0.0))
    assert run.let_go_m == 0.001
    assert run.end is not None and run.end.height_m == 0.2


@pytest.mark.parametrize("phase", [Phase.LOWER, Phase.TOUCH, Phase.RELEASE, Phase.FAULT])
def test_an_object_is_let_go_from_where_the_hand_loses_it_after_the_top(phase: Phase) -> None:
    run = of((Phase.HOLD, HELD_AT, 0.2), (phase, HELD_AT, 0.11), (phase, LOST_AT, 0.1))
    assert run.let_go_m == 0.11
