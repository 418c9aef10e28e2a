"""What a run waits for, one wait after the other, each beside the time-out that is stated for it.

Whatever blocks in the thread of the run is wrapped; between two signs of progress (a wait begins or
ends, a tick) no more may pass than the time-out in force, and ``NAMED_S``. Where none is in force
the run computes, which the processor's time tells of: a busy machine makes it longer, up to a
bound, and whoever computes longer than ``NAMED_S`` himself is overdue on any machine.
"""
# ruff: noqa: SLF001  (time-outs are read where they are stated)

import threading
import time
from collections.abc import Callable
from functools import wraps
from typing import Any

import msgspec

from drivers.robotiq.link import thread as gripper_thread
from drivers.robotiq.link.thread import ThreadedGripper
from drivers.takktile.emulator import bus
from drivers.takktile.link import thread as tactile_thread
from drivers.takktile.link.thread import ReadingThread
from drivers.ur.link import preflight
from drivers.ur.link.supervisor import WorkerProcess
from grasp.loop import ControlLoop
from grasp.phases import END_PHASES, SAFE_PHASES, Phase
from scenarios.lift.config import LiftConfig
from scenarios.rigs import cell_control, cell_process, emulated, rig

NAMED_S = 2.0  # that a stated time-out may be passed by
BUSY = 15.0  # times its own computing that the run may take where it waits for nothing
MOST_SPARED_S = 15.0  # of that; and no more than ``NAMED_S`` of computing, however idle the machine
HANG_UP_S = 0.2  # of `preflight.Rtde`, for the other end to go too


class Wait(msgspec.Struct, frozen=True):
    """One of them; ``stated_s`` is 0 where nothing was waited for."""

    name: str
    took_s: float
    stated_s: float

    def __str__(self) -> str:
        return f"{self.name}: {self.took_s:.1f} s, {self.stated_s:.1f} s are stated"


class Waits:
    """Notes every wait of the thread that makes it."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        busy: Callable[[], float] = time.thread_time,
    ) -> None:
        self.overdue: list[Wait] = []
        self.longest: dict[str, Wait] = {}
        self._clock, self._busy = clock, busy
        self._thread = threading.get_ident()
        self._stack: list[tuple[str, float, float]] = []  # name, stated, since when
        self._sign_s, self._sign_busy_s = clock(), busy()
        self._last = "the beginning"
        self._phase, self._phase_s = Phase.IDLE, clock()

    def sign(self) -> None:
        """Of progress: compare what has passed since the last one."""
        now_s, busy_s = self._clock(), self._busy()
        passed_s, worked_s = now_s - self._sign_s, busy_s - self._sign_busy_s
        self._sign_s, self._sign_busy_s = now_s, busy_s
        name, stated_s, _ = self._stack[-1] if self._stack else (f"after {self._last}", 0.0, 0.0)
        spare_s = min(BUSY * worked_s, MOST_SPARED_S) if not self._stack else 0.0
        self._note(Wait(name, passed_s, stated_s), spare_s)
        if not self._stack:
            self._note(Wait(f"computing {name}", worked_s, 0.0))

    def around(self, name: str, stated_s: float, action: Callable[[], Any]) -> Any:
        """Do it; one of another thread is none of the run's."""
        if threading.get_ident() != self._thread:
            return action()
        self.sign()
        self._stack.append((name, stated_s, self._clock()))
        try:
            return action()
        finally:
            self.sign()
            self._last, _, since_s = self._stack.pop()
            self._note(Wait(name, self._clock() - since_s, stated_s))

    def phase(self, phase: Phase, stated_s: float) -> None:
        """After each tick: the phase, and how long it may last."""
        now_s = self._clock()
        if phase is not self._phase:
            self._phase, self._phase_s = phase, now_s
        elif stated_s:
            self._note(Wait(f"phase {phase}", now_s - self._phase_s, stated_s))

    def _note(self, wait: Wait, spare_s: float = 0.0) -> None:
        had = self.longest.get(wait.name)
        if had is None or wait.took_s - wait.stated_s > had.took_s - had.stated_s:
            self.longest[wait.name] = wait
        if wait.took_s > wait.stated_s + NAMED_S + spare_s:
            self.overdue = [w for w in self.overdue if w.name != wait.name] + [wait]


Stated = Callable[..., float]


def watched(waits: Waits, settings: LiftConfig) -> None:
    """Wrap, for good, whatever a run on the emulated rig waits for."""
    ur = settings.ur

    def wrap(owner: Any, name: str, stated: float | Stated) -> None:
        inner = getattr(owner, name)
        title = f"{getattr(owner, '__name__', '').rpartition('.')[2]}.{name}"

        @wraps(inner)
        def outer(*args: Any, **more: Any) -> Any:
            stated_s = stated(*args, **more) if callable(stated) else stated
            return waits.around(title, stated_s, lambda: inner(*args, **more))

        setattr(owner, name, outer)

    def of_transfer(_: Any, request: Any) -> float:
        return float(request.timeout_ms * 1e-3 + bus._GRACE_S)

    wrap(cell_process.CellProcess, "__init__", cell_process.READY_S)
    wrap(cell_process.CellProcess, "_end", cell_process.END_S)
    wrap(cell_control.ControlClient, "ask", cell_control.TIMEOUT_S)
    wrap(emulated, "wait_placed", cell_process.READY_S)
    wrap(rig, "activate", rig.ACTIVATION_TIMEOUT_S)
    wrap(ThreadedGripper, "start", gripper_thread._JOIN_S)
    wrap(ThreadedGripper, "stop", gripper_thread._JOIN_S)
    wrap(bus._Connection, "__init__", bus._CONNECT_S)
    wrap(bus._Connection, "ask", of_transfer)
    wrap(ReadingThread, "stop", tactile_thread._JOIN_S)
    wrap(preflight, "_port", ur.step_timeout_s)
    wrap(preflight.Rtde, "__init__", ur.step_timeout_s)
    wrap(preflight.Rtde, "ask", ur.step_timeout_s)
    wrap(preflight.Rtde, "wait", ur.step_timeout_s)
    wrap(preflight.Rtde, "__exit__", HANG_UP_S)
    wrap(preflight.Dashboard, "__init__", ur.step_timeout_s)
    wrap(preflight.Dashboard, "line", ur.step_timeout_s)
    wrap(WorkerProcess, "wait_ready", lambda _, timeout_s: timeout_s)
    wrap(WorkerProcess, "call", lambda _, command, timeout_s: timeout_s)
    wrap(WorkerProcess, "close", lambda _, timeout_s: timeout_s)
    wrap(ControlLoop, "tick", settings.loop.period_s + settings.modbus.timeout_s)
    ticked = ControlLoop.tick

    def tick(loop: ControlLoop) -> Any:
        done = ticked(loop)
        phase = done.decision.phase
        waits.phase(phase, stated_for(phase, settings))
        return done

    ControlLoop.tick = tick  # type: ignore[method-assign]


def stated_for(phase: Phase, settings: LiftConfig) -> float:
    """How long a phase may last; 0 of those that end a run."""
    if phase in SAFE_PHASES:
        return settings.loop.stop_s
    return 0.0 if phase in END_PHASES else settings.controller.phase_timeout_s
