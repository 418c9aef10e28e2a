"""Runs one controller on an open rig to its end: the part that all experiments share."""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from typing import Any

import msgspec

from detector.decision import DecisionRule
from detector.interface import SlipDetector
from detector.loading import motion_reader
from drivers.errors import GraspError, counted
from drivers.interfaces import FINGER_NAMES, FINGERS, Vector3
from grasp.control.contact_estimator import Stiffness
from grasp.control.controller import GraspController
from grasp.control.controller_settings import ControllerSettings, GripPlan
from grasp.control.fault import INTERNAL, INTERRUPTED, LOST, SAFETY_STOP, TRIAL, WORLD, Fault, lines
from grasp.control.guard import ForceGuard
from grasp.control.monitors.checks import STOOD_STILL, Monitors
from grasp.control.slip_monitor import SlipMonitor
from grasp.control.states import State
from grasp.control.step import AnyController, GraspStep
from grasp.run import signals
from grasp.run.loop import ControlLoop, Tick
from grasp.run.realtime import real_time
from scenarios.rigs.calibration import calibration
from scenarios.rigs.config import HARDWARE
from scenarios.rigs.permission import arm_address
from scenarios.rigs.rig import GraspRig, Stalls
from scenarios.trial.config import TrialConfig
from scenarios.trial.feasibility import (
    bounded_by_travel,
    check_arm,
    check_grip,
    check_override,
    check_touch,
    check_waits,
)
from scenarios.trial.final_state import FinalState, end_message, final_state
from scenarios.trial.operator_prompts import TapeMark
from scenarios.trial.result import (
    REPORT,
    Bug,
    Failure,
    GripFound,
    named,
    phase_entries,
    timing_result,
    versions,
)
from scenarios.trial.trace import Trace
from scenarios.world.settings import HALF_APERTURE_M
from scenarios.world.truth import Truth

INTERNAL_ERROR = "internal_error"  # outcome of a run that an unexpected exception ended

# Before a grasp at given counts the fingers wait short of it, the thumb further back; assumed
PRESHAPE_COUNTS, THUMB_BACK_COUNTS = 15, 15

OnTick = Callable[[Tick], None]
Watch = Callable[[Tick, Truth | None, GraspController], None]
# the experiment's part of a control step; True: set the object down
Follow = Callable[[Tick, Truth | None], bool]


def make_guard(config: TrialConfig) -> ForceGuard:
    """The force guard. Raises ConfigError before any device is used if the force limit cannot be
    kept, or a command of the controller would exceed the arm's limits."""
    check_arm(config)
    check_waits(config)
    check_override(config)
    check_touch(config)
    known = calibration(config)
    guard = ForceGuard(
        config.guard,
        known.least_force_n,
        stiffness(config),
        known.least_speed_mps,
        grip_plan(config).preshape_counts,
        touch=config.controller.first_grasp == "touch",
        travel_bound=bounded_by_travel(config),
    )
    check_grip(config, guard)
    return guard


def grip_plan(config: TrialConfig, home: Vector3 | None = None) -> GripPlan:
    """Finger positions before and at the grasp, and the force limit."""
    if config.controller.first_grasp == "touch":  # the open hand, and no counts
        open_hand = (0, 0, 0)
        return GripPlan(open_hand, open_hand, config.guard.force_limit_n, stiffness(config), home)
    a, b, c = grip = config.object.grip_counts
    thumb = max(0, a - PRESHAPE_COUNTS - THUMB_BACK_COUNTS)
    preshape = thumb, max(0, b - PRESHAPE_COUNTS), max(0, c - PRESHAPE_COUNTS)
    return GripPlan(preshape, grip, config.guard.force_limit_n, stiffness(config), home)


def stiffness(config: TrialConfig) -> Stiffness:
    """Contact stiffness: the object's value, or the worst case of the guard."""
    stated_npm = config.object.contact_stiffness_npm or config.guard.contact_stiffness_npm
    return Stiffness(stated_npm * calibration(config).m_per_count)


def patience_s(config: TrialConfig) -> float:
    """Time for which slip may stay registered after the last closing, s: at least the detector's
    window, because an alarm can stem from its oldest sample."""
    return max(config.controller.limit_patience_s, config.memory_s)


