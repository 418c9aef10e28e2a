"""Lifts in virtual time in which something fails, and what came of them until long after."""

import math
from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from drivers.interfaces import FINGERS, Vector3
from grasp.loop import Tick
from grasp.states import END_STATES, SAFE_STATES, State
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs.rig import Rig
from scenarios.rigs.simulated import LinkWrappers, simulated
from scenarios.trial.ending import End
from scenarios.trial.execution import FinishedTrial, make_guard, run_trial
from scenarios.world.cell import SimulatedCell
from scenarios.world.truth import Truth
from tests.nightly.faults.cases import STANDSTILLS_S, Case, Fault, Stretch
from tests.nightly.faults.wires import (
    HEARTBEAT_NS,
    ArmWire,
    FailingDetector,
    HandWire,
    PadWire,
    Struck,
    Wire,
)
from tests.nightly.last_line import WAY_OUT

LATER_NS, STEP_NS = 1_500_000_000, 50_000_000  # everything under way has ended by then
OFF_TABLE_M = 0.001
REACTION_S = 0.15  # from the safe state until an arm brakes: its own watchdog takes 0.1 s of it


class Ended(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one run. Heights and ways in m, forces in N, times in s."""

    case: Case
    struck_in: str  # phase that was under way; empty: never struck
    taken: int = 0  # commands that the fault took
    then_taken: int = 0  # and the second of a pair
    taken_safe: bool = False  # one of them was the safe state's own
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
    arm_s: float | None  # from the safe state until the arm stood for good
    hand_s: float | None  # and the fingers
    safe_mps: float  # highest speed of the arm as the safe state had just begun
    safe_way_m: float  # its way from there until long after
    arm_mps: float  # at the end of the run
    fingers_mps: float
    later_arm_mps: float
    later_fingers_mps: float
    peak_n: float
    entered_n: float | None  # by the most loaded finger, as the safe state began
    least_n: float | None  # the least of it until long after
    pressed_n: float  # at the end
    later_pressed_n: float
    lifted_m: float  # the highest that the object came
    let_go_m: float  # height at which the hand lost it; 0: it did not, or on the table
    slid_m: float  # in the hand, in the air, since the fault
    height_m: float  # long after
    slip_mps: float


class Attack:
    """The wires of a rig, and when they are struck."""

    def __init__(self) -> None:
        self.hand, self.arm, self.pads = HandWire(), ArmWire(), PadWire()
        self.detector: FailingDetector | None = None
        self.rig: Rig[Any, Any] | None = None
        self._second: tuple[Fault, bool, int] | None = None  # of a pair, and ticks until then
        self.impact_ns: list[int] = []
        self._hits: list[Struck | None] = []  # the same; None: no wire was struck

    @property
    def wires(self) -> LinkWrappers:
        return LinkWrappers(self.hand.around, self.arm.around, self.pads.around)

    def begin(self, case: Case, now_ns: int) -> None:
        """The case's fault strikes now, its second one as long after as it says."""
        if case.then is not None:
            self._second = case.then, case.then_recovers, case.then_ticks
        if case.fault is not None:
            self._strike(case.fault, case.recovers, now_ns)

    def tick(self, now_ns: int) -> None:
        """After every step."""
        if self._second is not None:
            fault, recovers, ticks = self._second
            self._second = fault, recovers, ticks - 1
            if ticks <= 0:
                self._second = None
                self._strike(fault, recovers, now_ns)
        self.pads.tick(now_ns)
        self.hand.tick(now_ns)

    def told(self) -> list[str]:
        """Commands to hand and arm since the last call."""
        found = [*self.hand.told, *self.arm.told]
        self.hand.told.clear()
        self.arm.told.clear()
        return found

    def _strike(self, fault: Fault, recovers: bool, now_ns: int) -> None:
        self.impact_ns.append(now_ns)
        self._hits.append(None)
        if fault.device == "loop":
            self._stand_still(STANDSTILLS_S[fault.kind])
            return
        wires: dict[str, Wire | None] = {
            "gripper": self.hand, "arm": self.arm, "fingertips": self.pads,
            "detector": self.detector,
        }  # fmt: skip
        wire = wires[fault.device]
        if wire is not None:
            self._hits[-1] = hit = Struck(fault, now_ns, recovers)
            wire.struck.append(hit)

    def took(self, turn: int) -> tuple[int, int]:
        """How many commands the first or second fault took, and when the last of them."""
        hit = self._hits[turn] if turn < len(self._hits) else None
        return (hit.times, hit.took_ns) if hit is not None else (0, -1)

    def _stand_still(self, seconds: float) -> None:
        """Nobody is in control; the arm's link takes its client for dead after a while."""
        if self.rig is None:
            return
        clock = self.rig.clock
        start_ns, end_ns = clock.now_ns, clock.now_ns + round(seconds * 1e9)
        clock.sleep_until_ns(min(end_ns, start_ns + HEARTBEAT_NS))
        if end_ns > clock.now_ns:
            self.arm.unheard(clock.now_ns)
            clock.sleep_until_ns(end_ns)


class Observer:
    """Follows arm, fingers and object by what the simulation knows."""

    def __init__(self, cell: SimulatedCell) -> None:
        self._cell = cell
        self._last: Truth | None = None
        self.arm_moved_ns = self.hand_moved_ns = 0
        self.lifted_m = self.let_go_m = self.slid_m = 0.0
        self.safe_ns: int | None = None
        self.safe_mps = self.safe_way_m = 0.0
        self._at_m: Vector3 | None = None
        self.entered_n: float | None = None
        self.least_n: float | None = None

    def take(self, truth: Truth, struck: bool, safe: bool) -> None:
        """``safe``: the safe state has begun."""
        if speed(self._cell, truth.t_ns) > 0.0:
            self.arm_moved_ns = truth.t_ns
        if safe:
            self._follow_arm(truth.t_ns)
        if np.abs(self._cell.gripper.velocity_mps).max() > 0.0:
            self.hand_moved_ns = truth.t_ns
        if struck and safe:
            most_n = max(truth.normal_n)
            self.entered_n = most_n if self.entered_n is None else self.entered_n
            self.least_n = most_n if self.least_n is None else min(self.least_n, most_n)
        self.lifted_m = max(self.lifted_m, truth.height_m)
        last, self._last = self._last, truth
        if not struck or last is None:
            return
        if last.touched and not truth.touched and last.height_m > OFF_TABLE_M:
            self.let_go_m = max(self.let_go_m, last.height_m)
        if last.touched and truth.touched and min(last.height_m, truth.height_m) > OFF_TABLE_M:
            self.slid_m += abs(truth.slip_distance_m - last.slip_distance_m)

    def _follow_arm(self, t_ns: int) -> None:
        here_m = self._cell.arm.position(t_ns)
        if self.safe_ns is None or self._at_m is None:
            self.safe_ns, self._at_m = t_ns, here_m
        self.safe_way_m += math.dist(self._at_m, here_m)
        self._at_m = here_m
        if t_ns - self.safe_ns <= REACTION_S * 1e9:
            self.safe_mps = max(self.safe_mps, speed(self._cell, t_ns))


def speed(cell: SimulatedCell, t_ns: int) -> float:
    return float(np.linalg.norm(cell.arm.velocity(t_ns)))


class Moment:
    """Says when the case's moment has come."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self._phase: State | None = None
        self._visits: Counter[State] = Counter()
        self._ticks = 0  # since the phase began

    def comes(self, phase: State) -> bool:
        """After every step; true once, in the case's own phase and at its own visit."""
        if phase is self._phase:
            self._ticks += 1
        else:
            self._phase, self._ticks = phase, 0
            self._visits[phase] += 1
        now = phase, self._visits[phase], self._ticks
        return now == (self.case.phase, self.case.visit, self.case.ticks)


class Plain(Moment):
    """A plain lift whose stretches are noted."""

    def __init__(self, scene: tuple[str, int]) -> None:
        super().__init__(Case(0, *scene, None))
        self.told: Callable[[], list[str]] = list  # commands since the last call
        self._found: list[tuple[State, int, list[tuple[str, int]]]] = []

    def comes(self, phase: State) -> bool:
        sent = self.told()
        if self._found:  # what was sent since the tick before belongs to that
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
    """The stretches of a plain lift."""
    plain = Plain((name, seed))
    _run(plain)
    return plain.stretches


def run(case: Case) -> Ended:
    """One case, in virtual time; what it tells is the same whenever and wherever it is run."""
    return _run(Moment(case))


def _run(moment: Moment) -> Ended:
    case = moment.case
    config, attack = load_config(case.object, "simulated").for_lift().built_for(case.seed), Attack()
    rig = attack.rig = simulated(config, case.seed, paced=False, wrappers=attack.wires)
    cell = rig.cell
    assert isinstance(cell, SimulatedCell)
    attack.pads.of(cell.board)
    attack.arm.clock = rig.clock
    attack.detector = FailingDetector(config.make_detector(FINGERS), rig.clock)
    seen, struck_in = Observer(cell), ""
    if isinstance(moment, Plain):
        moment.told = attack.told

    def watch(tick: Tick, truth: Truth | None, controller: Any) -> None:
        nonlocal struck_in
        if moment.comes(tick.decision.state):
            struck_in = tick.decision.state.value
            attack.begin(case, rig.clock.now_ns)
        attack.tick(rig.clock.now_ns)
        if truth is not None:
            seen.take(truth, bool(attack.impact_ns), tick.decision.state in SAFE_STATES)

    trial = run_trial(config, rig, make_guard(config), watch, detector=attack.detector)
    at_end, arm_mps = cell.truth(), speed(cell, rig.clock.now_ns)
    fingers_mps = float(np.abs(cell.gripper.velocity_mps).max())
    trial = msgspec.structs.replace(trial, way_out=WAY_OUT)
    safe = trial.controller.state in SAFE_STATES
    _wait(rig, attack.arm.watch, lambda: seen.take(cell.truth(), bool(attack.impact_ns), safe))
    later = cell.truth()
    outcome = lift.judge(config, case.seed, trial, None).outcome
    failure, said = trial.failure(config), trial.end(config) or End("", "", "")
    arm_s, hand_s = _delays(trial, seen) if attack.impact_ns else (None, None)
    (taken, took_ns), (then_taken, then_took_ns) = attack.took(0), attack.took(1)
    safe_ns = seen.safe_ns
    return Ended(
        case=case, struck_in=struck_in, taken=taken,
        then_taken=then_taken,
        taken_safe=safe_ns is not None and max(took_ns, then_took_ns) >= safe_ns,
        outcome=outcome, phase=_phase(trial), cause=trial.controller.fault_cause,
        timed_out=bool(_codes(trial) & {"run_timeout", "phase_timeout"}),
        message="" if failure is None else failure.message,
        arm=said.arm, hand=said.hand, advice=said.advice, unconfirmed=said.unconfirmed,
        finished=trial.controller.finished and "run_timeout" not in _codes(trial),
        arm_s=arm_s, hand_s=hand_s,
        safe_mps=seen.safe_mps, safe_way_m=seen.safe_way_m, fingers_mps=fingers_mps,
        arm_mps=arm_mps, later_arm_mps=speed(cell, rig.clock.now_ns),
        later_fingers_mps=float(np.abs(cell.gripper.velocity_mps).max()),
        peak_n=max(later.peak_n), entered_n=seen.entered_n, least_n=seen.least_n,
        pressed_n=max(at_end.normal_n), later_pressed_n=max(later.normal_n),
        lifted_m=seen.lifted_m, let_go_m=seen.let_go_m, slid_m=seen.slid_m,
        height_m=later.height_m, slip_mps=abs(later.slip_speed_mps),
    )  # fmt: skip


def _delays(trial: FinishedTrial, seen: Observer) -> tuple[float | None, float | None]:
    """From the safe state until the arm and until the fingers moved no more, s; None without."""
    entered = [e.t_ns for e in trial.controller.machine.log if e.phase in SAFE_STATES]
    if not entered:
        return None, None
    moved_ns = seen.arm_moved_ns, seen.hand_moved_ns
    arm_s, hand_s = (max(0, t_ns - entered[0]) * 1e-9 for t_ns in moved_ns)
    return arm_s, hand_s


def _wait(rig: Rig[Any, Any], flush: Callable[[int], None], look: Callable[[], None]) -> None:
    for _ in range(LATER_NS // STEP_NS):
        rig.clock.sleep_until_ns(rig.clock.now_ns + STEP_NS)
        flush(rig.clock.now_ns)
        look()


def _phase(trial: FinishedTrial) -> str:
    """The end it came to, or the phase that its safe state followed."""
    if trial.controller.state in END_STATES:
        return trial.controller.state.value
    going = [e.phase for e in trial.controller.machine.log if e.phase not in SAFE_STATES]
    return going[-1] if going else State.START.value


def _codes(trial: FinishedTrial) -> set[str]:
    return {fault.code for fault in trial.controller.faults}
