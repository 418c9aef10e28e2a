"""What shows where a setting of safety or verdict takes effect: small pieces of the real thing."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings, make_rule
from drivers.errors import Refused, Stale
from drivers.takktile.settings import TakkTileSettings
from drivers.ur.driver import ArmDriver, ArmSample, ArmSettings
from grasp.commands import CloseFast, MoveArm, MoveFingers, StopArm
from grasp.guard import ForceGuard, GuardSettings
from grasp.loop import Tick
from grasp.phases import Phase
from grasp.slip import SlipMonitor, SlipSettings
from scenarios.acquire.press import PressController, PressControlSettings, PressPhase
from scenarios.lift.scoring import LiftFacts, LiftOutcome, ScoringSettings, outcome
from scenarios.rigs.opening import open_rig
from scenarios.tap.result import Alarm
from scenarios.tap.scoring import ObjectMotion, TapFacts, TapOutcome, verdict
from scenarios.tap.settings import TapScoringSettings
from scenarios.trial.execution import grip_plan
from scenarios.world.cell import Truth
from tests.unit.drivers.takktile.test_driver import Bench
from tests.unit.grasp.builders import arm, gripper
from tests.unit.grasp.test_controller import TICK, Driver
from tests.unit.scenarios.conftest import Staged, config

MS = 1_000_000
ZERO = (0.0, 0.0, 0.0)


# Arm: a link that stands where it is told to and writes down what it is sent


class StandingArm:
    def __init__(self) -> None:
        self.sample = ArmSample(0, ZERO, ZERO, moving=False, protective_stop=False)
        self.stopped = False

    def move_l(self, *_: object) -> bool:
        return True

    def speed_l(self, *_: object) -> bool:
        return True

    def stop_l(self, *_: object) -> None:
        self.stopped = True

    def set_payload(self, mass_kg: float) -> None: ...

    def read(self, now_ns: int) -> ArmSample:
        return self.sample


def arm_driver(**settings: Any) -> tuple[ArmDriver, StandingArm]:
    link = StandingArm()
    wide = {"workspace_low_m": (-1.0,) * 3, "workspace_high_m": (1.0,) * 3, "max_jump_m": 1.0}
    driver = ArmDriver(link, ArmSettings(**{**wide, **settings}))
    driver.pump(0)
    return driver, link


def taken(act: Callable[[], object]) -> bool:
    try:
        act()
    except Refused:
        return False
    return True


def moves(to: tuple[float, float, float], speed: float = 0.1, ramp: float = 0.5, **s: Any) -> bool:
    return taken(lambda: arm_driver(**s)[0].move_to(to, speed, ramp))


def moves_along_any(x: float, **settings: Any) -> bool:
    """The same verdict on all three axes."""
    verdicts = {
        moves((x if axis == 0 else 0.0, x if axis == 1 else 0.0, x if axis == 2 else 0.0),
              **settings)
        for axis in range(3)
    }  # fmt: skip
    assert len(verdicts) == 1
    return verdicts.pop()


def turns(spin_radps: float, **settings: Any) -> bool:
    return taken(lambda: arm_driver(**settings)[0].drive(ZERO, spin_radps, 1.0))


def turns_as_far_as(x: float, v: float) -> bool:
    """A spin whose worst end, timed out and braked at 1 rad/s2, is x."""
    return turns(math.sqrt(0.01 + 2 * x) - 0.1, max_turn_rad=v, max_spin_radps=3.0)


def drives_on(v: float, after_s: float) -> bool:
    driver, link = arm_driver(drive_timeout_s=v)
    driver.drive((0.1, 0.0, 0.0), 0.0, 1.0)
    link.sample = msgspec.structs.replace(link.sample, t_ns=1)
    driver.pump(round(after_s * 1e9))
    return not link.stopped


def trusted(v: float, age_s: float) -> bool:
    driver, _ = arm_driver(stale_after_s=v)
    try:
        driver.pump(round(age_s * 1e9))
    except Stale:
        return False
    return True


def arrived(v: float, away_m: float) -> bool:
    driver, link = arm_driver(arrived_within_m=v)
    driver.move_to((0.0, 0.0, 0.1), 0.1, 0.5)
    link.sample = msgspec.structs.replace(link.sample, t_ns=1, position_m=(0.0, 0.0, 0.1 - away_m))
    driver.pump(MS)
    return not driver.state.moving


def told_payload_kg(v: float) -> float:
    told: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ArmDriver, "set_payload", lambda _, mass_kg: told.append(mass_kg))
        with open_rig(config(f"arm.payload_kg={v}"), 0, paced=False):
            return told[0]


# Fingertips


def rest_taken(codes: int | None = None, noise: int = 0, **settings: Any) -> bool:
    bench = Bench(TakkTileSettings(**settings))
    if codes is not None:
        bench.codes = np.full(18, codes, np.int16)
    bench.noise = np.full(18, noise, np.int16)
    return taken(bench.take_rest)


def missed_until_stale(v: int) -> int:
    bench = Bench(TakkTileSettings(stale_after_missed=v)).take_rest()
    bench.board.time_out(50)
    while not bench.frame.stale:
        bench.pump()
    return bench.frame.missed


def still_new(v: float, age_ms: float) -> bool:
    """Whether a sample that was converted so long ago is taken."""

    def bench() -> Bench:
        return Bench(TakkTileSettings(max_age_ms=v)).take_rest()

    usual, late = bench(), bench()
    usual.pump()
    late.link.advance(usual.now_ns)  # the same sample has come
    late.driver.pump(usual.frame.sampled_ns + round(age_ms * MS))
    return late.frame.missed == 0


def samples_of_rest(v: int) -> int:
    bench = Bench(TakkTileSettings(rest_samples=v))
    bench.driver.start()
    bench.driver.begin_rest()
    pumps = 0
    while bench.driver.frame is None:
        bench.pump()
        pumps += 1
    return pumps


REFERENCE = ((450,) * 6,) * 3


# Guard


def guard(**settings: Any) -> ForceGuard:
    return ForceGuard(GuardSettings(**settings), least_force_n=1.0, m_per_count=0.001)


def admitted(measured_n: float = 0.0, **settings: Any) -> CloseFast | None:
    """What becomes of a close that asks for everything; None: the fingers hold."""
    close = CloseFast(60.0, (True,) * 3, (255,) * 3, 100.0)
    answer = guard(**settings).admit(close, gripper(), (measured_n, 0.0, 0.0))
    return answer if isinstance(answer, CloseFast) else None


def overshoot_n(**settings: Any) -> float:
    """By which a close at the admitted speed passes the limit, at 2500 N/m and 0.1 kg."""
    close = admitted(**settings)
    assert close is not None
    return close.speed_mps * math.sqrt(2500.0 * 0.1)


# Controller


def lifted(**settings: Any) -> Driver:
    """A lift without slip: set down, fingers opened, arm retreating."""
    d = Driver(**settings)
    d.until(Phase.LIFT)
    d.height_m = settings.get("lift_height_m", 0.2)
    d.until(Phase.LOWER)
    d.height_m = 0.0
    d.until(Phase.RETREAT)
    return d


def fingers_moved(number: int, **settings: Any) -> MoveFingers:
    """The first move shapes the hand, the second grasps."""
    d = Driver(**settings)
    d.until(Phase.GRASP)
    return [c for c in d.commands if isinstance(c, MoveFingers)][number]


def arm_moved(number: int, **settings: Any) -> MoveArm:
    """Up, down, clear."""
    return [c for c in lifted(**settings).commands if isinstance(c, MoveArm)][number]


def risen_m(number: int, **settings: Any) -> float:
    return arm_moved(number, **settings).position_m[2] - arm().position_m[2]


def closed(**settings: Any) -> CloseFast:
    (close,) = [c for c in Driver(**settings).slip().commands if isinstance(c, CloseFast)]
    return close


def held_s(**settings: Any) -> float:
    d = Driver(**settings)
    d.until(Phase.LIFT)
    d.height_m = 0.2
    d.until(Phase.HOLD)
    began_ns = d.t_ns
    d.until(Phase.LOWER)
    return (d.t_ns - began_ns) * 1e-9


def stopped_at_mps2(v: float) -> float:
    """Of the arm, when a person stops the run and when a fault does."""
    commands: list[object] = []
    for cause in ({"trouble": "unplugged"}, {"stop": "by hand"}):
        d = Driver(stop_deceleration_mps2=v).lift()
        d.climb(**cause)
        commands += d.commands
    (found,) = {c.deceleration_mps2 for c in commands if isinstance(c, StopArm)}
    return found


def listened_s(**settings: Any) -> tuple[float, float]:
    """From the fingers' rest to listening, and on to the lift."""
    d = Driver(**settings)
    d.until(Phase.RELAX)
    began_ns = d.t_ns
    d.until(Phase.LISTEN)
    assert d.controller.monitor.status.armed
    armed_ns = d.t_ns
    d.until(Phase.LIFT)
    return (armed_ns - began_ns) * 1e-9, (d.t_ns - armed_ns) * 1e-9