def controller_parts(
    config: TrialConfig, home: Vector3 | None = None
) -> tuple[ControllerSettings, GripPlan, SlipMonitor]:
    """Settings, plan and slip monitor of a controller; ``home``: see ``make_controller``."""
    monitor = SlipMonitor(DecisionRule(config.rule, FINGERS), config.slip)
    settings = msgspec.structs.replace(config.controller, limit_patience_s=patience_s(config))
    return settings, grip_plan(config, home), monitor


def make_controller(config: TrialConfig, home: Vector3 | None = None) -> GraspController:
    """The controller; ``home`` is the arm's position from an earlier run, None: where it is now."""
    return GraspController(*controller_parts(config, home))


def make_step(
    config: TrialConfig,
    controller: AnyController,
    guard: ForceGuard | None = None,
    monitors: Monitors | None = None,
    detector: SlipDetector | None = None,
) -> GraspStep[AnyController]:
    """The computation from frame to commands, as configured; arguments replace single parts."""
    detector = detector or config.make_detector(FINGERS)
    return GraspStep(
        detector,
        controller,
        guard or make_guard(config),
        monitors or Monitors(config.monitors),
        motion_reader(detector),
    )


def make_loop(
    config: TrialConfig, rig: GraspRig, controller: GraspController, guard: ForceGuard,
    take: OnTick, detector: SlipDetector | None = None,
) -> ControlLoop:  # fmt: skip
    """The control loop of one trial on an open rig."""
    step = make_step(config, controller, guard, detector=detector)
    return ControlLoop(rig.devices, rig.clock, step, config.loop, take)


