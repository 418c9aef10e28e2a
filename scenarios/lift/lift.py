"""The object lift (paper, section V-C): grasp with too little force, lift, feel the slip, hold."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from grasp.controller import GraspController
from grasp.guard import ForceGuard
from grasp.loop import ControlLoop, Tick
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES, LiftFacts, false_start, outcome
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig, Stalls
from scenarios.trial.execution import (
    OnTick,
    Watch,
    acknowledged,
    later_ms,
    make_controller,
    make_guard,
    make_loop,
    named,
    recorded,
    run_to_end,
    stalls,
)
from scenarios.trial.result import (
    FinishedRun,
    LiftResult,
    phase_entries,
    seconds,
    timing_result,
    versions,
)
from scenarios.trial.trace import Trace
from scenarios.world.cell import Truth

SCENARIO = "lift"
DEADLINE_S = 180.0  # of virtual or wall time; each phase has its own, shorter one


class LiftTrial(msgspec.Struct, frozen=True):
    """One controller on one open rig, run to its end."""

    controller: GraspController
    loop: ControlLoop
    trace: Trace
    final: Truth | None
    stalls: Stalls
    acknowledged_ns: Sequence[int]
    real_time: bool | None  # was a real-time priority granted; None in virtual time
    interrupted: bool


def run_trial(config: LiftConfig, rig: GraspRig, guard: ForceGuard, watch: Watch) -> LiftTrial:
    """Run a controller to its end on an open rig; Ctrl-C stops the arm and keeps the grip."""
    controller = make_controller(config)
    trace = Trace()

    def take(tick: Tick) -> None:
        truth = rig.truth()
        trace.add(tick, truth)
        watch(tick, truth, controller)

    loop = make_loop(config, rig, controller, guard, take)
    interrupted, granted = run_to_end(config, rig, loop, DEADLINE_S)
    return LiftTrial(
        controller, loop, trace, rig.truth(), stalls(rig), acknowledged(rig, loop), granted,
        interrupted,
    )  # fmt: skip


def run(
    config: LiftConfig,
    seed: int,
    runs: Path | None,
    paced: bool = False,
    on_tick: OnTick = lambda tick: None,
) -> FinishedRun[LiftResult]:
    """One judged lift. With ``runs`` it leaves a folder of its own there; None records nothing.

    Raises ConfigError, CouldNotRecord and the drivers' errors for what goes wrong before the run
    begins; an error while running ends in the safe state and is reported in the result.
    """
    guard = make_guard(config)

    def attempt(watch: Watch) -> LiftTrial:
        with open_rig(config, seed, paced) as rig:
            return run_trial(config, rig, guard, watch)

    def verdict(trial: LiftTrial, recording: Path | None) -> LiftResult:
        return judge(config, seed, trial, recording)

    return recorded(config, SCENARIO, seed, runs, on_tick, attempt, verdict)


def judge(config: LiftConfig, seed: int, trial: LiftTrial, recording: Path | None) -> LiftResult:
    """Verdict and figures of a finished trial; runs the twin where only that can tell."""
    facts = _facts(config, seed, trial)
    verdict = outcome(facts, config.object, config.scoring)
    trace, end = trial.trace, trial.trace.end
    return LiftResult(
        scenario=SCENARIO,
        object=config.object.name,
        rig=config.rig,
        detector=config.detector_name,
        seed=seed,
        success=verdict in SUCCESSES,
        outcome=verdict.value,
        slip_onset_s=facts.onset_s,
        first_detection_s=seconds(trial.controller.monitor.first_detection_ns),
        slip_registered_s=facts.registered_s,
        detection_latency_ms=later_ms(facts.onset_s, facts.registered_s),
        reaction_latency_ms=later_ms(facts.onset_s, end.force_rise_s if end else None),
        slip_distance_m=end.slip_distance_m if end else None,
        peak_force_n=named(end.peak_n) if end else None,
        settled_force_n=named(end.normal_n) if end else None,
        commanded_force_n=trace.commanded_force_n,
        phases=phase_entries(trial.controller.machine.log),
        timing=timing_result(
            trial.loop.timing, trial.acknowledged_ns, trial.real_time, trial.stalls
        ),
        recording=str(recording) if recording is not None else None,
        versions=versions(),
        config_hash=config.digest(),
    )


def _facts(config: LiftConfig, seed: int, trial: LiftTrial) -> LiftFacts:
    trace, end = trial.trace, trial.trace.end
    guard = config.guard
    bound_n = guard.force_limit_n + guard.overshoot_n
    if end is not None:
        peak_n: float | None = max(end.peak_n)
    else:
        measured = trace.peak_measured_n
        peak_n = measured if trial.final is None else None
        bound_n += guard.measured_margin_n
    fault = trial.controller.fault_cause
    if not trial.controller.finished and not trial.interrupted:
        fault = fault or "the run did not end in time"
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
        fault=fault,
    )
    if not fault and trial.final is not None and false_start(facts, config.scoring):
        return msgspec.structs.replace(facts, twin_onset_s=twin_onset_s(config, seed))
    return facts


def twin_onset_s(config: LiftConfig, seed: int) -> float | None:
    """When gross slip sets in if nobody reacts: the same trial, simulated, with reactions off."""
    controller = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    twin = msgspec.structs.replace(config, rig="simulated", controller=controller)
    with open_rig(twin, seed, paced=False) as rig:
        trial = run_trial(twin, rig, make_guard(twin), lambda tick, truth, controller: None)
    return trial.final.slip_onset_s if trial.final is not None else None