def patience_s(v: float) -> float:
    """How long slip goes on at a hand that rests before the object is set down."""
    d = Driver(cap_patience_s=v).slip()
    began_ns = d.t_ns
    while d.controller.phase is Phase.COMPENSATE:
        d.climb(0.9)
    assert d.controller.cap_reached
    return (d.t_ns - began_ns) * 1e-9


def state_trusted(v: float, age_s: float, of: str) -> bool:
    d = Driver(stale_after_s=v)
    d.until(Phase.GRASP)
    then_ns = d.t_ns + TICK - round(age_s * 1e9)
    d.step(**{of: gripper(then_ns) if of == "gripper" else arm(then_ns)})
    return d.controller.phase is not Phase.FAULT


def both_trusted(v: float, age_s: float) -> bool:
    trusted = {state_trusted(v, age_s, of) for of in ("gripper", "arm")}
    assert len(trusted) == 1
    return trusted.pop()


def seconds_to_fault(v: float) -> float:
    d = Driver(phase_timeout_s=v)
    d.until(Phase.LIFT)
    began_ns = d.t_ns
    while d.controller.phase is Phase.LIFT:
        d.climb()
    return (d.t_ns - began_ns) * 1e-9


def seconds_after_fault(v: float) -> float:
    d = Driver(safe_state_s=v)
    d.until(Phase.LIFT)
    d.climb(trouble="unplugged")
    began_ns = d.t_ns
    while not d.controller.finished:
        d.climb()
    return (d.t_ns - began_ns) * 1e-9