class FinishedTrial(msgspec.Struct, frozen=True):
    """Outcome of ``run_trial``: controller, loop, trace and the world's last state."""

    controller: GraspController
    loop: ControlLoop
    trace: Trace
    final: Truth | None
    stalls: Stalls
    acknowledged_ns: Sequence[int]
    real_time: bool | None  # whether a real-time priority was granted; None in virtual time
    bug: Bug | None  # the unexpected exception that ended it
    way_out: str  # how to open a hand that was left closed; empty where its cell has ended
    engine: str | None = None  # what computed the network
    grip: GripFound | None = None  # found by touch
    mark: TapeMark | None = None  # the operator's reading at the top of a lift

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Causes of an early end; an unexpected exception replaces all others."""
        bug = () if self.bug is None else (self.bug.fault,)
        return bug or self.controller.faults

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C or a signal ended it."""
        return any(fault.kind == INTERRUPTED for fault in self.faults)

    @property
    def fault(self) -> str:
        """Reason why there is no verdict, as text; empty where there is one, or a signal ended
        it."""
        return lines(fault for fault in self.faults if fault.kind not in (INTERRUPTED, LOST))

    def outcome_of(self, verdict: str) -> str:
        """Name of the outcome: the verdict, or why there is none."""
        if self.bug is not None:
            return INTERNAL_ERROR
        return INTERRUPTED if self.interrupted else verdict

    def end(self, config: TrialConfig) -> FinalState | None:
        """Final state of arm and hand; None where the run did not end in the safe state."""
        controller = self.controller
        if not controller.in_safe_state and self.bug is None:
            return None
        old_s, trace = config.controller.stale_after_s, self.trace
        faults = (*controller.faults, *controller.later_faults)
        errors = tuple(self.loop.errors.values())
        end = final_state(trace.last, trace.hand, old_s, self.way_out, faults, errors)
        unconfirmed = controller.unconfirmed
        ended = controller.finished and not controller.in_safe_state  # no safe state was requested
        if self.bug is not None and trace.last is not None and not ended:
            unconfirmed = ("the safe state of arm and hand could not be checked",)
            with suppress(Exception):
                missing = controller.unconfirmed_parts(trace.last.observation)
                unconfirmed = (*missing.arm, *missing.hand)
        return msgspec.structs.replace(
            end, unconfirmed=unconfirmed, later_faults=controller.later_faults, where=self._where
        )

    @property
    def _where(self) -> str:
        """The phase in which it ended, and how far the arm was above the grasp."""
        machine, last, home = self.controller.machine, self.trace.last, self.home
        phase = f"in phase {machine.before if self.controller.in_safe_state else machine.state}"
        if last is None or home is None:
            return phase
        height_m = last.arm.position_m[2] - home[2]
        if not math.isfinite(height_m):
            return f"{phase}, at an unknown height"
        return f"{phase}, {round(height_m * 1e3)} mm above the grasp"

    @property
    def home(self) -> Vector3 | None:
        """Home position of the arm; None where the run ended before it was taken."""
        log = self.controller.machine.log
        return self.controller.home if log and log[0].phase in (State.HOME, State.SHAPE) else None

    def failure(self, config: TrialConfig) -> Failure | None:
        """Reason for an exit code other than the verdict's; None where the verdict decides."""
        faults, end = self.faults, self.end(config)
        if not faults or faults[0].kind == LOST:
            return None
        if self.bug is not None:
            return Failure(INTERNAL, faults[0].line, REPORT, end, faults)
        errors, last = tuple(self.loop.errors.values()), self.trace.last
        old_s = config.controller.stale_after_s
        message, remedy = end_message(faults, errors, last, old_s)
        kind = (*errors, *faults)[0].kind
        if self.interrupted:
            message, _ = end_message((), errors, last, old_s)
            where = f"{lines(faults)} in phase {self.controller.machine.before}"
            message, kind, remedy = "; ".join(filter(None, (where, message))), INTERRUPTED, ""
        elif any(fault.code == STOOD_STILL for fault in faults):
            kind = SAFETY_STOP
        message = "; then ".join((message, *(fault.line for fault in self.controller.later_faults)))
        return Failure(kind, message, remedy, end, faults)

    def figures(self, config: TrialConfig, scenario: str, seed: int) -> dict[str, Any]:
        """Values of the fields of ``TrialResult`` that are the same for all experiments."""
        return {
            "scenario": scenario,
            "object": config.object.name,
            "rig": config.rig,
            "detector": config.detector_label,
            "engine": self.engine,
            "grip": self.grip,
            "seed": seed,
            "peak_force_n": named(self.final.peak_n) if self.final is not None else None,
            "peak_estimated_n": named(self.trace.peak_estimated_n),
            "commanded_force_n": self.trace.commanded_force_n,
            "force_limit_n": config.guard.force_limit_n,
            "limit_mode": config.guard.limit_mode,
            "paused_s": round(self.controller.response.paused_s, 3),
            "taxels_at_rail": dict(zip(FINGER_NAMES, self.trace.taxels_at_rail, strict=True)),
            "phases": phase_entries(self.controller.machine.log),
            "timing": timing_result(
                self.loop.timing, self.acknowledged_ns, self.real_time, self.stalls
            ),
            "versions": versions(),
            "config_hash": config.digest(),
            "detector_hash": config.detector_hash(),
            "end": self.end(config),
            "faults": self.faults,
            "reported": self.trace.reported,
            "bug": self.bug,
            "hidden": dict(self.loop.hidden),
            "arm": arm_address(config) if config.rig == HARDWARE else None,
            "home_m": self.home,
            "physics": config.physics(seed),
        }


def run_trial(
    config: TrialConfig, rig: GraspRig, guard: ForceGuard, watch: Watch,
    follow: Follow | None = None, deadline_s: float | None = None,
    home: Vector3 | None = None, detector: SlipDetector | None = None,
) -> FinishedTrial:  # fmt: skip
    """Run a controller to its end on an open rig.

    Ctrl-C stops the arm and keeps the grip; an unexpected exception ends the run like a fault.
    ``deadline_s`` replaces ``loop.deadline_s`` where an operator takes part. ``home``: the arm's
    home from an earlier trial on this rig (``controller.home``). ``detector`` replaces the selected
    one.
    """
    controller, detector = make_controller(config, home), detector or config.make_detector(FINGERS)
    trace, read_truth = Trace(), rig.read_truth

    def look() -> Truth | None:
        """The simulated truth; a lost simulation counts as a device error and is not read again."""
        if read_truth is None or WORLD in loop.errors:
            return None
        try:
            return read_truth()
        except GraspError as error:
            loop.note(WORLD, error)
            return None

    def take(tick: Tick) -> None:
        if bugs:  # any of these calls may have raised: the safe state does not need them
            trace.add(tick, None)
            with counted(loop.hidden):
                watch(tick, None, controller)
            return
        truth = look()
        trace.add(tick, truth)
        if follow is not None:
            loop.set_down = follow(tick, truth)
        watch(tick, truth, controller)

    bugs: list[Bug] = []
    loop = make_loop(config, rig, controller, guard, take, detector)
    # virtual time moves no real device, and one of its steps may take longer than a second
    with signals.watched() if rig.wall_time else nullcontext():
        granted = _run_to_end(
            config, rig, loop, config.loop.deadline_s if deadline_s is None else deadline_s, bugs,
            trace,
        )  # fmt: skip
    final, stalls = None, Stalls()
    with counted(loop.hidden) if bugs else nullcontext():
        final = look()
        stalls = stalls if WORLD in loop.errors else rig.stalls()
    return FinishedTrial(
        controller, loop, trace, final, stalls, acknowledged(rig, loop), granted,
        bugs[0] if bugs else None, rig.release_hint,
        engine=getattr(getattr(detector, "engine", None), "name", None),
        grip=grip_found(config, guard, trace.held_n),
    )  # fmt: skip


