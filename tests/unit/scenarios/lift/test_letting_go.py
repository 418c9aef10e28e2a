"""What a hand holds is let go where it stands, by whoever asks for that, and nowhere else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from drivers.errors import DeviceFault
from grasp.loop import Tick
from grasp.states import State
from scenarios.lab.hand import Hand
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig, Rig
from scenarios.trial.execution import make_guard, run_trial
from tests.unit.scenarios.conftest import Staged, config, in_phase
from tests.unit.scenarios.lift import device_faults as fault

MET_WHILE_OPENING, THERE = 0x0015, 0x003F  # detections of all fingers


def stand(rig: Rig, detections: int) -> None:
    """The motors stand, and the status gives that as the reason."""
    gripper = fault.cell(rig).gripper
    gripper.jam()
    gripper.misreport(lambda w: (w[0] & ~0x003F | detections, *w[1:]))


@pytest.mark.parametrize("says", [MET_WHILE_OPENING, THERE])
def test_object_is_not_taken_up_again_by_a_hand_that_does_not_open(says: int) -> None:
    staged = Staged()
    trial = staged.run(in_phase(State.OPEN, 1), lambda rig: stand(rig, says))
    truth = staged.rig.truth()
    assert truth is not None
    assert truth.height_m < 0.001
    assert trial.controller.state is State.FAULT
    assert staged.result(trial).outcome == "fault"


def test_next_run_does_not_let_go_what_an_interrupted_one_holds_in_the_air() -> None:
    """It was gripped by position, and never slipped: no finger reports contact."""
    rough = (
        "object.friction_static=2.0",
        "object.friction_kinetic=2.0",
        "controller.reactions=false",
    )
    settings = config("controller.lift_height_m=0.05", *rough)
    met, stopped = in_phase(State.HOLD), list[Tick]()
    with open_rig(settings, 0, paced=False) as rig:

        def interrupt(tick: Tick, *_: object) -> None:
            if not stopped and met(tick):
                stopped.append(tick)
                raise KeyboardInterrupt

        first = run_trial(settings, rig, make_guard(settings), interrupt)
        assert first.interrupted
        held = rig.truth()
        second = run_trial(settings, rig, make_guard(settings), lambda *_: None)
        left = rig.truth()
    assert held is not None
    assert left is not None
    assert held.height_m > 0.04
    assert left.height_m == pytest.approx(held.height_m, abs=1e-3)
    assert second.controller.state is State.FAULT


@contextmanager
def closed_hand(act: Callable[[Rig], None]) -> Iterator[GraspRig]:
    with open_rig(config(), 0, paced=False) as rig:
        rig.devices.gripper.move_to((120, 120, 120), 0.1, 10.0)
        for _ in range(40):
            rig.wait_and_poll()
        act(rig)
        yield rig


@pytest.mark.parametrize("says", [MET_WHILE_OPENING, THERE])
def test_release_does_not_say_that_a_hand_is_open_which_is_not(says: int) -> None:
    with closed_hand(lambda rig: stand(rig, says)) as rig:
        hand = Hand(config(), rig.devices.gripper, None, rig.clock, "")
        with pytest.raises(DeviceFault, match="did not open"):
            hand.open(lambda _: None)
