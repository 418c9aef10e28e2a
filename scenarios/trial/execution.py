"""One controller on an open rig, run to its end and recorded: what every scenario shares."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec

from detector.decision import make_rule
from drivers.errors import ConfigError, CouldNotRecord
from drivers.interfaces import FINGER_NAMES, FINGERS, Vector3
from grasp.clock import WallClock
from grasp.controller import GraspController, GripPlan
from grasp.guard import ForceGuard
from grasp.loop import ControlLoop, Tick
from grasp.realtime import real_time
from grasp.slip import SlipMonitor
from grasp.step import GraspStep
from scenarios.rigs.rig import GraspRig, Stalls, calibration
from scenarios.trial.config import TrialConfig
from scenarios.trial.result import Failure, FinishedRun, LiftResult, TapResult
from scenarios.trial.run_folder import RunFolder
from scenarios.world.cell import Truth

FAULT = "fault"  # the outcome of every scenario that ended in a safe state

OnTick = Callable[[Tick], None]
Watch = Callable[[Tick, Truth | None, GraspController], None]
Result = TypeVar("Result", LiftResult, TapResult)


class Ended(Protocol):
    """A trial of any scenario that has run to its end."""

    @property
    def controller(self) -> GraspController: ...

    @property
    def loop(self) -> ControlLoop: ...

    @property
    def interrupted(self) -> bool: ...


TrialT = TypeVar("TrialT", bound=Ended)


def make_guard(config: TrialConfig) -> ForceGuard:
    """The guard; raises ConfigError before any device is touched if the limit cannot be kept."""
    known = calibration(config)
    guard = ForceGuard(config.guard, known.least_force_n, known.m_per_count)
    asked_n = config.controller.grip_force_n
    if asked_n < known.least_force_n:
        raise ConfigError(
            "controller",
            "grip_force_n",
            f"{asked_n:g} N is less than the gripper can be set to",
            f">= {known.least_force_n:g} N, the least force of calibration {known.name!r}",
        )
    return guard


def grip_plan(config: TrialConfig) -> GripPlan:
    """Where the fingers wait, where they grasp, and the limit that they may close to."""
    grip = config.object.grip_counts
    margin = config.controller.preshape_margin_counts
    a, b, c = (max(0, count - margin) for count in grip)
    return GripPlan((a, b, c), grip, config.guard.force_limit_n)


def make_controller(config: TrialConfig) -> GraspController:
    monitor = SlipMonitor(make_rule(config.rule, FINGERS), config.slip)
    return GraspController(config.controller, grip_plan(config), monitor)


def make_step(
    config: TrialConfig, controller: GraspController | None = None, guard: ForceGuard | None = None
) -> GraspStep:
    """What stands between a frame and the commands, as the configuration says."""
    detector = config.make_detector(FINGERS)
    return GraspStep(detector, controller or make_controller(config), guard or make_guard(config))


def make_loop(
    config: TrialConfig, rig: GraspRig, controller: GraspController, guard: ForceGuard, take: OnTick
) -> ControlLoop:
    """The control loop of one trial on an open rig."""
    step = make_step(config, controller, guard)
    return ControlLoop(rig.devices, rig.clock, step, config.loop, take)


def run_to_end(
    config: TrialConfig, rig: GraspRig, loop: ControlLoop, deadline_s: float
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


def stalls(rig: GraspRig) -> Stalls:
    """How often the rig's cell stood still so far; none where there is no cell."""
    return Stalls() if rig.stalls is None else rig.stalls()


def acknowledged(rig: GraspRig, loop: ControlLoop) -> Sequence[int]:
    """Times from a decision to the reply to the write that carries it, ns; none where there is no
    wire. A command that had nothing to write has no reply."""
    if rig.acknowledgements is None:
        return ()
    commands = loop.timing.gripper_commands_ns
    sent = [sent_ns for _, sent_ns in commands]
    at = ((bisect_right(sent, called) - 1, reply) for called, reply in rig.acknowledgements())
    return [reply_ns - commands[i][0] for i, reply_ns in at if i >= 0]


def recorded(
    config: TrialConfig, scenario: str, seed: int, runs: Path | None, on_tick: OnTick,
    attempt: Callable[[Watch], TrialT], judge: Callable[[TrialT, Path | None], Result],
) -> FinishedRun[Result]:  # fmt: skip
    """Make the attempt, judge it, and leave a folder of its own in ``runs`` (None: no folder)."""
    folder = RunFolder(runs, scenario, config, seed) if runs is not None else None

    def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        if folder is not None:
            folder.tick(tick, truth, controller)
        on_tick(tick)

    try:
        trial = attempt(watch)
        result = judge(trial, folder.recording if folder is not None else None)
    except BaseException:
        if folder is not None:
            folder.abandon()
        raise
    failure = failure_of(trial, result.outcome)
    if folder is not None:
        try:
            folder.finish(None if trial.interrupted else result)
        except CouldNotRecord as error:
            result = msgspec.structs.replace(result, recording=None)
            failure = failure or Failure(error.kind, error.message, error.remedy)
    return FinishedRun(result, failure)


def failure_of(trial: Ended, outcome: str) -> Failure | None:
    """Why the exit code is not the verdict's, if so."""
    if trial.interrupted:
        return Failure(
            "interrupted",
            f"stopped by hand in phase {trial.controller.phase}: the arm stands, the grip is kept",
            "to let go, support the object and run `grasp release`",
        )
    if outcome != FAULT:
        return None
    if trial.loop.error is not None:
        return Failure(trial.loop.error.kind, trial.loop.error.message, trial.loop.error.remedy)
    cause = trial.controller.fault_cause or "the run did not end in time"
    return Failure("safety_stop", cause, "see the phases of the result; then run `grasp release`")


def later_ms(since_s: float | None, t_s: float | None) -> float | None:
    return None if since_s is None or t_s is None else (t_s - since_s) * 1e3


def named(values: Vector3) -> dict[str, float]:
    return dict(zip(FINGER_NAMES, values, strict=True))
