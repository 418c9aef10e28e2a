"""Where a setting of the answer to slip takes effect: the arm's pause, the thumb's steps."""

from typing import Any

from grasp.commands import CloseFast, MoveArm, MoveFingers, StopArm
from grasp.phases import Phase
from grasp.stiffness import Stiffness
from tests.unit.grasp.builders import arm
from tests.unit.grasp.controller_driver import TICK, Driver


def paused_at_mps2(v: float) -> float:
    d = Driver(answer_stop_mps2=v).slip()
    (stop,) = (c for c in d.commands if isinstance(c, StopArm))
    return stop.deceleration_mps2


def resumed(**settings: Any) -> Driver:
    """It slipped, and the arm goes on."""
    d = Driver(**settings).slip()
    while d.controller.phase is Phase.COMPENSATE:
        d.climb()
    return d


def resumed_at_mps2(v: float) -> float:
    (on,) = (c for c in resumed(resume_mps2=v).commands if isinstance(c, MoveArm))
    return on.acceleration_mps2


def quiet_before_it_goes_on_s(v: float) -> float:
    """From the last sample that was loud, at a hand that has closed out before."""
    d = resumed(resume_quiet_s=v)
    while not d.controller.monitor.status.registered:
        d.climb(0.9)
    quiet_ns = None
    while d.controller.phase is Phase.COMPENSATE:
        d.climb()
        if quiet_ns is None and not d.controller.monitor.status.registered:
            quiet_ns = d.t_ns - TICK
    assert quiet_ns is not None
    return (d.t_ns - quiet_ns) * 1e-9


def paused_for_nothing_s(v: float) -> float:
    """In all, while slip comes and goes at the cap."""
    d = resumed(useless_pause_s=v)
    paused = 0
    while d.controller.phase in (Phase.LIFT, Phase.COMPENSATE):
        paused += d.controller.phase is Phase.COMPENSATE
        d.climb(0.9 if d.t_ns // TICK % 30 < 5 else 0.0)
    assert d.controller.cap_reached
    return paused * TICK * 1e-9


def stepping(**settings: Any) -> Driver:
    """It slipped, and is answered by a step of the thumb, of 1 N a count."""
    low: dict[str, Any] = {"answer": "stop_and_step", "step_below_m": 1.0}
    return Driver(stiffness=Stiffness(1.0), **low | settings).slip()


def stepped_n(v: float) -> float:
    d = stepping(step_n=v)
    return float(d.requested[0] - d.grip)


def steps_taken(v: int) -> int:
    """Before slip that comes back again and again is answered by a jump."""
    d = stepping(step_tries=v, margin_steps=0)
    while not any(isinstance(c, CloseFast) for c in d.commands):
        d.climb(0.9 if d.controller.phase is Phase.LIFT else 0.0)
    return sum(isinstance(c, MoveFingers) for c in d.commands)


def steps_at(v: float, height_m: float) -> bool:
    d = Driver(answer="stop_and_step", step_below_m=v).lift()
    for _ in range(2):
        d.step(0.9, arm=arm(d.t_ns + TICK, height_m, moving=True))
    assert d.controller.phase is Phase.COMPENSATE
    return any(isinstance(c, MoveFingers) for c in d.commands)


def seconds_to_jump(v: float) -> float:
    """From the end of a step at which slip goes on."""
    d = stepping(step_patience_s=v, cap_patience_s=5.0)
    began_ns = d.t_ns
    while not any(isinstance(c, CloseFast) for c in d.commands):
        d.climb(0.9)
    return (d.t_ns - began_ns) * 1e-9


def found_after(v: float, risen_m: float) -> bool:
    """Whether the force gets its margin when it has carried so far from 5 cm on."""
    d = stepping(margin_after_m=v)
    while d.controller.phase is Phase.COMPENSATE:
        d.climb()
    d.step(arm=arm(d.t_ns + TICK, 0.05 + risen_m, moving=True))
    return d.controller.phase is Phase.COMPENSATE


def margin_in_steps(v: int) -> int:
    d = stepping(margin_steps=v, step_n=1.0)
    while d.controller.phase is Phase.COMPENSATE:
        d.climb()
    found = d.requested[0]
    d.step(arm=arm(d.t_ns + TICK, 0.1, moving=True))
    return d.requested[0] - found
