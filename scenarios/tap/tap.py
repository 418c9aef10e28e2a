"""The mallet tap (paper, section V-B): hold at the force cap, be struck, feel the slip, calm down.

Each tap is a trial of its own, a grasp from the table to being set down again, so that taps do not
walk the object through the hand. Only detection is scored: the controller is told not to answer
slip, and it could not, because a thumb that stands at the cap is latched at that force.
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from drivers.errors import ConfigError
from drivers.interfaces import Vector3
from grasp.guard import ForceGuard
from grasp.loop import Tick
from scenarios.rigs.rig import GraspRig
from scenarios.tap.blows import direction_of
from scenarios.tap.config import TapConfig
from scenarios.tap.mallet import mallet_speed_mps, swing
from scenarios.tap.result import TapResult
from scenarios.tap.scoring import (
    UNMOVED,
    UNSTRUCK,
    ObjectMotion,
    TapFacts,
    TapOutcome,
    first_motion_s,
    last_motion_s,
    nominal_again_s,
    registered_after,
    verdict,
)
from scenarios.tap.striking import PersonStrikes, TapSequence, WorldStrikes
from scenarios.trial import execution, person, series
from scenarios.trial.execution import FinishedTrial, OnTick, Watch, make_guard
from scenarios.trial.person import Operator
from scenarios.trial.result import FinishedRun, Wanted, later_ms, named
from scenarios.trial.run_folder import Record, check_runs
from scenarios.trial.series import Bench, Series
from scenarios.world.cell import Truth

SCENARIO = "tap"


class TapTrial(FinishedTrial, frozen=True):
    """A trial in which the object was struck once, if all went well."""

    sequence: TapSequence


def tap_config(config: TapConfig) -> TapConfig:
    """The settings as a tap uses them: firm grip, no answer to slip, no added weights (the paper
    added those for the lift), set down where it stood. Raises ConfigError when the status is not
    watched for long enough to be judged."""
    replace, scoring = msgspec.structs.replace, config.tap_scoring
    least_s = max(scoring.register_s, scoring.clear_s + scoring.stay_s)
    if config.tap.watch_s < least_s:
        raise ConfigError(
            "tap", "watch_s", f"{config.tap.watch_s:g} s is too short to judge a tap",
            f">= {least_s:g} s, tap_scoring.clear_s + stay_s or register_s",
        )  # fmt: skip
    return replace(
        config,
        object=replace(config.object, added_mass_kg=0.0),
        controller=replace(
            config.controller, firm=True, reactions=False, hold_s=person.HOLD_S,
            retreat_m=0.0, lift_height_m=config.tap.height_m,
        ),
    )  # fmt: skip


def run_trial(
    config: TapConfig,
    seed: int,
    rig: GraspRig,
    guard: ForceGuard,
    watch: Watch,
    operator: Operator | None = None,
    home: Vector3 | None = None,
) -> TapTrial:
    """One tap on an open rig, ``config`` from ``tap_config``. Where there is no world to deliver
    it, an operator does; Ctrl-C stops the arm and keeps the grip."""
    blow = swing(config, seed)
    if rig.tap is not None:
        hand: WorldStrikes | PersonStrikes = WorldStrikes(rig.tap, blow, config.tap)
    elif operator is not None:
        hand = PersonStrikes(operator, direction_of(config.tap, seed), config)
    else:
        raise ConfigError("rig", "tap", "nobody is there to strike the object", "an operator")
    sequence = TapSequence(config.tap, blow.wait_s, hand)

    def follow(tick: Tick, truth: Truth | None) -> bool:
        sequence.take(tick, truth)
        return sequence.over

    deadline_s = None if operator is None else person.DEADLINE_S
    trial = execution.run_trial(config, rig, guard, watch, follow, deadline_s, home)
    return TapTrial(**msgspec.structs.asdict(trial), sequence=sequence)


def run(
    config: TapConfig, seed: int, runs: Path | None, on_tick: OnTick = lambda tick: None,
    wanted: Wanted | None = None,
) -> FinishedRun[TapResult]:  # fmt: skip
    """One judged tap on a rig of its own, as ``lift.run`` is one judged lift."""
    return next(run_series(config, (seed,), Bench(runs, on_tick=on_tick, wanted=wanted)))


def run_series(config: TapConfig, seeds: Sequence[int], bench: Bench) -> Series[TapResult]:
    """One judged tap a seed, as ``scenarios.trial.series`` runs them, each recorded in a folder of
    its own."""
    config = tap_config(config)
    guard = make_guard(config)
    check_runs(bench.runs)
    first = {direction_of(config.tap, seed): seed for seed in reversed(seeds)}
    for seed in first.values():  # what cannot be had is told before anything moves
        swing(config, seed)
        config.physics(seed)

    def attempt(
        seed: int, rig: GraspRig, home: Vector3 | None
    ) -> tuple[FinishedRun[TapResult], Vector3]:
        with Record(
            config, SCENARIO, seed, bench.runs, bench.look, home, bench.wanted, rig.clock
        ) as record:
            trial = run_trial(config, seed, rig, guard, record.tick, bench.operator, home)
            finished = record.finish(trial, lambda: judge(config, seed, trial, record.path))
            return finished, trial.controller.home

    return series.run_series(config, seeds, bench, attempt)


def facts_of(config: TapConfig, trial: TapTrial) -> TapFacts:
    """What the verdict is drawn from."""
    before = trial.sequence.before or trial.final  # where nothing struck it, all is the hand's own
    return TapFacts(
        motion=trial.sequence.motion,
        alarms=trial.sequence.alarms,
        watched_until_s=trial.sequence.watched_until_s,
        own_peak_n=max(before.peak_n) if before is not None else None,
        force_bound_n=config.guard.force_limit_n + config.guard.overshoot_n,
        fault=trial.fault,
    )


def judge(config: TapConfig, seed: int, trial: TapTrial, recording: str | None) -> TapResult:
    """Verdict and figures of a finished tap."""
    facts = facts_of(config, trial)
    outcome = TapOutcome(trial.outcome_of(verdict(facts, config.tap_scoring)))
    judged = trial.bug is None and not trial.interrupted
    motion, before = facts.motion, trial.sequence.before
    registered_s = registered_after(facts.alarms, motion.struck_s) if motion else None
    again_s = (
        nominal_again_s(facts, last_motion_s(motion), config.tap_scoring.stay_s) if motion else None
    )
    impulse_n_s = trial.sequence.impulse_n_s
    return TapResult(
        **trial.figures(config, SCENARIO, seed),
        direction=direction_of(config.tap, seed),
        success=outcome is TapOutcome.REGISTERED if judged else None,
        outcome=outcome.value,
        moved=None if motion is None or outcome in UNSTRUCK else outcome not in UNMOVED,
        displacement_m=motion.displacement_m if motion else None,
        down_m=motion.down_m if motion else None,
        across_m=motion.across_m if motion else None,
        turned_rad=motion.turned_rad if motion else None,
        impulse_n_s=impulse_n_s,
        mallet_mps=mallet_speed_mps(config, impulse_n_s) if impulse_n_s is not None else None,
        struck_s=motion.struck_s if motion else None,
        slip_onset_s=motion.from_s if motion else None,
        slip_end_s=motion.until_s if motion else None,
        slip_duration_ms=later_ms(motion.from_s, motion.until_s) if motion else None,
        slip_registered_s=registered_s,
        detection_latency_ms=later_ms(first_motion_s(motion), registered_s) if motion else None,
        nominal_again_s=again_s if registered_s is not None else None,
        nominal_again_ms=_calm_ms(motion, registered_s, again_s),
        alarms=list(facts.alarms),
        watched_until_s=facts.watched_until_s if motion else None,
        grip_force_n=named(before.normal_n) if before is not None else None,
        recording=recording,
    )


def _calm_ms(
    motion: ObjectMotion | None, registered_s: float | None, again_s: float | None
) -> float | None:
    if motion is None or registered_s is None:
        return None
    return later_ms(last_motion_s(motion), again_s)
