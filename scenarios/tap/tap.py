"""The mallet tap (paper, section V-B): hold at the force limit, tap, detect slip, nominal again.

Each tap is a separate trial from grasp to set-down, so that displacements do not add up. Only
detection is scored. Slip response is disabled; it would have no effect, because a thumb at the
force limit is latched.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from drivers.errors import ConfigError
from drivers.interfaces import Vector3
from grasp.control.guard import ForceGuard
from grasp.control.states import SAFE_STATES, State
from grasp.run.loop import Tick
from scenarios.rigs.rig import GraspRig
from scenarios.tap.config import TapConfig
from scenarios.tap.mallet import Swing, mallet_speed_mps, swing
from scenarios.tap.scoring import (
    NOT_TAPPED,
    UNMOVED,
    Alarm,
    ObjectMotion,
    TapFacts,
    TapOutcome,
    TapResult,
    first_motion_s,
    last_motion_s,
    nominal_again_s,
    registered_after,
    verdict,
)
from scenarios.trial import execution, operator_prompts
from scenarios.trial.execution import FinishedTrial, Watch
from scenarios.trial.experiment import Experiment
from scenarios.trial.operator_prompts import WITHDRAWN, Operator, read_mark
from scenarios.trial.result import later_ms, named
from scenarios.world.settings import Impact
from scenarios.world.truth import Truth

HEIGHT_M = 0.08  # above the table, more than any tap displaces the object; assumed
NOMINAL_S = 0.5  # of nominal status before a tap; assumed
PATIENCE_S = 10.0  # to wait for that before the trial is abandoned; assumed
WATCH_S = 3.0  # of status recorded after a tap: longer than any time limit of the verdict
IMPACT_FACTOR = 3.0  # an impact changes a taxel by this many times the largest change before it
MOTION_BOUND_S = 0.15  # upper bound of motion after an impact: 13-140 ms in simulation
MEASURED = ("displacement_m", "down_m", "across_m", "turned_rad", "impact_s")  # of the motion
SIDES = {
    "top": "on the TOP, downwards",
    "side": "on the SIDE, across the closing axis",
    "closing": "ALONG the closing axis, onto the thumb",
}


class SimulatedTap:
    """Taps in simulation and measures the object's motion."""

    def __init__(self, tap: Callable[[Impact], None], swing: Swing) -> None:
        self.motion: ObjectMotion | None = None
        self.impulse_n_s: float | None = swing.impulse_n_s
        self._tap, self._swing = tap, swing
        self._at_s = 0.0
        self._rest: Truth | None = None

    def before(self, tick: Tick) -> None:
        """Does nothing: the simulated truth needs no reference."""

    def strike(self, tick: Tick, truth: Truth | None) -> None:
        if truth is None:  # the simulation is lost; the next step fails with its error
            return
        self._rest = truth
        self._at_s = tick.t_ns * 1e-9
        self._tap(self._swing.impact)

    def after(self, tick: Tick, truth: Truth | None) -> bool:
        """Take a tick after the impact; True when the measurement is complete."""
        rest = self._rest
        if truth is None or rest is None:
            return False
        if tick.t_ns * 1e-9 < self._at_s + WATCH_S and truth.touched:
            return False
        down_m = truth.slip_distance_m - rest.slip_distance_m
        across_m = truth.across_m - rest.across_m
        impact_s = self._at_s if truth.impact_s is None else truth.impact_s
        self.motion = ObjectMotion(
            impact_s=impact_s, from_s=truth.moved_from_s, until_s=truth.moved_until_s,
            displacement_m=math.hypot(down_m, across_m), held=truth.touched,
            turned_rad=truth.turn_rad - rest.turn_rad,
            down_m=down_m, across_m=across_m,
        )  # fmt: skip
        return True


