"""The object lift (paper, section V-C): grasp with too little force, lift, feel the slip, hold."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from drivers.interfaces import Vector3
from grasp.guard import ForceGuard
from grasp.loop import Tick
from scenarios.lift.config import LiftConfig
from scenarios.lift.result import LiftResult
from scenarios.lift.scoring import (
    SUCCESSES,
    LiftFacts,
    false_start,
    outcome,
    slip_distance_m,
)
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial import person, series
from scenarios.trial.execution import FinishedTrial, OnTick, Watch, make_guard, run_trial
from scenarios.trial.person import Operator, SlipReading, TapeMark
from scenarios.trial.result import FinishedRun, Wanted, later_ms, named, seconds
from scenarios.trial.run_folder import Record, check_runs
from scenarios.trial.series import Bench, Series
from scenarios.world.cell import Truth

SCENARIO = "lift"


def held_for(config: LiftConfig, operator: Operator | None) -> LiftConfig:
    """The settings as a lift uses them: with a person, held until the slip has been read."""
    if operator is None:
        return config
    controller = msgspec.structs.replace(config.controller, hold_s=person.HOLD_S)
    return msgspec.structs.replace(config, controller=controller)


def run(
    config: LiftConfig, seed: int, runs: Path | None, on_tick: OnTick = lambda tick: None,
    wanted: Wanted | None = None,
) -> FinishedRun[LiftResult]:  # fmt: skip
    """One judged lift. With ``runs`` it leaves a folder of its own there, or only if its result is
    ``wanted``; None records nothing.

    Raises ConfigError, CouldNotRecord and the drivers' errors for what goes wrong before the run
    begins; an error while running ends in the safe state and is reported in the result.
    """
    return next(run_series(config, (seed,), Bench(runs, on_tick=on_tick, wanted=wanted)))


def run_series(config: LiftConfig, seeds: Sequence[int], bench: Bench) -> Series[LiftResult]:
    """One judged lift a seed, as ``scenarios.trial.series`` runs them."""
    guard, operator = make_guard(config), bench.operator
    check_runs(bench.runs)
    held = held_for(config, operator)

    def attempt(
        seed: int, rig: GraspRig, home: Vector3 | None
    ) -> tuple[FinishedRun[LiftResult], Vector3]:
        reading = None if operator is None else SlipReading(operator, config.controller.hold_s)
        with Record(
            held, SCENARIO, seed, bench.runs, bench.look, home, bench.wanted, rig.clock
        ) as record:
            trial = _run_trial(held, rig, guard, record.tick, reading, home)
            mark = None if reading is None else reading.mark
            finished = record.finish(trial, lambda: judge(held, seed, trial, record.path, mark))
            return finished, trial.controller.home

    return series.run_series(held, seeds, bench, attempt)


def _run_trial(
    config: LiftConfig, rig: GraspRig, guard: ForceGuard, watch: Watch, reading: SlipReading | None,
    home: Vector3 | None,
) -> FinishedTrial:  # fmt: skip
    if reading is None:
        return run_trial(config, rig, guard, watch, home=home)

    def follow(tick: Tick, truth: Truth | None) -> bool:
        return reading.take(tick)

    return run_trial(config, rig, guard, watch, follow, person.DEADLINE_S, home)


def judge(
    config: LiftConfig, seed: int, trial: FinishedTrial, recording: str | None,
    mark: TapeMark | None = None,
) -> LiftResult:  # fmt: skip
    """Verdict and figures of a finished trial; runs the twin where only that can tell. ``mark``:
    what a person read, where no world knows."""
    facts = msgspec.structs.replace(_facts(config, seed, trial), mark=mark)
    verdict = outcome(facts, config.object, config.scoring)
    judged = trial.bug is None and not trial.interrupted
    end = trial.trace.end
    return LiftResult(
        **trial.figures(config, SCENARIO, seed),
        success=verdict in SUCCESSES if judged else None,
        outcome=trial.outcome_of(verdict.value),
        slip_onset_s=facts.onset_s,
        first_detection_s=seconds(trial.controller.monitor.first_detection_ns),
        slip_registered_s=facts.registered_s,
        detection_latency_ms=later_ms(facts.onset_s, facts.registered_s),
        reaction_latency_ms=later_ms(facts.onset_s, end.force_rise_s if end else None),
        slip_distance_m=slip_distance_m(facts),
        turned_rad=end.turn_rad if end else None,
        settled_force_n=named(end.normal_n) if end else None,
        alarm_stayed=trial.controller.alarm_stayed,
        recording=recording,
    )


def _facts(config: LiftConfig, seed: int, trial: FinishedTrial) -> LiftFacts:
    trace, end = trial.trace, trial.trace.end
    guard = config.guard
    bound_n = guard.force_limit_n + guard.overshoot_n
    peak_n: float | None
    if trial.final is not None:  # from first contact to the last, setting down included
        peak_n = max(trial.final.peak_n)
    else:
        peak_n = None if trial.fault else max(trace.peak_measured_n)  # which a fault may belie
        bound_n += guard.measured_margin_n
    facts = LiftFacts(
        end=end,
        felt_n=trace.felt_n,
        had_compensated=trace.had_compensated,
        registered_s=seconds(trace.registered_ns),
        onset_s=end.slip_onset_s if end is not None else None,
        twin_onset_s=None,
        peak_force_n=peak_n,
        force_bound_n=bound_n,
        cap_reached=trial.controller.cap_reached,
        alarm_stayed=trial.controller.alarm_stayed and not config.controller.hold_by_clock,
        fault=trial.fault,
        let_go_m=trace.let_go_m,
    )
    judged = not trial.fault and not trial.interrupted
    if judged and trial.final is not None and false_start(facts, config.scoring):
        return msgspec.structs.replace(facts, twin_onset_s=twin_onset_s(config, seed))
    return facts


def twin_onset_s(config: LiftConfig, seed: int) -> float | None:
    """When gross slip sets in if nobody reacts: the same trial, simulated, with reactions off."""
    controller = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    twin = msgspec.structs.replace(config, rig="simulated", controller=controller)
    with open_rig(twin.built_for(seed), seed, paced=False) as rig:
        trial = run_trial(twin, rig, make_guard(twin), lambda tick, truth, controller: None)
    return trial.final.slip_onset_s if trial.final is not None else None
