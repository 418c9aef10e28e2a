"""Arbitrary sequences of alarms on the full loop: every run ends in time, no object is dropped."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp.control.commands import CloseToLimit
from grasp.control.controller import GraspController
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.rigs.rig import Rig
from tests.unit.scenarios.conftest import QUIET as CALM
from tests.unit.scenarios.conftest import Staged, in_phase
from tests.unit.scenarios.lift.device_faults import cell

Probabilities = tuple[float, float, float]  # of each finger
# longest time of each phase: approach and grasp without alarms; 0.1 m up and down, after slip at
# the top all of it at feel speed, and two checks for the table (1.1 s each); the hold with alarms
LONGEST_S = {
    State.SHAPE: 1.0, State.TARE: 1.0, State.BRACE: 1.5, State.CLOSE: 2.0, State.SETTLE: 0.5,
    State.BASELINE: 0.5, State.SET_DOWN: 0.1,
    State.LIFT: 3.0, State.COMPENSATE: 2.5, State.HOLD: 3.0, State.DESCEND: 5.0, State.FEEL: 23.2,
    State.OPEN: 2.0,
    State.RETREAT: 3.0, State.LOST: 3.1, State.FAULT: 3.1,
}  # fmt: skip
SETTINGS = ("hand.activation_s=0.5", "controller.lift_height_m=0.1", "controller.hold_s=0.3")


class ScriptedDetector:
    """A detector that repeats a script of probabilities, frame by frame."""

    def __init__(self, script: list[tuple[int, Probabilities]]) -> None:
        self._script = np.concatenate([np.tile(p, (n, 1)) for n, p in script])
        self._frame = 0

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        p: NDArray[np.float64] = self._script[self._frame % len(self._script)]
        self._frame += 1
        return p


def run(
    script: list[tuple[int, Probabilities]], *settings: str, object_name: str = "can",
    detector: str | None = "energy",
) -> tuple[GraspController, list[Tick], bool]:  # fmt: skip
    """Run a lift with scripted probabilities from the baseline on.

    Returns the finished controller, its ticks, and whether the object was never dropped.
    ``detector``: whose rule gets the script; None: the default's."""

    def made(*values: str) -> LiftConfig:
        return load_config(object_name, "simulated", detector, None, (CALM, *values)).for_lift()

    def start_script(rig: Rig) -> None:
        staged.loop._step._detector = ScriptedDetector(script)  # noqa: SLF001

    staged = Staged(*SETTINGS, *settings, made=made)
    controller = staged.run(in_phase(State.BASELINE, 1), start_script).controller
    truth = cell(staged.rig).truth()
    return controller, staged.ticks, truth.touched or controller.state is State.SET_DOWN


P = st.sampled_from([0.0, 0.3, 1.0])
SCRIPT = st.lists(
    st.tuples(st.integers(1, 80), st.tuples(P, P, P)), min_size=1, max_size=8
)  # fmt: skip


STEPS = "controller.slip_response=stop_and_step"


@pytest.mark.parametrize(
    ("assignments", "detector"),
    [((STEPS, "controller.hold_by_clock=true"), "energy"), ((), None)],
)  # fmt: skip
@settings(max_examples=5)
@given(script=SCRIPT)
def test_every_phase_ends_in_time_for_any_output_of_the_detector(
    assignments: tuple[str, ...], detector: str | None, script: list[tuple[int, Probabilities]]
) -> None:
    controller, ticks, held = run(script, *assignments, detector=detector)
    assert controller.finished, controller.state
    assert held
    assert closes(ticks) <= 1
    assert response_s(ticks) < 10.0
    longest = {t.decision.state: 0 for t in ticks}
    steps_in_phase, before = 0, None
    for tick in ticks:
        steps_in_phase = steps_in_phase + 1 if tick.decision.state is before else 1
        before = tick.decision.state
        longest[before] = max(longest[before], steps_in_phase)
    for phase, steps in longest.items():
        assert steps * 0.01 <= LONGEST_S[phase], phase


def closes(ticks: list[Tick]) -> int:
    """Number of closings to the force limit; a first stage counts with its second."""
    sent = [i.admitted for t in ticks for i in t.issued if isinstance(i.admitted, CloseToLimit)]
    assert sum(c.first_stage for c in sent) <= sum(not c.first_stage for c in sent)
    return sum(not c.first_stage for c in sent)


def response_s(ticks: list[Tick]) -> float:
    """Time from the first registered slip to lowering, or to the end of the run, s."""
    began_ns = next((t.t_ns for t in ticks if t.decision.slip.event), ticks[-1].t_ns)
    down_ns = next((t.t_ns for t in ticks if t.decision.state is State.DESCEND), ticks[-1].t_ns)
    return (down_ns - began_ns) * 1e-9