class OperatorTap:
    """Asks the operator to tap, then for the displacement of the tape mark.

    The time of the impact is the first change of counts well above the changes before it. The end
    of motion is unknown; an upper bound is assumed.
    """

    def __init__(self, operator: Operator, direction: str, period_s: float) -> None:
        self.motion: ObjectMotion | None = None
        self.impulse_n_s: float | None = None  # unknown
        self._operator, self._direction, self._period_s = operator, direction, period_s
        self._last: np.ndarray[tuple[int, ...], np.dtype[np.int16]] | None = None
        self._largest = 0.0  # change of a taxel before the impact, counts
        self._asked_s = 0.0
        self._measured_s: float | None = None
        self._tapped = self._measuring = self._withdrawn = False

    @property
    def _impact_s(self) -> float:
        return self._asked_s if self._measured_s is None else self._measured_s

    def before(self, tick: Tick) -> None:
        self._largest = max(self._largest, self._change(tick))

    def strike(self, tick: Tick, truth: Truth | None) -> None:
        self._asked_s = tick.t_ns * 1e-9
        self._operator.say(
            f"Tap the object once {SIDES[self._direction]}. When it is still, press Enter"
        )

    def after(self, tick: Tick, truth: Truth | None) -> bool:
        t_s = tick.t_ns * 1e-9
        if tick.decision.state in SAFE_STATES:
            self._withdraw()
            return False
        if self._measured_s is None and not self._tapped and self._stands_out(tick):
            self._measured_s = t_s - self._period_s
        line = self._operator.poll()
        if not self._tapped:
            self._tapped = line is not None
        elif not self._measuring and t_s >= self._impact_s + WATCH_S:
            self._measuring = True
            self._operator.say("How far has the tape mark moved, in mm? (0: not at all; l: lost)")
        elif self._measuring and line is not None:
            return self._read_mark(line)
        return False

    def _withdraw(self) -> None:
        """Withdraw the open question before the cause of the end is printed."""
        if not self._withdrawn:
            self._operator.say(WITHDRAWN)
        self._withdrawn = True

    def _change(self, tick: Tick) -> float:
        """Largest change of a taxel since the last sample, counts."""
        if tick.frame is None:
            return 0.0
        last, self._last = self._last, tick.frame.counts
        return 0.0 if last is None else float(np.abs(self._last - last).max())

    def _stands_out(self, tick: Tick) -> bool:
        return self._change(tick) > IMPACT_FACTOR * max(self._largest, 1.0)

    def _read_mark(self, line: str) -> bool:
        mark = read_mark(self._operator, line)
        if mark is not None:
            self.motion = ObjectMotion(
                impact_s=self._impact_s, from_s=self._impact_s,
                until_s=self._impact_s + MOTION_BOUND_S,
                displacement_m=mark.moved_m, held=mark.held,
            )  # fmt: skip
        return mark is not None


class TapSequence:
    """Sequence of a tap trial: wait for nominal status, tap, observe, then set the object down.
    Collects the alarms."""

    def __init__(self, wait_s: float, striker: SimulatedTap | OperatorTap) -> None:
        self.alarms: list[Alarm] = []
        self.before: Truth | None = None  # just before the impact
        self.watched_until_s = 0.0
        self.over = False
        self._wait_s, self._striker = wait_s, striker
        self._since_s: float | None = None  # held at the top
        self._nominal_since_s: float | None = None
        self._tapped = False

    @property
    def motion(self) -> ObjectMotion | None:
        return self._striker.motion

    @property
    def impulse_n_s(self) -> float | None:
        """Impulse of the impact, N s; None where it is unknown or no tap was made."""
        return self._striker.impulse_n_s if self._tapped else None

    def take(self, tick: Tick, truth: Truth | None) -> bool:
        """Take one tick; truth is None on hardware. True: set the object down."""
        t_s = tick.t_ns * 1e-9
        if not self.over:
            self._monitor(tick, t_s)
            if self._tapped:
                self.watched_until_s = t_s
                self.over = self._striker.after(tick, truth)
            elif tick.decision.state is State.HOLD and not tick.arm.moving:
                self._hold(tick, truth, t_s)
        return self.over

    def _monitor(self, tick: Tick, t_s: float) -> None:
        """Update the alarms, and the time since when the status is nominal."""
        slip = tick.decision.slip
        on = bool(self.alarms) and self.alarms[-1].off_s is None
        if slip.registered and not on:
            self.alarms.append(Alarm(t_s, None))
        elif on and not slip.registered:
            self.alarms[-1] = Alarm(self.alarms[-1].on_s, t_s)
        if slip.registered or not slip.armed:
            self._nominal_since_s = None
        elif self._nominal_since_s is None:
            self._nominal_since_s = t_s

    def _hold(self, tick: Tick, truth: Truth | None, t_s: float) -> None:
        self._striker.before(tick)
        self._since_s = t_s if self._since_s is None else self._since_s
        nominal_since_s = t_s if self._nominal_since_s is None else self._nominal_since_s
        if t_s - max(self._since_s, nominal_since_s) >= NOMINAL_S + self._wait_s:
            self.before = truth
            self._tapped = True
            self._striker.strike(tick, truth)
        elif t_s - self._since_s > PATIENCE_S + self._wait_s:
            self.over = True


