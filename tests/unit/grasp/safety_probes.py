"""Values at which settings of guard, controller and slip monitor take effect."""

import math
from typing import Any

from grasp.control.commands import CloseToLimit, MoveArm, MoveFingers, StopArm
from grasp.control.contact_estimator import Stiffness
from grasp.control.guard import ForceGuard, GuardSettings
from grasp.control.set_down import SLIP_MARGIN_M
from grasp.control.states import State
from tests.unit.grasp.builders import LOST, STOP, arm, gripper
from tests.unit.grasp.controller_driver import TICK, Driver

# Guard


def guard(**settings: Any) -> ForceGuard:
    return ForceGuard(GuardSettings(**settings), least_force_n=1.0, stiffness=Stiffness(2.5))


def admitted(estimated_n: float = 0.0, **settings: Any) -> CloseToLimit | None:
    """The admitted form of a closing with maximal values; None if the fingers hold."""
    close = CloseToLimit(60.0, (True,) * 3, (255,) * 3, 100.0)
    admitted_command = guard(**settings).admit(close, gripper(), (estimated_n, estimated_n, 0.0))
    return admitted_command if isinstance(admitted_command, CloseToLimit) else None


def overshoot_n(**settings: Any) -> float:
    """Overshoot of a closing at the admitted speed, at 2500 N/m and 0.1 kg."""
    close = admitted(**settings)
    assert close is not None
    return close.speed_mps * math.sqrt(2500.0 * 0.1)


def safe_travel_counts(first_n: float = 0.0, **settings: Any) -> int:
    """Counts of 2.5 N that the thumb may close at any speed after a first grasp."""
    g = guard(**settings)
    g.set_first_grasp((0, 0, 0), (first_n, first_n, 0.0))
    reach = g.safe_travel(gripper(positions=(0, 0, 0)), (first_n, first_n, 0.0))
    assert reach is not None
    return reach[0]


def worst_first_n() -> float:
    """Margin on the force of the first grasp at which the safe travel loses a count."""
    settings: dict[str, Any] = {"force_limit_n": 40.0, "overshoot_n": 1.0}
    steps = (n / 100 for n in range(200))
    first_n = next(n for n in steps if safe_travel_counts(n, **settings) < 12)
    return 41.0 - 12 * 1.3 * 2.5 - first_n


# Controller


def lifted(**settings: Any) -> Driver:
    """A lift without slip: set down, fingers opened, arm retreating."""
    d = Driver(**settings)
    d.until(State.LIFT)
    d.height_m = settings.get("lift_height_m", 0.2)
    d.until(State.DESCEND)
    d.height_m = 0.0
    d.until(State.RETREAT)
    return d


def grip_forces(force_n: float) -> tuple[float, float, float]:
    """Estimated forces of a grip, fingers A, B and C."""
    return force_n, force_n / 2, force_n / 2


def near(**settings: Any) -> Driver:
    """Driver while lowering an object that slipped until the arm was 5 cm up."""
    d = Driver(hold_s=0.1, **settings).slip()
    while d.controller.state is State.COMPENSATE:
        d.climb()
    d.height_m = 0.2
    d.until(State.DESCEND)
    d.height_m = 0.05 + SLIP_MARGIN_M
    d.until(State.FEEL)
    return d


def tightened(estimated_n: float, **settings: Any) -> Driver:
    """Driver whose thumb measures ``estimated_n`` while lowering, until the arm is stopped or the
    filtered force has settled."""
    d = near(**settings)
    d.height_m = 0.02
    d.commands.clear()
    entered = len(d.controller.machine.log)
    for _ in range(80):
        if len(d.controller.machine.log) > entered:
            break
        d.step(estimated_n=grip_forces(estimated_n), arm=arm(d.t_ns + TICK, 0.02, moving=True))
    return d


def probed(first_n: float, then_n: float, **settings: Any) -> Driver:
    """Driver after a probe: the thumb measures ``first_n`` before and ``then_n`` after it."""
    d = tightened(first_n, **settings)
    assert "tightened" in d.controller.machine.log[-1].cause
    d.until_next(estimated_n=grip_forces(first_n))
    d.until_next(estimated_n=grip_forces(then_n))
    return d


def fingers_moved(number: int, **settings: Any) -> MoveFingers:
    """Move number ``number`` of the fingers: 0 shapes the hand, 1 grasps."""
    d = Driver(**settings)
    d.until(State.BRACE)
    return [c for c in d.commands if isinstance(c, MoveFingers)][number]


