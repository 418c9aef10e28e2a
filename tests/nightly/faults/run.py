"""Runs lifts with injected faults in virtual time, and observes them until long after the end."""

import math
from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from drivers.interfaces import FINGERS, Vector3
from grasp.control.fault import lines
from grasp.control.states import END_STATES, SAFE_STATES, State
from grasp.run.loop import Tick
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs.rig import Rig
from scenarios.rigs.simulated import LinkWrappers, simulated
from scenarios.trial.execution import FinishedTrial, make_guard, run_trial
from scenarios.trial.final_state import FinalState
from scenarios.world.cell import SimulatedCell
from scenarios.world.truth import Truth
from tests.nightly.faults.cases import STANDSTILLS_S, Case, Fault, Stretch
from tests.nightly.faults.wires import (
    HEARTBEAT_NS,
    ArmWire,
    FailingDetector,
    HandWire,
    InjectedFault,
    PadWire,
    Wire,
)
from tests.nightly.last_line import FIRST_GRASP, WAY_OUT

LATER_NS, STEP_NS = 1_500_000_000, 50_000_000  # observation after the end, and its period
OFF_TABLE_M = 0.001
REACTION_S = 0.15  # from the safe state until an arm brakes, with 0.1 s of its watchdog


class Ended(msgspec.Struct, frozen=True, kw_only=True):
    """Outcome of one run. Heights and distances in m, forces in N, times in s."""

    case: Case
    injected_in: str  # phase of the injection; empty: none
    taken: int = 0  # commands that the fault suppressed
    then_taken: int = 0  # and the second of a pair
    taken_safe: bool = False  # one of them was a command of the safe state
    outcome: str
    phase: str  # the last one before the safe state
    cause: str
    timed_out: bool  # a phase or the run
    message: str  # the last line, without the remedy; empty where nothing failed
    arm: str = ""  # by the last line
    hand: str = ""
    advice: str = ""
    unconfirmed: tuple[str, ...] = ()
    finished: bool
    arm_s: float | None  # from the safe state until the arm was stationary
    hand_s: float | None  # and the fingers
    safe_mps: float  # highest speed of the arm just after the start of the safe state
    safe_way_m: float  # its distance travelled from there until long after
    arm_mps: float  # at the end of the run
    fingers_mps: float
    later_arm_mps: float
    later_fingers_mps: float
    peak_n: float
    entered_n: float | None  # by the most loaded finger, as the safe state began
    least_n: float | None  # the least of it until long after
    pressed_n: float  # at the end
    later_pressed_n: float
    lifted_m: float  # greatest height of the object
    lost_at_m: float  # height at which the hand lost it; 0: not lost, or on the table
    slid_m: float  # in the hand, in the air, since the fault
    height_m: float  # long after
    slip_mps: float


class Injection:
    """Injects the faults of a case into the wires of a rig."""

    def __init__(self) -> None:
        self.hand, self.arm, self.pads = HandWire(), ArmWire(), PadWire()
        self.detector: FailingDetector | None = None
        self.rig: Rig[Any, Any] | None = None
        self._second: tuple[Fault, bool, int] | None = None  # of a pair, and ticks until then
        self.injected_ns: list[int] = []
        self._hits: list[InjectedFault | None] = []  # the same; None: no wire concerned

    @property
    def wires(self) -> LinkWrappers:
        return LinkWrappers(self.hand.around, self.arm.around, self.pads.around)

    def begin(self, case: Case, now_ns: int) -> None:
        """Inject the case's fault now, and its second one after its delay."""
        if case.then is not None:
            self._second = case.then, case.then_recovers, case.then_ticks
        if case.fault is not None:
            self._inject(case.fault, case.recovers, now_ns)

    def tick(self, now_ns: int) -> None:
        """Advance after every control step."""
        if self._second is not None:
            fault, recovers, ticks = self._second
            self._second = fault, recovers, ticks - 1
            if ticks <= 0:
                self._second = None
                self._inject(fault, recovers, now_ns)
        self.pads.tick(now_ns)
        self.hand.tick(now_ns)

    def commands(self) -> list[str]:
        """Commands to hand and arm since the last call."""
        found = [*self.hand.commands, *self.arm.commands]
        self.hand.commands.clear()
        self.arm.commands.clear()
        return found

    def _inject(self, fault: Fault, recovers: bool, now_ns: int) -> None:
        self.injected_ns.append(now_ns)
        self._hits.append(None)
        if fault.device == "loop":
            self._pause(STANDSTILLS_S[fault.kind])
            return
        wires: dict[str, Wire | None] = {
            "gripper": self.hand, "arm": self.arm, "fingertips": self.pads,
            "detector": self.detector,
        }  # fmt: skip
        wire = wires[fault.device]
        if wire is not None:
            self._hits[-1] = hit = InjectedFault(fault, now_ns, recovers)
            wire.injected.append(hit)

    def took(self, turn: int) -> tuple[int, int]:
        """Number of commands that the first or second fault suppressed, and time of the last."""
        hit = self._hits[turn] if turn < len(self._hits) else None
        return (hit.times, hit.took_ns) if hit is not None else (0, -1)

    def _pause(self, seconds: float) -> None:
        """Pause the loop; the arm's link stops the program after its heartbeat time-out."""
        if self.rig is None:
            return
        clock = self.rig.clock
        start_ns, end_ns = clock.now_ns, clock.now_ns + round(seconds * 1e9)
        clock.sleep_until_ns(min(end_ns, start_ns + HEARTBEAT_NS))
        if end_ns > clock.now_ns:
            self.arm.stop_program(clock.now_ns)
            clock.sleep_until_ns(end_ns)