class TapTrial(FinishedTrial, frozen=True, kw_only=True):
    """A finished tap trial with its sequence."""

    sequence: TapSequence


class Tap(Experiment[TapConfig, TapTrial, TapResult]):
    """The tap experiment: whether the object moved, and whether slip was registered."""

    name = "tap"
    settings = TapConfig

    def configure(
        self, config: TapConfig, seeds: Sequence[int] = (), operator: Operator | None = None
    ) -> TapConfig:
        """The settings with a firm grip, without slip response, added weights (the paper added
        those for the lift only) and retreat."""
        replace = msgspec.structs.replace
        used = replace(
            config,
            object=replace(config.object, added_mass_kg=0.0),
            controller=replace(
                config.controller, firm=True, reactions=False, hold_s=operator_prompts.HOLD_S,
                retreat_m=0.0, lift_height_m=HEIGHT_M,
            ),
        )  # fmt: skip
        for seed in {used.direction(seed): seed for seed in reversed(seeds)}.values():
            swing(used, seed)  # raises before anything moves
        return used

    def act(
        self, config: TapConfig, seed: int, rig: GraspRig, guard: ForceGuard, watch: Watch,
        operator: Operator | None = None, home: Vector3 | None = None,
    ) -> TapTrial:  # fmt: skip
        impact = swing(config, seed)
        if rig.tap is not None:
            striker: SimulatedTap | OperatorTap = SimulatedTap(rig.tap, impact)
        elif operator is not None:
            striker = OperatorTap(operator, config.direction(seed), config.loop.period_s)
        else:
            raise ConfigError("rig", "tap", "no operator is there to tap the object", "an operator")
        sequence = TapSequence(impact.wait_s, striker)
        deadline_s = None if operator is None else operator_prompts.DEADLINE_S
        trial = execution.run_trial(config, rig, guard, watch, sequence.take, deadline_s, home)
        return TapTrial(**msgspec.structs.asdict(trial), sequence=sequence)

    def judge(
        self, config: TapConfig, seed: int, trial: TapTrial, recording: str | None
    ) -> TapResult:
        facts = _facts(config, trial)
        outcome = TapOutcome(trial.outcome_of(verdict(facts)))
        judged = trial.bug is None and not trial.interrupted
        motion, before = facts.motion, trial.sequence.before
        impulse_n_s = trial.sequence.impulse_n_s
        registered_s = registered_after(facts.alarms, motion.impact_s) if motion else None
        again_s = None
        if motion is not None and registered_s is not None:
            again_s = nominal_again_s(facts, last_motion_s(motion))
        measured: dict[str, Any] = {name: getattr(motion, name, None) for name in MEASURED}
        return TapResult(
            **trial.figures(config, self.name, seed),
            direction=config.direction(seed),
            success=outcome is TapOutcome.REGISTERED if judged else None,
            outcome=outcome.value,
            moved=None if motion is None or outcome in NOT_TAPPED else outcome not in UNMOVED,
            **measured,
            impulse_n_s=impulse_n_s,
            mallet_mps=mallet_speed_mps(config, impulse_n_s) if impulse_n_s is not None else None,
            slip_onset_s=motion.from_s if motion else None,
            slip_end_s=motion.until_s if motion else None,
            slip_duration_ms=later_ms(motion.from_s, motion.until_s) if motion else None,
            slip_registered_s=registered_s,
            detection_latency_ms=later_ms(first_motion_s(motion), registered_s) if motion else None,
            nominal_again_s=again_s,
            nominal_again_ms=later_ms(last_motion_s(motion), again_s) if motion else None,
            alarms=list(facts.alarms),
            watched_until_s=facts.watched_until_s if motion else None,
            grip_force_n=named(before.normal_n) if before is not None else None,
            recording=recording,
        )


tap = Tap()


def _facts(config: TapConfig, trial: TapTrial) -> TapFacts:
    """Input of the verdict."""
    before = trial.sequence.before or trial.final  # without a tap the whole trial precedes it
    return TapFacts(
        motion=trial.sequence.motion,
        alarms=trial.sequence.alarms,
        watched_until_s=trial.sequence.watched_until_s,
        peak_before_n=max(before.peak_n) if before is not None else None,
        force_bound_n=config.guard.force_limit_n + config.guard.overshoot_n,
        fault=trial.fault,
    )