def arm_moved(number: int, **settings: Any) -> MoveArm:
    """Move number ``number`` of the arm: up, down, clear."""
    return [c for c in lifted(**settings).commands if isinstance(c, MoveArm)][number]


def risen_m(number: int, **settings: Any) -> float:
    return arm_moved(number, **settings).position_m[2] - arm().position_m[2]


def stopped_at_mps2(v: float) -> float:
    """Deceleration of the arm after a stop by a person and after a fault."""
    commands: list[object] = []
    for cause in ({"errors": LOST}, {"stop": STOP}):
        d = Driver(stop_deceleration_mps2=v).lift()
        d.climb(**cause)
        commands += d.commands
    (found,) = {c.deceleration_mps2 for c in commands if isinstance(c, StopArm)}
    return found


def listened_s(**settings: Any) -> tuple[float, float]:
    """Durations of settling and of taking the baseline, s."""
    d = Driver(**settings)
    d.until(State.SETTLE)
    began_ns = d.t_ns
    d.until(State.BASELINE)
    assert d.controller.slip_monitor.status.armed
    armed_ns = d.t_ns
    d.until(State.LIFT)
    return (armed_ns - began_ns) * 1e-9, (d.t_ns - armed_ns) * 1e-9


def patience_s(v: float) -> float:
    """Duration of slip with the hand at rest until the object is set down, s."""
    d = Driver(limit_patience_s=v).slip()
    began_ns = d.t_ns
    while d.controller.state is State.COMPENSATE:
        d.climb(0.9)
    assert d.controller.limit_reached
    return (d.t_ns - began_ns) * 1e-9


def state_trusted(v: float, age_s: float, of: str) -> bool:
    d = Driver(stale_after_s=v)
    d.until(State.BRACE)
    then_ns = d.t_ns + TICK - round(age_s * 1e9)
    d.step(**{of: gripper(then_ns) if of == "gripper" else arm(then_ns)})
    return d.controller.state is not State.FAULT


def both_trusted(v: float, age_s: float) -> bool:
    trusted = {state_trusted(v, age_s, of) for of in ("gripper", "arm")}
    assert len(trusted) == 1
    return trusted.pop()


def touches(v: float, estimated_n: float) -> bool:
    """Whether the arm lifts when the thumb measures ``estimated_n``."""
    d = Driver(contact_n=v)
    d.until(State.BRACE)
    for _ in range(80):
        d.step(estimated_n=(estimated_n, 0.5, 0.5))
    return d.controller.state is State.LIFT


def seconds_of_overload() -> float:
    d = Driver().lift()
    began_ns = d.t_ns
    while d.controller.state is State.LIFT:
        d.climb(overloaded=True)
    return (d.t_ns - began_ns) * 1e-9


def held_under_alarms_s() -> float:
    """Time of hold beyond ``hold_s`` at the cap with repeated alarms, s."""
    d = Driver(hold_s=0.5).slip()
    d.height_m = 0.2
    d.until(State.HOLD)
    began_ns = d.t_ns
    while d.controller.state is not State.DESCEND:
        d.step(0.9 if d.t_ns // TICK % 6 < 3 else 0.0)
    return (d.t_ns - began_ns) * 1e-9 - 0.5


def lowered_after_gap(gap_s: float) -> bool:
    """Whether an object is set down after a loss of contact of ``gap_s`` in the air."""
    d = Driver(hold_s=0.1).lift()
    for _ in range(round(gap_s * 1e9 / TICK)):
        d.climb(estimated_n=(0.0, 0.0, 0.0))
    d.height_m = 0.2
    while d.controller.state not in (State.DESCEND, State.LOST):
        d.step()
    return d.controller.state is State.DESCEND


def at_the_top(away_m: float) -> bool:
    d = Driver()
    d.until(State.LIFT)
    d.height_m = 0.2 - away_m
    return d.step().state is State.HOLD


def kept(keep: bool) -> bool:
    d = Driver(keep=keep, hold_s=0.0)
    d.until(State.LIFT)
    d.height_m = 0.2
    for _ in range(5):
        d.step()
    return d.controller.state is State.KEPT


def paused_for_nothing_s() -> float:
    """Total pause of the arm while slip recurs at the cap, s."""
    d = Driver().slip()
    while d.controller.state is State.COMPENSATE:
        d.climb()
    paused = 0
    while d.controller.state in (State.LIFT, State.COMPENSATE):
        paused += d.controller.state is State.COMPENSATE
        d.climb(0.9 if d.t_ns // TICK % 30 < 5 else 0.0)
    assert d.controller.limit_reached
    return paused * TICK * 1e-9