class Observer:
    """Follows arm, fingers and object by the simulated truth."""

    def __init__(self, cell: SimulatedCell) -> None:
        self._cell = cell
        self._last: Truth | None = None
        self.arm_moved_ns = self.hand_moved_ns = 0
        self.lifted_m = self.lost_at_m = self.slid_m = 0.0
        self.safe_ns: int | None = None
        self.safe_mps = self.safe_way_m = 0.0
        self._at_m: Vector3 | None = None
        self.entered_n: float | None = None
        self.least_n: float | None = None

    def take(self, truth: Truth, injected: bool, safe: bool) -> None:
        """``safe``: the safe state has begun."""
        if speed(self._cell, truth.t_ns) > 0.0:
            self.arm_moved_ns = truth.t_ns
        if safe:
            self._follow_arm(truth.t_ns)
        if np.abs(self._cell.gripper.velocity_mps).max() > 0.0:
            self.hand_moved_ns = truth.t_ns
        if injected and safe:
            most_n = max(truth.normal_n)
            self.entered_n = most_n if self.entered_n is None else self.entered_n
            self.least_n = most_n if self.least_n is None else min(self.least_n, most_n)
        self.lifted_m = max(self.lifted_m, truth.height_m)
        last, self._last = self._last, truth
        if not injected or last is None:
            return
        if last.touched and not truth.touched and last.height_m > OFF_TABLE_M:
            self.lost_at_m = max(self.lost_at_m, last.height_m)
        if last.touched and truth.touched and min(last.height_m, truth.height_m) > OFF_TABLE_M:
            self.slid_m += abs(truth.slip_distance_m - last.slip_distance_m)

    def _follow_arm(self, t_ns: int) -> None:
        here_m = self._cell.arm.at(t_ns).position_m
        if self.safe_ns is None or self._at_m is None:
            self.safe_ns, self._at_m = t_ns, here_m
        self.safe_way_m += math.dist(self._at_m, here_m)
        self._at_m = here_m
        if t_ns - self.safe_ns <= REACTION_S * 1e9:
            self.safe_mps = max(self.safe_mps, speed(self._cell, t_ns))


def speed(cell: SimulatedCell, t_ns: int) -> float:
    return float(np.linalg.norm(cell.arm.at(t_ns).velocity_mps))