def grip_found(config: TrialConfig, guard: ForceGuard, held_n: Vector3 | None) -> GripFound | None:
    """What the first grasp found by touch; None without one that was complete."""
    grip, known = guard.grip, calibration(config)
    if grip is None or grip.first is None:
        return None
    thumb, *others = grip.first.positions
    closed_m = known.m_per_count * thumb, known.m_per_count * max(others)
    weak = known.least_force_n <= config.guard.force_limit_n
    return GripFound(
        width_m=2.0 * HALF_APERTURE_M - sum(closed_m),
        nearer_thumb_m=(closed_m[1] - closed_m[0]) / 2.0,
        first_force_n=grip.first.force_n,
        held_sides_n=None if held_n is None else (held_n[0], held_n[1] + held_n[2]),
        stiffness_npm=grip.rise_n / known.m_per_count,
        stiffness_measured=grip.rise_n != stiffness(config).newtons_per_count,
        bound="force byte and travel" if weak else "travel",
        stalled_n=guard.stalled_n,
        commanded_n=max(known.least_force_n, config.guard.force_limit_n),
    )


def _run_to_end(
    config: TrialConfig, rig: GraspRig, loop: ControlLoop, deadline_s: float, bugs: list[Bug],
    trace: Trace,
) -> bool | None:  # fmt: skip
    """Run until the controller has finished; returns whether a real-time priority was granted (None
    in virtual time). An unexpected exception is added to ``bugs`` before the safe state begins."""
    with real_time(config.realtime) if rig.wall_time else nullcontext() as granted:
        try:
            _run_or_stop(loop, deadline_s)
        except BaseException as error:  # the outermost handler: it brings arm and hand to safety
            bugs.append(Bug.of(error))
            _end_as_a_fault(loop, bugs[0], trace)
        return granted


def _end_as_a_fault(loop: ControlLoop, bug: Bug, trace: Trace) -> None:
    try:
        loop.fail(bug.fault)
    except BaseException:  # the control step itself is broken
        _abort(loop, trace)


def _abort(loop: ControlLoop, trace: Trace) -> None:
    """End without the control step."""
    left = loop.abort()
    if left is not None:
        trace.last = left
        with counted(loop.hidden):
            trace.add(left, None)


def _run_or_stop(loop: ControlLoop, deadline_s: float) -> None:
    try:
        loop.run(deadline_s)
    except signals.Stuck:  # handled like a bug: it may interrupt a step anywhere
        raise
    except KeyboardInterrupt as stop:
        loop.stop(Fault(INTERRUPTED, TRIAL, signals.cause(stop), kind=INTERRUPTED))


def acknowledged(rig: GraspRig, loop: ControlLoop) -> Sequence[int]:
    """Times from a decision to the reply to its write, ns; empty without a wire. A command that
    changed no register has no reply."""
    commands = loop.timing.gripper_commands_ns
    sent = [sent_ns for _, sent_ns in commands]
    at = ((bisect_right(sent, called) - 1, reply) for called, reply in rig.acknowledgements())
    return [reply_ns - commands[i][0] for i, reply_ns in at if i >= 0]
