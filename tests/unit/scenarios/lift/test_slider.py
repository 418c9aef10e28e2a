"""The arm's speed slider is turned in the midst of a lift."""

from collections.abc import Callable

import pytest

from grasp.loop import Tick
from grasp.phases import LOWERING_PHASES, Phase
from scenarios.rigs.rig import Rig
from tests.unit.scenarios.conftest import Staged, in_phase, well_in
from tests.unit.scenarios.lift.device_faults import cell

SHORT = "controller.phase_timeout_s=10"


def turn_to(fraction: float) -> Callable[[Rig], None]:
    return lambda rig: cell(rig).arm.turn_slider(fraction, rig.clock.now_ns)


def seconds(staged: Staged) -> float:
    return (staged.ticks[-1].t_ns - staged.ticks[0].t_ns) * 1e-9


def lowered_s(staged: Staged) -> float:
    return sum(tick.decision.phase in LOWERING_PHASES for tick in staged.ticks) * 0.01


def never(tick: Tick) -> bool:
    return False


@pytest.mark.parametrize("fraction", [0.5, 0.6, 0.9])
def test_lift_goes_on_slower_above_a_half(fraction: float) -> None:
    plain, staged = Staged(), Staged()
    plain.run(never, turn_to(1.0))
    trial = staged.run(well_in(Phase.LIFT), turn_to(fraction))
    result = staged.result(trial)
    assert trial.controller.phase is Phase.DONE and result.success, trial.controller.fault_cause
    assert seconds(staged) > seconds(plain)
    said = {tick.arm.speed_fraction for tick in staged.ticks}
    assert said == {1.0, fraction}
    assert lowered_s(staged) == pytest.approx(lowered_s(plain) / fraction, rel=0.15)


@pytest.mark.parametrize("fraction", [0.0, 0.2, 0.45])
@pytest.mark.parametrize("phase", [Phase.LISTEN, Phase.LIFT])
def test_below_it_the_lift_ends_in_the_safe_state_and_says_why(
    phase: Phase, fraction: float
) -> None:
    staged = Staged()
    trial = staged.run(well_in(phase), turn_to(fraction))
    assert trial.controller.phase is Phase.FAULT
    assert f"speed slider is at {100 * fraction:g} %" in trial.controller.fault_cause
    assert not trial.controller.unreached
    assert staged.ticks[-1].t_ns - staged.done_at_ns < 1e9  # type: ignore[operator]
    assert cell(staged.rig).arm.velocity(staged.rig.clock.now_ns) == (0.0, 0.0, 0.0)
    assert trial.final is not None
    if phase is Phase.LIFT:
        assert min(trial.final.normal_n) > 1.0 and trial.final.slip_speed_mps < 1e-3
    failure = trial.failure(staged.config)
    assert failure is not None and "speed slider" in failure.message
    assert failure.end is not None and failure.end.arm == "the arm stands"


@pytest.mark.parametrize("phase", [Phase.HOLD, Phase.LOWER, Phase.LAND, Phase.RETREAT])
def test_way_down_goes_on_slowly_instead_of_ending_in_the_air(phase: Phase) -> None:
    """The whole takes longer than a run may, and most of it longer than a phase."""
    staged = Staged(SHORT, "loop.deadline_s=20")
    trial = staged.run(in_phase(phase, 3), turn_to(0.1))
    assert staged.done_at_ns is not None
    assert trial.controller.phase is Phase.DONE, trial.controller.fault_cause
    assert staged.result(trial).success
    if phase is not Phase.RETREAT:
        assert seconds(staged) > 25.0 and lowered_s(staged) > 10.0


def test_arm_that_its_slider_lets_stand_in_the_air_is_told_of_and_the_object_held() -> None:
    staged = Staged()
    trial = staged.run(in_phase(Phase.LOWER, 30), turn_to(0.0))
    assert trial.controller.phase is Phase.FAULT
    assert trial.controller.fault_cause == "the arm's speed slider is at 0 %: it comes to no end"
    assert trial.final is not None and trial.final.height_m > 0.05
    assert min(trial.final.normal_n) > 1.0 and trial.final.slip_speed_mps < 1e-3


def test_slider_that_is_turned_up_again_is_followed() -> None:
    staged = Staged(SHORT)
    turned: list[int] = []

    def when(tick: Tick) -> bool:
        if tick.decision.phase is Phase.LOWER:
            turned.append(tick.t_ns)
            fraction = {20: 0.1, 150: 1.0, 200: 0.0, 260: 0.4, 400: 1.0}.get(len(turned))
            if fraction is not None:
                turn_to(fraction)(staged.rig)
        return False

    trial = staged.run(when, turn_to(1.0))
    assert trial.controller.phase is Phase.DONE, trial.controller.fault_cause
    assert {tick.arm.speed_fraction for tick in staged.ticks} >= {1.0, 0.1, 0.0, 0.4}


@pytest.mark.parametrize("phase", [Phase.APPROACH, Phase.GRASP, Phase.RELEASE])
def test_slow_arm_gives_fingers_no_more_time_and_harms_nothing_while_it_stands(
    phase: Phase,
) -> None:
    staged = Staged()
    trial = staged.run(in_phase(phase, 3), turn_to(0.6))
    assert trial.controller.phase is Phase.DONE, trial.controller.fault_cause
