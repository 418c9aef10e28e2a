"""A held object is released only on the table, or by an explicit command."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from drivers.errors import DeviceFault
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.lab.hand import Hand
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig, Rig
from scenarios.trial.execution import make_guard, run_trial
from tests.unit.scenarios.conftest import config, in_phase
from tests.unit.scenarios.lift import device_faults as fault

CONTACT_WHILE_OPENING, AT_TARGET = 0x0015, 0x003F  # detections of all fingers


def jam(rig: Rig, detections: int) -> None:
    """The motors stop, and the status reports these detections."""
    gripper = fault.cell(rig).gripper
    gripper.jam()
    gripper.misreport(lambda w: (w[0] & ~0x003F | detections, *w[1:]))


def test_next_run_does_not_release_an_object_held_in_the_air_by_an_interrupted_run() -> None:
    """It was gripped by position and never slipped: no finger reports contact."""
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


@pytest.mark.parametrize("detections", [CONTACT_WHILE_OPENING, AT_TARGET])
def test_release_reports_a_hand_that_did_not_open(detections: int) -> None:
    with closed_hand(lambda rig: jam(rig, detections)) as rig:
        hand = Hand(config(), rig.devices.gripper, None, rig.clock, "")
        with pytest.raises(DeviceFault, match="did not open"):
            hand.open(lambda _: None)
