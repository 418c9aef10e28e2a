"""Any sequence of alarms, on the full loop: every run ends in its time, nothing held is dropped."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp.commands import CloseFast
from grasp.controller import GraspController
from grasp.loop import Tick
from grasp.states import State
from scenarios.campaign.config import load_config
from scenarios.lift.lift import LiftConfig
from scenarios.rigs.rig import Rig
from tests.unit.scenarios.conftest import QUIET as CALM
from tests.unit.scenarios.conftest import Staged, in_phase
from tests.unit.scenarios.lift.device_faults import cell

Said = tuple[float, float, float]  # a probability a finger
ALARM, QUIET = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
EVERYWHERE = (1.0, 1.0, 1.0)  # the rule of the default detector wants more than one finger
# stated time of every phase of a run: to the object and its grip, which hear no alarm; 0.1 m up and
# down, all of that at the speed of a landing where slip ended at the top, and one step that tells
# whether the object stands (1.1 s); the hold with its alarms, patience at each end
LONGEST_S = {
    State.SHAPE: 1.0, State.TARE: 1.0, State.BRACE: 1.5, State.CLOSE: 2.0, State.SETTLE: 0.5,
    State.BASELINE: 0.5, State.SET_DOWN: 0.1,
    State.LIFT: 3.0, State.COMPENSATE: 2.5, State.HOLD: 3.0, State.DESCEND: 5.0, State.FEEL: 22.0,
    State.OPEN: 2.0,
    State.RETREAT: 3.0, State.LOST: 3.1, State.FAULT: 3.1,
}  # fmt: skip
SETTINGS = ("hand.activation_s=0.5", "controller.lift_height_m=0.1", "controller.hold_s=0.3")


class Told:
    """A detector that says what it is told, frame by frame, over and over."""

    def __init__(self, script: list[tuple[int, Said]]) -> None:
        self._said = np.concatenate([np.tile(p, (n, 1)) for n, p in script])
        self._frame = 0

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        p: NDArray[np.float64] = self._said[self._frame % len(self._said)]
        self._frame += 1
        return p


def run(
    script: list[tuple[int, Said]], *words: str, object_name: str = "can",
    detector: str | None = "energy",
) -> tuple[GraspController, list[Tick], bool]:  # fmt: skip
    """Controller at its end, its ticks, and whether the object was held all the time in the air.
    From the start of the lift on: no alarm counts before it.
    ``detector``: whose rule gets the script; None: that of the default."""

    def made(*told: str) -> LiftConfig:
        return load_config(object_name, "simulated", detector, None, (CALM, *told)).for_lift()

    def hear(rig: Rig) -> None:
        staged.loop._step._detector = Told(script)  # noqa: SLF001

    staged = Staged(*SETTINGS, *words, made=made)
    controller = staged.run(in_phase(State.BASELINE, 1), hear).controller
    truth = cell(staged.rig).truth()
    return controller, staged.ticks, truth.touched or controller.state is State.SET_DOWN


P = st.sampled_from([0.0, 0.3, 1.0])
SCRIPT = st.lists(
    st.tuples(st.integers(1, 80), st.tuples(P, P, P)), min_size=1, max_size=8
)  # fmt: skip


STEPS = "controller.slip_response=stop_and_step"


@pytest.mark.parametrize(
    ("words", "detector"),
    [((STEPS, "controller.hold_by_clock=true"), "energy"), ((), None)],
)  # fmt: skip
@settings(max_examples=5)
@given(script=SCRIPT)
def test_every_phase_ends_in_its_time_whatever_the_detector_says(
    words: tuple[str, ...], detector: str | None, script: list[tuple[int, Said]]
) -> None:
    controller, ticks, held = run(script, *words, detector=detector)
    assert controller.finished, controller.state
    assert held
    assert closes(ticks) <= 1
    assert answered_s(ticks) < 10.0
    begun = {t.decision.state: 0 for t in ticks}
    stretch, before = 0, None
    for tick in ticks:
        stretch = stretch + 1 if tick.decision.state is before else 1
        before = tick.decision.state
        begun[before] = max(begun[before], stretch)
    for phase, steps in begun.items():
        assert steps * 0.01 <= LONGEST_S[phase], phase


def closes(ticks: list[Tick]) -> int:
    """To the force cap: a first stage belongs to the one that follows."""
    sent = [i.admitted for t in ticks for i in t.issued if isinstance(i.admitted, CloseFast)]
    assert sum(c.first_stage for c in sent) <= sum(not c.first_stage for c in sent)
    return sum(not c.first_stage for c in sent)


def answered_s(ticks: list[Tick]) -> float:
    """From the first alarm that was registered to the way down, or to the run's end."""
    began_ns = next((t.t_ns for t in ticks if t.decision.slip.event), ticks[-1].t_ns)
    down_ns = next((t.t_ns for t in ticks if t.decision.state is State.DESCEND), ticks[-1].t_ns)
    return (down_ns - began_ns) * 1e-9


PATTERNS = [
    ("stop_and_close", "foam", "energy", 4, 46), ("stop_and_step", "can", "energy", 2, 10),
    ("stop_and_close", "can", None, 6, 3), ("stop_and_step", "foam", None, 30, 10),
]  # fmt: skip


@pytest.mark.parametrize(("answer", "name", "detector", "loud", "silent"), PATTERNS)
def test_alarms_that_come_and_go_are_answered_while_force_can_rise_and_end_in_ten_seconds(
    answer: str, name: str, detector: str | None, loud: int, silent: int
) -> None:
    script = [(loud, EVERYWHERE), (silent, QUIET)]
    words = (f"controller.slip_response={answer}", "controller.hold_s=1.0")
    controller, ticks, held = run(script, *words, object_name=name, detector=detector)
    assert held
    assert controller.response.closings > 0
    assert closes(ticks) <= 1
    assert answered_s(ticks) < 10.0
    steps = 0 if answer == "stop_and_close" else 5  # stop_and_step.MAX_STEPS
    assert controller.response.closings <= 1 + steps  # and to the cap at last


@pytest.mark.parametrize("answer", ["stop_and_close", "stop_and_step"])
def test_alarm_that_never_ends_is_borne_by_the_clock_though_commands_take_their_time(
    answer: str,
) -> None:
    words = (f"controller.slip_response={answer}", "controller.hold_by_clock=true",
             "loop.decision_delay_s=0.02")  # fmt: skip
    controller, ticks, held = run([(1, ALARM)], *words)
    assert controller.state is State.SET_DOWN and held
    assert closes(ticks) <= 1  # by steps it may be at its cap without
    assert answered_s(ticks) < 10.0


def test_alarm_that_never_ends_sets_the_object_down_and_lets_nothing_fall() -> None:
    controller, _, held = run([(1, ALARM)])
    assert controller.cap_reached
    assert held
