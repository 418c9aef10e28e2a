"""The object lift (paper, section V-C): grasp with too little force, lift, detect slip, hold."""

from collections.abc import Sequence

import msgspec

from drivers.interfaces import Vector3
from grasp.control.guard import ForceGuard
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import (
    EARLY_S,
    SUCCESSES,
    LiftFacts,
    LiftResult,
    false_start,
    outcome,
    slip_distance_m,
)
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial import operator_prompts
from scenarios.trial.execution import FinishedTrial, Watch, make_guard, run_trial
from scenarios.trial.experiment import Experiment
from scenarios.trial.operator_prompts import Operator, SlipReading
from scenarios.trial.result import later_ms, named, seconds
from scenarios.world.settings import GRAVITY_MPS2
from scenarios.world.truth import Truth

ASKED_AFTER_S = 1.0  # pause at the top before the operator is asked for the slip distance


class Lift(Experiment[LiftConfig, FinishedTrial, LiftResult]):
    """The lift experiment: whether the object is held, and how far it slips."""

    name = "lift"
    settings = LiftConfig

    def configure(
        self, config: LiftConfig, seeds: Sequence[int] = (), operator: Operator | None = None
    ) -> LiftConfig:
        """The settings; with an operator the object is held until the slip has been read."""
        if operator is None:
            return config
        controller = msgspec.structs.replace(config.controller, hold_s=operator_prompts.HOLD_S)
        return msgspec.structs.replace(config, controller=controller)

    def act(
        self, config: LiftConfig, seed: int, rig: GraspRig, guard: ForceGuard, watch: Watch,
        operator: Operator | None = None, home: Vector3 | None = None,
    ) -> FinishedTrial:  # fmt: skip
        if operator is None:
            return run_trial(config, rig, guard, watch, home=home)
        reading = SlipReading(operator, ASKED_AFTER_S)

        def follow(tick: Tick, truth: Truth | None) -> bool:
            return reading.take(tick)

        trial = run_trial(config, rig, guard, watch, follow, operator_prompts.DEADLINE_S, home)
        return msgspec.structs.replace(trial, mark=reading.mark)

    def judge(
        self, config: LiftConfig, seed: int, trial: FinishedTrial, recording: str | None
    ) -> LiftResult:
        """Verdict and figures. If needed to detect a false start, repeats the trial in simulation
        without reactions (open loop)."""
        facts = _facts(config, seed, trial)
        verdict = outcome(facts, config.object)
        judged = trial.bug is None and not trial.interrupted
        end = trial.trace.end
        return LiftResult(
            **trial.figures(config, self.name, seed),
            success=verdict in SUCCESSES if judged else None,
            outcome=trial.outcome_of(verdict.value),
            slip_onset_s=facts.onset_s,
            first_detection_s=seconds(trial.controller.slip_monitor.first_detection_ns),
            slip_registered_s=facts.registered_s,
            detection_latency_ms=later_ms(facts.onset_s, facts.registered_s),
            reaction_latency_ms=later_ms(facts.onset_s, end.force_rise_s if end else None),
            slip_distance_m=slip_distance_m(facts),
            turned_rad=end.turn_rad if end else None,
            over_least=_over_least(config, end),
            settled_force_n=named(end.normal_n) if end else None,
            alarm_stayed=trial.controller.alarm_stayed,
            recording=recording,
        )


lift = Lift()


def _facts(config: LiftConfig, seed: int, trial: FinishedTrial) -> LiftFacts:
    trace, end = trial.trace, trial.trace.end
    guard = config.guard
    bound_n = guard.force_limit_n + guard.overshoot_n
    peak_n: float | None
    if trial.final is not None:  # whole contact, lowering included
        peak_n = max(trial.final.peak_n)
    else:
        # a fault may corrupt the estimated force
        peak_n = None if trial.fault else max(trace.peak_estimated_n)
        bound_n += guard.estimate_margin_n
    facts = LiftFacts(
        end=end,
        estimated_n=trace.estimated_n,
        had_compensated=trace.had_compensated,
        registered_s=seconds(trace.registered_ns),
        onset_s=end.slip_onset_s if end is not None else None,
        open_loop_onset_s=None,
        peak_force_n=peak_n,
        force_bound_n=bound_n,
        limit_reached=trial.controller.limit_reached,
        alarm_stayed=trial.controller.alarm_stayed and not config.controller.hold_by_clock,
        fault=trial.fault,
        by_touch=config.controller.first_grasp == "touch",
        contact_lost=_contact_lost(config, trial),
        lost_at_m=trace.lost_at_m,
        mark=trial.mark,
    )
    judged = not trial.fault and not trial.interrupted
    if judged and trial.final is not None and facts.registered_s and false_start(facts):
        onset_s = open_loop_onset_s(config, seed, facts.registered_s + EARLY_S)
        return msgspec.structs.replace(facts, open_loop_onset_s=onset_s)
    return facts


def _over_least(config: LiftConfig, end: Truth | None) -> float | None:
    if end is None or not end.touched:
        return None
    accelerated = GRAVITY_MPS2 + config.controller.lift_acceleration_mps2
    return end.normal_n[0] / config.object.least_holding_n(accelerated)


def _contact_lost(config: LiftConfig, trial: FinishedTrial) -> bool:
    last = trial.trace.last
    if last is None or trial.controller.state is not State.LOST:
        return False
    return max(last.observation.responsive_n) < config.controller.contact_n


def open_loop_onset_s(config: LiftConfig, seed: int, until_s: float | None = None) -> float | None:
    """Onset of gross slip in the same trial simulated without reactions, s; None: no slip, in the
    whole lift or at least up to ``until_s``."""
    controller = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    open_loop = msgspec.structs.replace(config, rig="simulated", controller=controller)
    with open_rig(open_loop.built_for(seed), seed, paced=False) as rig:
        guard = make_guard(open_loop)
        left_s = None if until_s is None else until_s - rig.clock.now_ns * 1e-9
        trial = run_trial(
            open_loop, rig, guard, lambda tick, truth, controller: None, deadline_s=left_s
        )
    return trial.final.slip_onset_s if trial.final is not None else None