class Moment:
    """Detects the time of a case's fault."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self._phase: State | None = None
        self._visits: Counter[State] = Counter()
        self._ticks = 0  # since the phase began

    def comes(self, phase: State) -> bool:
        """Call after every step; true once, at the phase, visit and tick of the case."""
        if phase is self._phase:
            self._ticks += 1
        else:
            self._phase, self._ticks = phase, 0
            self._visits[phase] += 1
        now = phase, self._visits[phase], self._ticks
        return now == (self.case.phase, self.case.visit, self.case.ticks)


class PhaseRecorder(Moment):
    """Records the phases of a lift without faults."""

    def __init__(self, scene: tuple[str, int]) -> None:
        super().__init__(Case(0, *scene, None))
        self.commands: Callable[[], list[str]] = list  # commands since the last call
        self._found: list[tuple[State, int, list[tuple[str, int]]]] = []

    def comes(self, phase: State) -> bool:
        sent = self.commands()
        if self._found:  # commands since the previous tick belong to that tick
            was, ticks, commands = self._found[-1]
            commands += [(what, ticks - 1) for what in dict.fromkeys(sent)]
            if phase is was:
                self._found[-1] = was, ticks + 1, commands
                return False
        self._found.append((phase, 1, []))
        return False

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        visits: Counter[State] = Counter()
        found = []
        for phase, ticks, commands in self._found:
            visits[phase] += 1
            found.append(Stretch(phase, visits[phase], ticks, tuple(commands)))
        return tuple(found)


@lru_cache
def schedule(name: str, seed: int) -> tuple[Stretch, ...]:
    """The phases of a lift without faults."""
    recorder = PhaseRecorder((name, seed))
    _run(recorder)
    return recorder.stretches


def run(case: Case) -> Ended:
    """Run one case in virtual time; its outcome is reproducible."""
    return _run(Moment(case))


def _run(moment: Moment) -> Ended:
    case, injection = moment.case, Injection()
    grasp = f"controller.first_grasp={FIRST_GRASP}"
    world = () if case.description is None else case.description.world
    config, true = (
        load_config(case.object, "simulated", None, None, settings).for_lift().built_for(case.seed)
        for settings in ((grasp,), (grasp, *world))
    )
    rig = injection.rig = simulated(true, case.seed, paced=False, wrappers=injection.wires)
    injection.pads.description = case.description
    cell = rig.cell
    assert isinstance(cell, SimulatedCell)
    injection.pads.of(cell.board)
    injection.arm.clock = rig.clock
    injection.detector = FailingDetector(config.make_detector(FINGERS), rig.clock)
    observer, injected_in = Observer(cell), ""
    if isinstance(moment, PhaseRecorder):
        moment.commands = injection.commands

    def watch(tick: Tick, truth: Truth | None, controller: Any) -> None:
        nonlocal injected_in
        if moment.comes(tick.decision.state):
            injected_in = tick.decision.state.value
            injection.begin(case, rig.clock.now_ns)
        injection.tick(rig.clock.now_ns)
        if truth is not None:
            observer.take(truth, bool(injection.injected_ns), tick.decision.state in SAFE_STATES)

    trial = run_trial(config, rig, make_guard(config), watch, detector=injection.detector)
    at_end, arm_mps = cell.truth(), speed(cell, rig.clock.now_ns)
    fingers_mps = float(np.abs(cell.gripper.velocity_mps).max())
    trial = msgspec.structs.replace(trial, way_out=WAY_OUT)
    safe = trial.controller.state in SAFE_STATES
    injected = bool(injection.injected_ns)
    _wait(rig, injection.arm.watch, lambda: observer.take(cell.truth(), injected, safe))
    later = cell.truth()
    outcome = lift.judge(config, case.seed, trial, None).outcome
    failure, said = trial.failure(config), trial.end(config) or FinalState("", "", "")
    arm_s, hand_s = _delays(trial, observer) if injection.injected_ns else (None, None)
    (taken, took_ns), (then_taken, then_took_ns) = injection.took(0), injection.took(1)
    safe_ns = observer.safe_ns
    return Ended(
        case=case, injected_in=injected_in, taken=taken,
        then_taken=then_taken,
        taken_safe=safe_ns is not None and max(took_ns, then_took_ns) >= safe_ns,
        outcome=outcome, phase=_phase(trial), cause=lines(trial.controller.faults),
        timed_out=bool(_codes(trial) & {"run_timeout", "phase_timeout"}),
        message="" if failure is None else failure.message,
        arm=said.arm, hand=said.hand, advice=said.advice, unconfirmed=said.unconfirmed,
        finished=trial.controller.finished and "run_timeout" not in _codes(trial),
        arm_s=arm_s, hand_s=hand_s,
        safe_mps=observer.safe_mps, safe_way_m=observer.safe_way_m, fingers_mps=fingers_mps,
        arm_mps=arm_mps, later_arm_mps=speed(cell, rig.clock.now_ns),
        later_fingers_mps=float(np.abs(cell.gripper.velocity_mps).max()),
        peak_n=max(later.peak_n), entered_n=observer.entered_n, least_n=observer.least_n,
        pressed_n=max(at_end.normal_n), later_pressed_n=max(later.normal_n),
        lifted_m=observer.lifted_m, lost_at_m=observer.lost_at_m, slid_m=observer.slid_m,
        height_m=later.height_m, slip_mps=abs(later.slip_speed_mps),
    )  # fmt: skip


def _delays(trial: FinishedTrial, observer: Observer) -> tuple[float | None, float | None]:
    """Times from the safe state until arm and fingers were stationary, s; None without one."""
    entered = [e.t_ns for e in trial.controller.machine.log if e.phase in SAFE_STATES]
    if not entered:
        return None, None
    moved_ns = observer.arm_moved_ns, observer.hand_moved_ns
    arm_s, hand_s = (max(0, t_ns - entered[0]) * 1e-9 for t_ns in moved_ns)
    return arm_s, hand_s


def _wait(rig: Rig[Any, Any], flush: Callable[[int], None], look: Callable[[], None]) -> None:
    for _ in range(LATER_NS // STEP_NS):
        rig.clock.sleep_until_ns(rig.clock.now_ns + STEP_NS)
        flush(rig.clock.now_ns)
        look()


def _phase(trial: FinishedTrial) -> str:
    """The end state, or the phase before the safe state."""
    if trial.controller.state in END_STATES:
        return trial.controller.state.value
    going = [e.phase for e in trial.controller.machine.log if e.phase not in SAFE_STATES]
    return going[-1] if going else State.START.value


def _codes(trial: FinishedTrial) -> set[str]:
    return {fault.code for fault in trial.controller.faults}
