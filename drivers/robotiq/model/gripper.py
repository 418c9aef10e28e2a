"""Simulation model of the gripper: command registers in, status registers and finger motion out.

Rules follow the Robotiq 3-Finger manual (2014/2018). Requests are taken up and status is sampled
on refresh ticks; the motors follow a latency later. A finger in contact stays until the opposite
direction or a higher force is requested, or rGTO is cleared and set. Fingers are ordered A, B, C;
counts are motor counts, 0 open to 255 closed. Time is an argument.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.robotiq.model.hand import (
    FULL,
    WORDS,
    AxisStatus,
    Command,
    HandSettings,
    HandStatus,
    Request,
    Words,
    decode,
    encode,
    written,
)
from drivers.robotiq.model.motor import (
    AT_TARGET,
    FINGERS,
    FREE,
    OPEN_LIMIT_COUNTS,
    TRAVEL,
    VELOCITY,
    Axes,
    FingerLoads,
    FingerMotion,
    Fingers,
    Scissor,
)

__all__ = ["FREE", "FingerLoads", "GripperModel", "HandSettings", "ModelTransport"]

_NEVER: Final = 1 << 62
_SCISSOR_OF_MODE: Final = (137, 200, 23, 137)  # basic: manual p. 67; the rest from public drivers
_SCISSOR_MODE: Final = 3
_MODE_CHANGE_S: Final = 3.0  # assumed
FIRST_REGISTERS: Final = {"tcp": (0, 0), "rtu": (1000, 2000)}  # command, status; p. 59, 75


Corruption = Callable[[Words], Words]

# Operating stage of the hand as a whole, with its gIMC and gFLT.
BOOTING, RESET, ACTIVATING, MODE_CHANGE, READY, RELEASED, FAULTED = range(7)
_INITIALIZATION: Final = {ACTIVATING: 1, MODE_CHANGE: 2, READY: 3}
_MAJOR_FAULT_GIMC: Final = {0x0D: 1, 0x0E: 2}  # gIMC in which a major fault leaves the hand
_STAGE_FAULT: Final = {BOOTING: 0x09, RELEASED: 0x0F}
_DELAYED: Final = {RESET: 0x07, ACTIVATING: 0x05, MODE_CHANGE: 0x06}


class GripperModel:
    """Model of the hand. ``advance`` simulates it, ``write`` and ``read`` exchange registers.

    ``write`` and ``read`` first advance the hand to their time, under the loads last given.
    """

    def __init__(self, settings: HandSettings, now_ns: int, *, active: bool = False) -> None:
        """Power up at ``now_ns``, open; ``active``: already activated."""
        self.settings = settings
        self._fingers = Fingers(settings, now_ns)
        self._period_ns = 1_000_000_000 // settings.refresh_hz
        self._phase_ns = round(settings.tick_phase_s * 1e9)
        self._latency_ns = round(settings.command_latency_s * 1e9)
        self._now_ns = now_ns
        self._pending: deque[FingerMotion] = deque()
        self._scissor = Scissor(_SCISSOR_OF_MODE[0])
        self._written = self._taken_up = ((active << 8), *(WORDS - 1) * (0,))
        self._command = decode(self._written)
        self._mode = 0
        self._targets = [OPEN_LIMIT_COUNTS] * FINGERS  # as last requested
        self._go_to = False
        self._injected = 0
        self._jammed = False
        self._corrupt: Corruption | None = None
        self.ignores_writes = False  # injected fault: writes have no effect
        self._stage = READY if active else RESET
        self._stage_end_ns = _NEVER
        self._sampled = encode(self._status_now(now_ns))
        # whether a motor may move, or the status change, without a further write
        self.moving = False
        self._next_tick_ns = 0
        self._wake()

    @property
    def ready(self) -> bool:
        """Whether activation is complete and no fault prevents motion (gIMC = 3)."""
        return self._stage == READY

    @property
    def travel_m(self) -> NDArray[np.float64]:
        """Fingertip travel from the mechanical opening stop, (3,) m."""
        return np.array(self._fingers.real[TRAVEL])

    @property
    def velocity_mps(self) -> NDArray[np.float64]:
        """Fingertip velocity, closing positive, (3,) m/s."""
        return np.array(self._fingers.real[VELOCITY])

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None:
        """Set command registers; those not written keep their values.

        Raises ValueError for registers that do not exist or values beyond 16 bits.
        """
        if now_ns > self._now_ns:
            self.advance(now_ns)
        if self.ignores_writes:
            return
        self._written = written(self._written, first_register, registers)
        if self._written != self._taken_up:
            self._wake()

    def read(self, now_ns: int) -> Words:
        """The eight status registers as sampled at the last refresh tick."""
        if now_ns > self._now_ns:
            self.advance(now_ns)
        return self._sampled if self._corrupt is None else self._corrupt(self._sampled)

    def inject_fault(self, code: int) -> None:
        """Report a fault from the next tick on; 0 clears it. 0x0D, 0x0E and 0x0F stop the hand. As
        on the real hand, only clearing rACT ends them."""
        code &= 0x0F
        if self._stage == FAULTED and code not in _MAJOR_FAULT_GIMC:
            return
        self._injected = code
        if code == 0x0F:
            self._halt(RELEASED)
        elif code in _MAJOR_FAULT_GIMC:
            self._halt(FAULTED)
        self._wake()

    def misreport(self, corruption: Corruption) -> None:
        """Fault injection: from now on ``corruption`` is applied to every status."""
        self._corrupt = corruption

    def jam(self) -> None:
        """Fault injection: the motors stop and ignore every command."""
        self._jammed = True
        self._fingers.stop()

    def power_cycle(self, boot_s: float = 0.0) -> None:
        """Fault injection: power off and on again, booted after ``boot_s``. The fingers keep their
        positions; the hand is not activated."""
        self._halt(RESET)
        self._written = self._taken_up = (0,) * WORDS
        self._command = decode(self._written)
        self._go_to = False
        self._fingers.forget_detections()
        if boot_s:
            self._enter(BOOTING, self._now_ns, boot_s)
        self._wake()

    def advance(self, now_ns: int, loads: FingerLoads | None = None) -> None:
        """Simulate the hand to ``now_ns``. Loads refer to the travel at the start of this call.
        Without ``loads``, those given last stay in effect, as springs fixed in space."""
        if loads is not None:
            self._fingers.load(loads)
        while self.moving:
            start_ns = self._pending[0].at_ns if self._pending else _NEVER
            event_ns = min(self._next_tick_ns, start_ns, self._stage_end_ns)
            self._fingers.integrate(min(event_ns, now_ns))
            if event_ns > now_ns:
                break
            if event_ns == self._stage_end_ns:
                self._end_stage(event_ns)
            elif event_ns == start_ns:
                motion = self._pending.popleft()
                if not self._jammed:
                    self._fingers.execute(motion)
            else:
                self._tick(event_ns, now_ns)
        if now_ns > self._now_ns:
            self._now_ns = now_ns

    def _wake(self) -> None:
        self.moving = True
        if self._next_tick_ns <= self._now_ns:
            ticks = (self._now_ns - self._phase_ns) // self._period_ns + 1
            self._next_tick_ns = self._phase_ns + ticks * self._period_ns

    def _tick(self, now_ns: int, until_ns: int) -> None:
        self._next_tick_ns += self._period_ns
        if self._written != self._taken_up and self._stage != BOOTING:
            self._taken_up = self._written
            self._take_up(decode(self._written), now_ns)
        self.moving = (
            self._fingers.moving
            or bool(self._pending)
            or self._stage_end_ns != _NEVER
            or self._scissor.counts(now_ns) != self._scissor.target
        )
        if self._next_tick_ns > until_ns or not self.moving:  # else nobody reads this status
            self._sampled = encode(self._status_now(now_ns))

    def _enter(self, stage: int, now_ns: int, duration_s: float) -> None:
        self._stage = stage
        self._stage_end_ns = now_ns + round(duration_s * 1e9)

    def _halt(self, stage: int) -> None:
        self._stage, self._stage_end_ns = stage, _NEVER
        self._pending.clear()
        self._fingers.stop()

    def _take_up(self, command: Command, now_ns: int) -> None:
        self._command = command
        if not command.activate:
            self._halt(RESET)
            self._injected, self._go_to = 0, False
            self._fingers.forget_detections()
        elif self._stage == RESET:
            self._activate(now_ns)
        elif self._stage == READY:
            self._execute(now_ns)  # in a fault only clearing rACT has an effect

    def _activate(self, now_ns: int) -> None:
        """Open and close to the mechanical stops, then open (manual p. 89)."""
        duration_s = self.settings.activation_s
        self._enter(ACTIVATING, now_ns, duration_s)
        for third, counts in enumerate((0, FULL, 0)):
            at_ns = now_ns + round(third * duration_s / 3 * 1e9)
            axes = (Request(counts, FULL, 0),) * 3  # at the least force
            self._pending.append(FingerMotion(at_ns, axes, to_stops=third < 2))

    def _change_mode(self, now_ns: int) -> None:
        """Change the mode; the fingers open first, so that the scissor does not collide."""
        self._pending.clear()
        self._pending.append(FingerMotion(now_ns, (Request(0, FULL, 0),) * 3))
        self._mode = self._command.mode
        self._go_to = False
        self._scissor.go(_SCISSOR_OF_MODE[self._mode], now_ns)
        self._enter(MODE_CHANGE, now_ns, _MODE_CHANGE_S)

    def _end_stage(self, now_ns: int) -> None:
        self._halt(RESET if self._stage == BOOTING else READY)
        if self._stage == READY:
            self._fingers.forget_detections()
            self._execute(now_ns)  # a request during activation was delayed, not lost

    def _execute(self, now_ns: int) -> None:
        """Execute the request in the command registers; the hand is ready."""
        command = self._command
        if command.mode != self._mode:
            self._change_mode(now_ns)
            return
        if command.go_to and command.individual_scissor:
            self._scissor.go(command.scissor.position, now_ns)
        elif command.go_to and command.mode == _SCISSOR_MODE:
            self._scissor.go(command.fingers[0].position, now_ns)
        was_going, self._go_to = self._go_to, command.go_to
        at_ns = now_ns + self._latency_ns
        axes, rises = self._requested_axes(), not was_going
        if command.go_to:
            a, b, c = (self._starts_motion(i, axis, rises) for i, axis in enumerate(axes))
            self._targets = [axis.position for axis in axes]
            self._pending.append(FingerMotion(at_ns, axes, (a, b, c), rises))
        elif was_going:
            self._pending.append(FingerMotion(at_ns, axes, stop=True))

    def _starts_motion(self, i: int, axis: Request, rises: bool) -> bool:
        """Whether a request starts finger ``i``; a new speed alone does not (manual p. 36)."""
        new_request = rises or axis.position != self._targets[i]
        new_request = new_request or self._fingers.stronger_in_contact(i, axis.force)
        starts = new_request and self._fingers.may_start(i, axis, rises)
        if starts:
            self._fingers.mark_moving(i)
        return starts

    def _requested_axes(self) -> Axes:
        command = self._command
        if self._individual_control:
            return command.fingers
        if command.mode == _SCISSOR_MODE:  # finger A's position drives the scissor only
            a, b, c = self._fingers.counts()
            return Request(a), Request(b), Request(c)
        return (command.fingers[0],) * 3

    @property
    def _individual_control(self) -> bool:
        """Whether fingers are commanded individually; scissor mode also needs rICS for that."""
        command = self._command
        return command.individual_fingers and (
            command.mode != _SCISSOR_MODE or command.individual_scissor
        )

    def _status_now(self, now_ns: int) -> HandStatus:
        command, stage = self._command, self._stage
        go_to = stage == READY and command.go_to
        a, b, c = command.fingers
        echoes = a.position, 0, 0  # in simple mode only finger A echoes (manual p. 68)
        if self._individual_control:
            echoes = a.position, b.position, c.position
        fingers = self._fingers.status(echoes)
        spread = self._scissor.counts(now_ns)
        rests = go_to and spread == self._scissor.target
        echo = command.scissor.position if command.individual_scissor else 0
        scissor = AxisStatus(echo, spread, 0, AT_TARGET if rests else 0)
        fault = self._injected or _STAGE_FAULT.get(stage, 0)
        if not fault and command.go_to:
            fault = _DELAYED.get(stage, 0)
        initialization = _INITIALIZATION.get(stage, 0)
        if stage == FAULTED:
            initialization = _MAJOR_FAULT_GIMC[self._injected]
        return HandStatus(
            active=stage not in (BOOTING, RESET),
            mode=command.mode,
            go_to=go_to,
            initialization=initialization,
            stopped=_stopped(fingers) if go_to else 0,
            fault=fault,
            axes=(*fingers, scissor),
        )


def _stopped(fingers: Sequence[AxisStatus]) -> int:
    """gSTA: 0 some finger moves, 1 some stopped short, 2 all stopped short, 3 all at target."""
    short = 0
    for finger in fingers:
        if finger.detection == 0:
            return 0
        short += finger.detection != AT_TARGET
    return (3, 1, 1, 2)[short]


class ModelTransport:
    """``RegisterTransport`` to a model in this process."""

    def __init__(self, model: GripperModel, link: Literal["tcp", "rtu"] = "tcp") -> None:
        self._model = model
        self._command, self._status = FIRST_REGISTERS[link]

    def write(self, first_register: int, registers: Sequence[int], now_ns: int) -> None:
        self._model.write(first_register - self._command, registers, now_ns)

    def read(self, first_register: int, count: int, now_ns: int) -> Sequence[int]:
        first = first_register - self._status
        return self._model.read(now_ns)[first : first + count]
