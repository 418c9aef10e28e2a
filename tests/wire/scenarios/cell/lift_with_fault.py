"""One lift on the emulated rig with one fault in one phase, and its verdict."""

import json
import math
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from grasp.cli.exits import code_of
from grasp.control.commands import CloseToLimit, HoldFingers, MoveArm, MoveFingers, OpenFingers
from grasp.control.states import AIRBORNE_STATES, State
from grasp.run.loop import Tick
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import Rig
from scenarios.trial import series
from scenarios.world.truth import Truth

QUICK = (
    "hand.activation_s=0.1",
    "controller.hold_s=0.3",
    "controller.lift_height_m=0.06",
    "controller.settle_s=0.15",
    "controller.baseline_s=0.15",
    "controller.lower_speed_mps=0.2",
)
FOR_GOOD = 1_000_000_000
LOOK_AGAIN_S = 0.3
STILL_M = 1e-4
STANDING_MPS = 1e-3
ON_TABLE_M = 1e-3

PHASES = (
    State.SHAPE, State.BRACE, State.LIFT, State.COMPENSATE, State.HOLD, State.DESCEND,
    State.OPEN,
)  # fmt: skip


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """A fault: request to the cell, and expected device and kinds of the run's error."""

    title: str
    request: dict[str, Any]
    device: str  # named in the message
    kinds: tuple[str, ...]
    settings: tuple[str, ...] = ()
    gripper_usable: bool = True  # False: it may be unreachable, or refuse commands


FAULTS = {
    "gripper-disconnected": Fault(
        title="gripper: connection cut, for good",
        request={"name": "gripper_disconnect", "times": FOR_GOOD},
        device="gripper", kinds=("link_lost",), gripper_usable=False,
    ),
    "gripper-silent": Fault(
        title="gripper: no reply any more",
        request={"name": "gripper_freeze", "seconds": 60.0},
        device="gripper", kinds=("link_lost", "safety_stop"), gripper_usable=False,
    ),
    "gripper-fault": Fault(
        title="gripper: fault 0x0E",
        request={"name": "gripper_fault", "code": 0x0E},
        device="gripper", kinds=("device_fault", "safety_stop"), gripper_usable=False,
    ),
    "protective-stop": Fault(
        title="arm: protective stop",
        request={"name": "protective_stop"},
        device="arm", kinds=("device_fault", "safety_stop"),
    ),
    "emergency-stop": Fault(
        title="arm: emergency stop",
        request={"name": "emergency_stop"},
        device="arm", kinds=("device_fault", "safety_stop"),
    ),
    "speed-slider": Fault(
        title="arm: speed slider turned to 0 %",
        request={"name": "speed_slider", "fraction": 0.0},
        device="arm", kinds=("safety_stop",),
    ),
    "arm-disconnected": Fault(
        title="arm: connections dropped",
        request={"name": "arm_disconnect"},
        device="arm", kinds=("link_lost", "stale", "safety_stop"),
    ),
    "arm-frozen": Fault(
        title="arm: controller frozen for 1 s",
        request={"name": "arm_freeze", "seconds": 1.0},
        settings=("arm.stale_after_s=0.25", "monitors.arm_start_s=0.3"),
        device="arm", kinds=("link_lost", "stale", "safety_stop"),
    ),
    "fingertips-unplugged": Fault(
        title="fingertips: USB unplugged",
        request={"name": "unplug"},
        device="tactile", kinds=("link_lost",),
    ),
    "fingertips-silent": Fault(
        title="fingertips: USB reads time out, for good",
        request={"name": "usb_timeout", "times": FOR_GOOD},
        device="tactile", kinds=("stale", "safety_stop", "link_lost", "device_fault"),
    ),
}  # fmt: skip


class Row(msgspec.Struct, kw_only=True):
    """Verdict of a run with one fault in one phase."""

    fault: str
    phase: str
    outcome: str = ""
    ended_in: str = ""
    kind: str = ""
    message: str = ""
    code: int = 0
    arm: str = ""
    hand: str = ""
    object: str = ""
    peak_n: float = 0.0
    problems: list[str] = []


def run(fault: str, phase: State, monkeypatch: Any) -> Row:
    """Run and check one lift."""
    with monkeypatch.context() as patch:
        return LiftWithFault(fault, phase).run(patch)