def between_stops_s(v: float) -> float:
    """Of an arm that goes on after a fault."""
    d = Driver(repeat_s=v).lift()
    d.climb(trouble="unplugged")
    stops_ns = [d.t_ns]
    while len(stops_ns) < 4:
        if any(isinstance(c, StopArm) for c in d.climb().commands):
            stops_ns.append(d.t_ns)
    return (stops_ns[3] - stops_ns[0]) / 3 * 1e-9


def touches(v: float, felt_n: float) -> bool:
    """Whether the arm lifts when the thumb feels so much."""
    d = Driver(contact_n=v)
    d.until(Phase.GRASP)
    for _ in range(80):
        d.step(measured_n=(felt_n, 0.0, 0.0))
    return d.controller.phase is Phase.LIFT


def seconds_to_answer(v: float) -> float:
    """From the last time that contact was felt."""
    d = Driver(contact_lost_s=v).lift()
    began_ns = d.t_ns
    while d.controller.phase is Phase.LIFT:
        d.climb(measured_n=ZERO)
    return (d.t_ns - began_ns) * 1e-9


def seconds_of_overload(v: float) -> float:
    d = Driver(overload_s=v).lift()
    began_ns = d.t_ns
    while d.controller.phase is Phase.LIFT:
        d.climb(overloaded=True)
    return (d.t_ns - began_ns) * 1e-9


