"""The object lift (paper, section V-C): grasp with too little force, lift, feel the slip, hold."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

import msgspec

from detector.decision import make_rule
from drivers.errors import ConfigError
from drivers.interfaces import FINGER_NAMES, FINGERS, Vector3
from grasp.clock import WallClock
from grasp.controller import GraspController, GripPlan
from grasp.guard import ForceGuard
from grasp.loop import ControlLoop, Tick
from grasp.realtime import real_time
from grasp.slip import SlipMonitor
from scenarios.config import RunConfig
from scenarios.result import (
    Failure,
    FinishedRun,
    LiftResult,
    phase_entries,
    seconds,
    timing_result,
    versions,
)
from scenarios.rigs import Rig, Stalls, calibration, open_rig
from scenarios.runfolder import CouldNotRecord, RunFolder
from scenarios.scoring import SUCCESSES, LiftFacts, Outcome, Trace, false_start, outcome
from scenarios.world.cell import Truth

SCENARIO = "lift"
DEADLINE_S = 180.0  # of virtual or wall time; each phase has its own, shorter one

OnTick = Callable[[Tick], None]
Watch = Callable[[Tick, Truth | None, GraspController], None]


class Trial(msgspec.Struct, frozen=True):
    """One controller on one open rig, run to its end."""

    controller: GraspController
    loop: ControlLoop
    trace: Trace
    final: Truth | None
    stalls: Stalls
    acknowledged_ns: Sequence[int]
    real_time: bool | None  # was a real-time priority granted; None in virtual time
    interrupted: bool


def make_guard(config: RunConfig) -> ForceGuard:
    """The guard; raises ConfigError before any device is touched if the limit cannot be kept."""
    known = calibration(config)
    guard = ForceGuard(config.guard, known.least_force_n, known.m_per_count)
    for key in ("grip_force_n", "force_cap_n"):
        asked_n = getattr(config.controller, key)
        if asked_n < known.least_force_n:
            raise ConfigError(
                "controller",
                key,
                f"{asked_n:g} N is less than the gripper can be set to",
                f">= {known.least_force_n:g} N, the least force of calibration {known.name!r}",
            )
    return guard


def make_controller(config: RunConfig) -> GraspController:
    grip = config.object.grip_counts
    margin = config.controller.preshape_margin_counts
    a, b, c = (max(0, count - margin) for count in grip)
    monitor = SlipMonitor(make_rule(config.rule, FINGERS), config.slip)
    return GraspController(config.controller, GripPlan((a, b, c), grip), monitor)


def run_trial(config: RunConfig, rig: Rig, guard: ForceGuard, watch: Watch) -> Trial:
    """Run a controller to its end on an open rig; Ctrl-C stops the arm and keeps the grip."""
    controller = make_controller(config)
    trace = Trace()

    def take(tick: Tick) -> None:
        truth = rig.truth()
        trace.add(tick, truth)
        watch(tick, truth, controller)

    loop = make_loop(config, rig, controller, guard, take)
    interrupted, granted = run_to_end(config, rig, loop, DEADLINE_S)
    return Trial(
        controller, loop, trace, rig.truth(), stalls(rig), acknowledged(rig, loop), granted,
        interrupted,
    )  # fmt: skip


def make_loop(
    config: RunConfig, rig: Rig, controller: GraspController, guard: ForceGuard, take: OnTick
) -> ControlLoop:
    """The control loop of one trial on an open rig."""
    detector = config.make_detector(FINGERS)
    return ControlLoop(rig.devices, rig.clock, detector, controller, guard, config.loop, take)


def run_to_end(
    config: RunConfig, rig: Rig, loop: ControlLoop, deadline_s: float
) -> tuple[bool, bool | None]:
    """Run until the controller has finished. Tells whether Ctrl-C stopped it, in a safe state, and
    whether a real-time priority was granted (None in virtual time)."""
    on_wall = isinstance(rig.clock, WallClock)
    with real_time(config.realtime) if on_wall else nullcontext() as granted:
        try:
            loop.run(deadline_s)
        except KeyboardInterrupt:
            loop.interrupt()
            return True, granted
        except BaseException:  # a bug of ours must not leave the arm moving
            loop.interrupt()
            raise
    return False, granted


def stalls(rig: Rig) -> Stalls:
    """How often the rig's cell stood still so far; none where there is no cell."""
    return Stalls() if rig.stalls is None else rig.stalls()


def acknowledged(rig: Rig, loop: ControlLoop) -> Sequence[int]:
    """Times from a command to its acknowledgement, ns."""
    if rig.acknowledgements is None:
        return loop.timing.decision_to_ack_ns
    return rig.acknowledgements()


def run(
    config: RunConfig,
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
    folder = RunFolder(runs, SCENARIO, config, seed) if runs is not None else None

    def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        if folder is not None:
            folder.tick(tick, truth, controller)
        on_tick(tick)

    try:
        with open_rig(config, seed, paced) as rig:
            trial = run_trial(config, rig, guard, watch)
        result = judge(config, seed, trial, folder.recording if folder is not None else None)
    except BaseException:
        if folder is not None:
            folder.abandon()
        raise
    failure = failure_of(trial.controller, trial.loop, trial.interrupted, result.outcome)
    if folder is not None:
        try:
            folder.finish(None if trial.interrupted else result)
        except CouldNotRecord as error:
            result = msgspec.structs.replace(result, recording=None)
            failure = failure or Failure(error.kind, error.message, error.remedy)
    return FinishedRun(result, failure)


def failure_of(
    controller: GraspController, loop: ControlLoop, interrupted: bool, outcome: str
) -> Failure | None:
    """Why the exit code is not the verdict's, if so."""
    if interrupted:
        return Failure(
            "interrupted",
            f"stopped by hand in phase {controller.phase}: the arm stands, the grip is kept",
            "to let go, support the object and run `grasp release`",
        )
    if outcome != Outcome.FAULT:
        return None
    if loop.error is not None:
        return Failure(loop.error.kind, loop.error.message, loop.error.remedy)
    cause = controller.fault_cause or "the run did not end in time"
    return Failure("safety_stop", cause, "see the phases of the result; then run `grasp release`")


def judge(config: RunConfig, seed: int, trial: Trial, recording: Path | None) -> LiftResult:
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


def _facts(config: RunConfig, seed: int, trial: Trial) -> LiftFacts:
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
        closing_at_loss=trace.closing_at_loss,
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


def twin_onset_s(config: RunConfig, seed: int) -> float | None:
    """When gross slip sets in if nobody reacts: the same trial, simulated, with reactions off."""
    controller = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    twin = msgspec.structs.replace(config, rig="simulated", controller=controller)
    with open_rig(twin, seed, paced=False) as rig:
        trial = run_trial(twin, rig, make_guard(twin), lambda tick, truth, controller: None)
    return trial.final.slip_onset_s if trial.final is not None else None


def later_ms(since_s: float | None, t_s: float | None) -> float | None:
    return None if since_s is None or t_s is None else (t_s - since_s) * 1e3


def named(values: Vector3) -> dict[str, float]:
    return dict(zip(FINGER_NAMES, values, strict=True))