class LiftWithFault:
    """One run: injects the fault at the first tick of a phase, records the commands, and reads the
    cell's state afterwards."""

    def __init__(self, fault: str, phase: State) -> None:
        self.fault = FAULTS[fault]
        self.phase = phase
        self.row = Row(fault=fault, phase=phase.value)
        self.config = load_config(
            "can", "emulated", None, None, (*QUICK, *self.fault.settings)
        ).for_lift()
        self._rig: Rig | None = None
        self.injected = False
        self._last = self._before = State.START  # state now, and before the fault
        self._failed_ns: int | None = None
        self._sent: list[tuple[Any, str]] = []  # commands of the safe state, reason if refused
        self._end_states: list[tuple[Truth, dict[str, Any]]] = []

    def run(self, monkeypatch: Any) -> Row:
        monkeypatch.setattr(series, "open_rig", self._open)
        finished = lift.run(self.config, 0, None, on_tick=self._tick)
        self.row.outcome = finished.result.outcome
        self.row.ended_in = self._last.value
        if finished.failure is not None:
            self.row.kind = finished.failure.kind
            self.row.message = finished.failure.message
            self.row.code = code_of(finished.failure.kind)
        self._describe()
        self._check()
        return self.row

    @contextmanager
    def _open(
        self, config: LiftConfig, seed: int, paced: bool, permit: MotionPermit | None
    ) -> Iterator[Rig]:
        with open_rig(config, seed, paced, permit) as rig:
            first = self._rig is None  # not the open-loop run that follows
            if first:
                self._rig = rig
            try:
                yield rig
            finally:  # a series of one trial ends by being closed
                if first:
                    for _ in range(3):  # the first reply of a frozen arm is an old state
                        self._end_states.append(self._read_states())
                        time.sleep(LOOK_AGAIN_S)

    @property
    def _cell(self) -> Any:
        return self._rig.read_truth.__self__  # type: ignore[union-attr]

    def _read_states(self) -> tuple[Truth, dict[str, Any]]:
        arm = self._cell.endpoints["arm"]
        with (
            socket.create_connection((arm["host"], arm["faults"]), timeout=20.0) as sock,
            sock.makefile("rw") as lines,
        ):
            lines.write('{"do": "state"}\n')
            lines.flush()
            state = json.loads(lines.readline())
        return self._cell.truth(), state

    def _tick(self, tick: Tick) -> None:
        self._last = tick.decision.state
        if self._last is not State.FAULT:
            self._before = self._last
        if self._last is self.phase and not self.injected:
            self.injected = True
            self._cell.control.ask("fault", **self.fault.request)
        if self._last is State.FAULT and self._failed_ns is None:
            self._failed_ns = tick.t_ns
        if self._failed_ns is not None:
            self._sent += [
                (sent.admitted, sent.refused)
                for sent in tick.issued
                if sent.decided_ns >= self._failed_ns
            ]

    def _describe(self) -> None:
        (_, arm_at_end), (_, arm_later), (truth, arm) = self._end_states
        at_rest = not arm["moving"] and _distance_m(arm_later, arm) < STILL_M
        self.row.arm = "stopped" if at_rest else "MOVES"
        overrun_m = _distance_m(arm_at_end, arm_later)
        if at_rest and overrun_m > STILL_M:
            self.row.arm += f" {overrun_m * 1e3:.0f} mm late"
        self.row.hand = self._hand()
        self.row.object = _object(truth)
        self.row.peak_n = max(truth.peak_n)

    def _hand(self) -> str:
        for command, refused in self._sent:
            if isinstance(command, CloseToLimit | HoldFingers):
                verb = "closes" if isinstance(command, CloseToLimit) else "stays"
                return "refuses" if refused else verb
        return "not commanded"

    def _check(self) -> None:
        row, fault = self.row, self.fault
        checks = {
            "the phase was never reached": self.injected,
            f"ended in {row.ended_in}, not in the safe state": row.ended_in == "fault",
            f"outcome {row.outcome}": row.outcome == "fault",
            f"kind {row.kind!r}, not one of {fault.kinds}": row.kind in fault.kinds,
            f"exit code {row.code}": row.code in (3, 4),
            f"message does not name the {fault.device}: {row.message!r}": fault.device
            in row.message.lower().replace("fingertip", "tactile"),
            f"the arm {row.arm}": row.arm.startswith("stopped")
            and (row.arm == "stopped" or row.fault == "arm-frozen"),
            "the safe state moves something": not any(
                isinstance(command, MoveArm | MoveFingers | OpenFingers)
                for command, _ in self._sent
            ),
            f"the hand {row.hand}": row.hand in self._safe_hands(),
            f"peak of {row.peak_n:.1f} N": row.peak_n < 11.5,
            f"the object is {row.object}": self._object_safe(),
        }
        row.problems = [problem for problem, passed in checks.items() if not passed]

    def _safe_hands(self) -> tuple[str, ...]:
        expected = "closes" if self._before in AIRBORNE_STATES else "stays"
        if self.fault.gripper_usable:
            return (expected,)
        return (expected, "not commanded", "refuses")

    def _object_safe(self) -> bool:
        """Whether the object is as expected. A hand closed to the limit before the fault holds it
        even without commands."""
        if self.phase is State.HOLD:
            return self.row.object.startswith("held")
        if self.phase is State.OPEN:
            return self.row.object.startswith("on the table")
        if self.phase is State.DESCEND or (
            self.phase in AIRBORNE_STATES and self.fault.gripper_usable
        ):
            return self.row.object.startswith(("held", "on the table, gripped"))
        return True


def _distance_m(before: dict[str, Any], after: dict[str, Any]) -> float:
    return math.dist(before["position_m"], after["position_m"])


def _object(truth: Truth) -> str:
    if truth.height_m < ON_TABLE_M:
        return "on the table, gripped" if truth.touched else "on the table"
    if truth.touched and abs(truth.slip_speed_mps) < STANDING_MPS:
        return f"held at {truth.height_m * 1e3:.0f} mm"
    return f"SLIPS at {truth.height_m * 1e3:.0f} mm"