def held_under_alarms_s(v: float) -> float:
    """At the top, at the cap, with alarms that come and go, beyond ``hold_s``."""
    d = Driver(alarm_hold_s=v, hold_s=0.5).slip()
    d.height_m = 0.2
    d.until(Phase.HOLD)
    began_ns = d.t_ns
    while d.controller.phase is not Phase.LOWER:
        d.step(0.9 if d.t_ns // TICK % 6 < 3 else 0.0)
    return (d.t_ns - began_ns) * 1e-9 - 0.5


def bears_the_cap(hold_by_clock: bool) -> bool:
    """Whether slip that is still registered after patience leads on to the hold."""
    d = Driver(hold_by_clock=hold_by_clock).slip()
    while d.controller.phase is Phase.COMPENSATE:
        d.climb(0.9)
    return d.controller.phase is Phase.HOLD and not d.controller.cap_reached


def at_the_top(v: float, away_m: float) -> bool:
    d = Driver(at_height_m=v)
    d.until(Phase.LIFT)
    d.height_m = 0.2 - away_m
    return d.step().phase is Phase.HOLD


def kept(keep: bool) -> bool:
    d = Driver(keep=keep, hold_s=0.0)
    d.until(Phase.LIFT)
    d.height_m = 0.2
    for _ in range(5):
        d.step()
    return d.controller.finished and d.controller.phase is Phase.HOLD


def squeezed(firm: bool) -> bool:
    d = Driver(firm=firm)
    d.until(Phase.OPPOSE)
    return d.step().phase is Phase.SQUEEZE


def reacts(reactions: bool) -> bool:
    d = Driver(reactions=reactions).lift()
    for _ in range(2):
        d.climb(0.9)
    return d.controller.phase is Phase.COMPENSATE


def margin_counts(v: int) -> int:
    plan = grip_plan(config(f"controller.preshape_margin_counts={v}"))
    _, b, c = (g - p for g, p in zip(plan.grip_counts, plan.preshape_counts, strict=True))
    assert b == c
    return b


def thumb_back_counts(v: int) -> int:
    plan = grip_plan(config(f"controller.thumb_back_counts={v}"))
    a, b, _ = (g - p for g, p in zip(plan.grip_counts, plan.preshape_counts, strict=True))
    return a - b


# Loop


def first_ticks(*assignments: str) -> list[Tick]:
    """Of a lift that is interrupted."""

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    staged = Staged(*assignments)
    staged.run(lambda _: len(staged.ticks) > 20, interrupt)
    return staged.ticks


def period_s(v: float) -> float:
    first, second = first_ticks(f"loop.period_s={v}")[10:12]
    return (second.t_ns - first.t_ns) * 1e-9


def delay_s(v: float) -> float:
    """From the decision to the sending of the first command."""
    issued = [i for tick in first_ticks(f"loop.decision_delay_s={v}") for i in tick.issued]
    return (issued[0].sent_ns - issued[0].decided_ns) * 1e-9


# Verdicts


HELD = Truth(
    t_ns=0, height_m=0.2, speed_mps=0.0, slip_distance_m=0.02, slip_speed_mps=0.0,
    normal_n=(10.0, 5.0, 5.0), shear_n=ZERO, peak_n=(10.0, 5.0, 5.0), slip_onset_s=1.0,
    force_rise_s=1.1, flank_slope=0.0,
)  # fmt: skip
FACTS = LiftFacts(
    end=HELD, felt_n=5.0, had_compensated=True, registered_s=1.1, onset_s=1.0, twin_onset_s=1.0,
    peak_force_n=10.0, force_bound_n=11.0, cap_reached=False, alarm_stayed=False, fault="",
)  # fmt: skip


def lift_verdict(
    settings: dict[str, float], end: dict[str, float] | None, **facts: Any
) -> LiftOutcome:
    """Of a long object that was held, but for what is named; ``end`` None: no simulation."""
    truth = None if end is None else msgspec.structs.replace(HELD, **end)
    changed = msgspec.structs.replace(FACTS, end=truth, **facts)
    body = msgspec.structs.replace(config().object, long_body=True)
    return outcome(changed, body, ScoringSettings(**settings))


MOVED = ObjectMotion(struck_s=9.99, from_s=10.0, until_s=10.02, displacement_m=0.006)


def tap_verdict(
    settings: dict[str, float], alarms: list[Alarm], moved_m: float = 0.006
) -> TapOutcome:
    motion = msgspec.structs.replace(MOVED, displacement_m=moved_m)
    facts = TapFacts(
        motion=motion, alarms=alarms, watched_until_s=30.0, own_peak_n=10.5, force_bound_n=11.0
    )
    return verdict(facts, TapScoringSettings(**settings))


# What registers slip


def registers(samples: list[tuple[float, ...]], **settings: Any) -> list[bool]:
    """What the rule says after each sample, of log-odds."""
    rule = make_rule(RuleSettings(**settings), len(samples[0]))
    said = []
    for sample in samples:
        rule.update(1.0 / (1.0 + np.exp(-np.array(sample))))
        said.append(rule.registered)
    return said


def summed(log_odds: float, **settings: Any) -> bool:
    return registers([(log_odds,)], kind="cusum", **settings)[0]


def sure_samples(consecutive: int) -> int:
    return registers([(3.0,)] * 60, consecutive=consecutive).index(True) + 1


def quiet_samples(release: int) -> int:
    return registers([(3.0,)] * 2 + [(-3.0,)] * 100, release=release)[2:].index(False) + 1


def fingers_that_agree(fingers: int) -> int:
    sure = [(3.0,) * n + (-3.0,) * (3 - n) for n in (1, 2, 3)]
    said = [registers([sample], consecutive=1, fingers=fingers)[0] for sample in sure]
    return said.index(True) + 1


def masked_s(value: float) -> float:
    """For how long after our own closing."""
    m = SlipMonitor(make_rule(RuleSettings(), 3), SlipSettings(mask_after_closing_s=value))
    m.arm()
    m.closing(0)
    return next(k for k in range(3000) if not m.update(k * MS, np.zeros(3)).masked) / 1e3


# One fingertip that presses


def presser(**settings: Any) -> PressController:
    made = PressControlSettings(**settings)
    return PressController(made, 100.0, None, np.random.default_rng(0))


def pressing_mps(felt_n: float, below_m: float = 0.0, **settings: Any) -> float:
    """Speed downwards at a measured force, so far below where it touched (at 100 counts a N)."""
    p = presser(derivative_m_per_n=0.0, integral_mps_per_n_s=0.0, **settings)
    p.step(0.0, np.array([-1000] + [0] * 5, dtype=np.int16), arm())
    counts = np.array([round(-100 * felt_n)] + [0] * 5, dtype=np.int16)
    return -p.step(0.01, counts, arm(height_m=-below_m)).velocity_mps[2]


def touched(value: float, felt_n: float) -> bool:
    p = presser(touch_n=value)
    p.step(0.0, np.array([round(-100 * felt_n)] + [0] * 5, dtype=np.int16), arm())
    return p.phase is not PressPhase.APPROACH
