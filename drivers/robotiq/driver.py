"""Driver core of the Robotiq 3-Finger gripper: verbs set intent, ``pump`` does one exchange.

No thread, no sleep, no clock of its own. Source of the rules: Robotiq 3-Finger manual, 2014/2018.
Every register image carries, for each finger, a force byte whose calibrated force is within the cap
of the verb that made it, or byte 0: the least force that the hand can be told.
"""

import math
from collections.abc import Callable, Sequence
from enum import Enum

import msgspec

from drivers.errors import DeviceFault, Refused
from drivers.interfaces import (
    FINGERS,
    Applied,
    Counts3,
    Detection,
    FingerState,
    GripperState,
)
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.encoding import (
    applied,
    checked_counts,
    finger_states,
    held_targets,
    motion_image,
    pinches,
    why_still,
    with_scissor,
)
from drivers.robotiq.exchange import (
    ACTIVATE,
    RESET,
    DriverSettings,
    Exchange,
    ExchangeStatistics,
    RegisterTransport,
    WireLog,
)
from drivers.robotiq.modes import BASIC, SCISSOR, check_closing
from drivers.robotiq.protocol import (
    FAULTS,
    FULL_BYTE,
    AxisCommand,
    CommandRegisters,
    Severity,
    StatusRegisters,
)

__all__ = ["DriverSettings", "ExchangeStatistics", "RegisterTransport", "RobotiqDriver"]

LATE_COUNTS = 2  # by which a position lags that was read and refreshed

_LOST = "the link is lost: nothing is sent until it answers again"
_ACTIVATES = "the gripper lost its activation, and a command that met it so set it activating"
_NOT_ACTIVATED = "activation did not complete: verify that nothing interferes with the fingers"
_OTHER_MODE = "the gripper says that it is in mode {}, and was taken over in mode {}"
_WHO_ELSE = "does anybody else command it? Switch it off and on, activate it"


class _Step(Enum):
    """Where ``pump`` is on the way to an active hand."""

    NONE = 0
    RESTARTING = 1  # rACT cleared, wait for gACT = 0, then activate
    ACTIVATING = 2  # rACT set, wait for gIMC = 3


class RobotiqDriver:
    """Implements ``drivers.interfaces.Gripper`` over registers.

    Fingers are always commanded one by one (rICF), all their bytes in one write: targets left over
    from an earlier individual request cannot come back to life.
    """

    def __init__(
        self,
        transport: RegisterTransport,
        settings: DriverSettings,
        calibration: GripperCalibration,
        log: WireLog | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        """``clock`` tells how long an exchange took, where time passes meanwhile: that of the times
        given to ``pump``."""
        self._clock = clock
        self._settings = settings
        self._activation_ns = round(settings.activation_timeout_s * 1e9)
        self._old_ns = round(settings.status_old_s * 1e9)
        self._calibration = calibration
        self._exchange = Exchange(transport, settings, log)
        self._status: StatusRegisters | None = None
        self._mode = 0  # it was taken over in: to be told another would open it
        self._other_mode = False  # it says that it is in another
        self._fingers: tuple[FingerState, FingerState, FingerState] | None = None
        self._state: GripperState | None = None
        self._now_ns = 0
        self._seq = 0
        self._changed_ns = 0  # when the status last differed from the one before
        self._leapt = False  # a finger was where no motor can have brought it
        self._step = _Step.NONE
        self._deadline_ns = 0
        self._grip_bytes = [FULL_BYTE] * FINGERS  # force of the grip; unknown counts as full
        self._raised = 0  # major fault that was raised already
        self._resynced = 0

    # What is known

    @property
    def state(self) -> GripperState | None:
        """Latest snapshot; None before the first exchange."""
        state = self._state
        if state is not None and state.fresh and not self._fresh:
            self._state = state = msgspec.structs.replace(state, fresh=False)
        return state

    @property
    def least_force_n(self) -> float:
        """Calibrated static force of force byte 0, N."""
        return self._calibration.least_force_n

    @property
    def m_per_count(self) -> float:
        """Fingertip travel of one count by the calibration, m."""
        return self._calibration.m_per_count

    @property
    def mode(self) -> int:
        """That the hand was taken over in, and that every command leaves it in (rMOD)."""
        return self._mode

    @property
    def statistics(self) -> ExchangeStatistics:
        """Counters so far."""
        exchange = self._exchange
        return ExchangeStatistics(
            writes=exchange.writes,
            reads=exchange.reads,
            rejected=exchange.rejected,
            link_losses=exchange.link_losses,
            reconnects=exchange.reconnects,
            resynced=self._resynced,
        )

    @property
    def acknowledged(self) -> bool:
        """Whether the gripper has answered the write of everything that was asked for."""
        return self._exchange.written

    @property
    def _fresh(self) -> bool:
        return self._step is _Step.NONE and self._exchange.confirmed

    # Exchange

    def pump(self, now_ns: int) -> None:
        """One exchange: at most one write, one read, one change of state.

        Raises ``LinkLost`` when the device does not answer, ``DeviceFault`` once for each fault
        that stops motion and for an activation that does not end.
        """
        self._now_ns = now_ns
        was_lost = self._exchange.lost
        status = self._exchange.pump(now_ns)
        if status is None:
            return
        changed, self._status = status is not self._status, status
        if self._step is not _Step.NONE or self._exchange.wanted is None:  # not ours to say yet
            self._mode = status.mode
        unasked = self._activates_unasked(status, was_lost)
        if unasked:
            self._exchange.want(RESET)
            self._exchange.pump(now_ns)
        elif was_lost or self._was_reset(status):
            self._resync(status)
        elif self._reset_was_lost(status, now_ns):
            self._exchange.again()
        if self._step is not _Step.NONE:
            self._proceed(status, now_ns)
        self._publish(status, now_ns, changed)
        self._raise_fault(status, now_ns)
        if unasked:
            raise DeviceFault(_ACTIVATES, "keep clear: the fingers may have moved; activate it")

    def _was_reset(self, status: StatusRegisters) -> bool:
        """The device lost what it had taken up, as after a power cycle, written yet or not."""
        wanted = self._exchange.wanted
        if wanted is None or not wanted.activate or self._step is not _Step.NONE:
            return False
        return not status.active

    def _activates_unasked(self, status: StatusRegisters, was_lost: bool) -> bool:
        """The device lost power between a read and the write after it: that write set rACT."""
        wanted = self._exchange.wanted
        if wanted in (None, ACTIVATE) or self._step is not _Step.NONE:
            return False
        if wanted == RESET and not was_lost:
            return False  # told already
        stopped = FAULTS[status.fault].severity is Severity.MAJOR
        return status.active and status.initialization == 1 and not stopped

    def _reset_was_lost(self, status: StatusRegisters, now_ns: int) -> bool:
        """The hand goes on activating although it was told not to, two refreshes ago."""
        told = self._exchange.wanted == RESET and self._step is _Step.NONE
        busy = status.active and status.initialization == 1
        return told and busy and self._exchange.settled(now_ns)

    def _resync(self, status: StatusRegisters) -> None:
        """Send nothing that moves without a new verb, and never activate by oneself."""
        self._step, self._leapt = _Step.NONE, False
        self._grip_bytes = [FULL_BYTE] * FINGERS
        if self._exchange.wanted is None:
            return
        self._resynced += 1
        pending = self._exchange.unproven and not status.active
        self._exchange.want(None)
        if pending:  # it may wait in the hand, which would take it up when it has booted
            self._exchange.want(RESET)
        if status.ready:
            where = tuple(finger.position for finger in status.fingers)
            self._exchange.want(self._image(where, 0, (0, 0, 0)))

    def _publish(self, status: StatusRegisters, now_ns: int, changed: bool) -> None:
        took_ns = 0 if self._clock is None else self._clock() - now_ns
        if changed or self._fingers is None:
            self._leapt = self._leapt or self._leaps(status, now_ns + took_ns)
            self._changed_ns = now_ns
            self._fingers = finger_states(status)
        self._seq += 1
        fault = FAULTS[status.fault]
        self._state = GripperState(
            now_ns,
            self._seq,
            status.ready and fault.severity is not Severity.MAJOR,
            status.fault,
            fault.text,
            self._fresh,
            self._fingers,
            took_ns,
        )

    def _leaps(self, status: StatusRegisters, now_ns: int) -> bool:
        """Since the status before was asked for, ``now_ns`` being when this one was there."""
        if self._fingers is None or self._state is None:
            return False
        s, passed_s = self._settings, (now_ns - self._state.t_ns) * 1e-9
        reach = s.leap_counts + s.fastest_counts_ps * passed_s
        ways = zip(self._fingers, status.fingers, strict=True)
        return any(abs(was.position_counts - now.position) > reach for was, now in ways)

    def _raise_fault(self, status: StatusRegisters, now_ns: int) -> None:
        fault = FAULTS[status.fault]
        major = fault.severity is Severity.MAJOR
        onset = major and fault.code != self._raised
        self._raised = fault.code if major else 0
        if onset:
            if self._step is not _Step.RESTARTING:
                self._step = _Step.NONE
            raise DeviceFault(f"gripper fault 0x{fault.code:02X}: {fault.text}", fault.remedy)
        was_other, self._other_mode = self._other_mode, status.ready and status.mode != self._mode
        if self._other_mode and not was_other:
            raise DeviceFault(_OTHER_MODE.format(status.mode, self._mode), _WHO_ELSE)
        if self._step is not _Step.NONE and now_ns > self._deadline_ns:
            self._step = _Step.NONE
            raise DeviceFault(_NOT_ACTIVATED + (fault.text and f" ({fault.text})"), "activate")

    # Activation

    def _begin(self, step: _Step, command: CommandRegisters) -> None:
        self._step = step
        self._deadline_ns = self._now_ns + self._activation_ns
        self._exchange.want(command)

    def _proceed(self, status: StatusRegisters, now_ns: int) -> None:
        if not self._exchange.settled(now_ns):
            return
        if self._step is _Step.RESTARTING and not status.active and not status.fault:
            self._step = _Step.ACTIVATING
            self._exchange.want(ACTIVATE)
        elif self._step is _Step.ACTIVATING and status.ready and status.mode == BASIC:
            self._step, self._leapt = _Step.NONE, False

    # Verbs

    def activate(self, dropping: bool = False) -> Applied:
        """Make the hand ready, in basic mode. One that is so and without fault is taken over as it
        is; one that holds something, or is active and not open, for who holds by position feels no
        contact, is left alone, unless it may drop that. One that is ready in another mode is told
        the basic one, for which it opens first."""
        state = self._known()
        if self._exchange.lost:
            return self._nothing(_LOST)
        if self._step is not _Step.NONE:
            return self._nothing("activation is under way")
        well = state.active and not state.fault
        if well and self._mode == BASIC:
            return self._nothing("already active: taken over as it is")
        if self._holds(state) and not dropping:
            raise Refused(
                "activation would drop what the fingers hold",
                "open first; switch the hand off and on if it cannot",
            )
        status = self._status
        if well or (
            status is not None and status.active and status.initialization == 1 and not state.fault
        ):
            self._begin(_Step.ACTIVATING, ACTIVATE)  # in another mode, or begun by another master
        else:
            self._begin(_Step.RESTARTING, RESET)
        return self._of(ACTIVATE)

    def _holds(self, state: GripperState) -> bool:
        """Whether it may hold something."""
        met = Detection.CONTACT_CLOSING in (finger.detection for finger in state.fingers)
        met = met or (self._status is not None and pinches(self._status))
        return met or (state.active and not state.is_open)

    def open(self, speed_mps: float) -> Applied:
        """Open all fingers to their software limits, at the least force; in scissor mode spread B
        and C too, for they may hold something between them."""
        return self._move((0, 0, 0), speed_mps, (0, 0, 0), spread=True)

    def move_to(self, targets_counts: Counts3, speed_mps: float, force_n: float) -> Applied:
        """Send each finger to a count, at a force within ``force_n``."""
        byte = self._calibration.byte_at_most(force_n)
        return self._move(checked_counts(targets_counts), speed_mps, (byte, byte, byte))

    def close_fast(
        self,
        force_cap_n: float,
        closing: tuple[bool, bool, bool],
        limits_counts: Counts3,
        speed_mps: float,
    ) -> Applied:
        """Close some fingers to their limits, within a force; the others hold where they are.

        Nothing opens: a limit behind a finger leaves it where it is. Where that is doubtful it goes
        on to where it was told to, and no faster than it was told.
        """
        byte = self._calibration.byte_at_most(force_cap_n)
        limits = checked_counts(limits_counts)
        held = self._held(self._known())
        targets = tuple(
            max(limit, here) if closes else here
            for closes, limit, here in zip(closing, limits, held, strict=True)
        )
        if self._doubtful(self._known()):
            speed_mps = self._no_faster(speed_mps)
        return self._move(targets, speed_mps, tuple(byte if closes else 0 for closes in closing))

    def _no_faster(self, speed_mps: float) -> float:
        """Than the fingers were told last."""
        wanted = self._exchange.wanted
        if wanted is None or not wanted.go_to:
            return speed_mps
        told_mps = self._calibration.speed_mps(max(axis.speed for axis in wanted.axes[:FINGERS]))
        return min(speed_mps, told_mps)

    def hold(self) -> Applied:
        """Stay: every target becomes the position the finger has. Never refused once connected.

        Where the reported positions may be those of some time ago the fingers are stopped instead
        (rGTO cleared), for a target that has been passed would move them back. That writes rACT,
        though, which a hand that has lost power would take for its activation. So it is done only
        while the status is seen to change; a finger goes on by what it may have moved at most
        where it is not.
        """
        state = self._known()
        if not state.active or self._exchange.lost or self._step is not _Step.NONE:
            return self._nothing("the hand does not obey motion commands: nothing was sent")
        targets: Sequence[int] = held_targets(state.fingers, self._exchange.wanted)
        go_to = self._tells_positions(state)
        if not go_to and not self._alive:
            targets, go_to = self._reached_at_most(state), True
        command = self._image(targets, 0, (0, 0, 0))
        command = msgspec.structs.replace(command, go_to=go_to)
        self._exchange.want(command)
        return self._of(command)

    @property
    def _alive(self) -> bool:
        """The status was seen to change lately: it is no old one."""
        return self._now_ns - self._changed_ns <= self._old_ns

    def _reached_at_most(self, state: GripperState) -> list[int]:
        """Where each finger may be by now, on its way to what it was told last."""
        wanted = self._exchange.wanted
        here = list(state.positions)
        if wanted is None or not wanted.go_to:
            return here
        since_s = (self._now_ns - max(self._changed_ns, self._exchange.told_ns)) * 1e-9
        for i, axis in enumerate(wanted.axes[:FINGERS]):
            speed_cps = self._calibration.speed_mps(axis.speed) / self.m_per_count
            reach = math.ceil(since_s * speed_cps) + LATE_COUNTS
            here[i] += min(max(axis.position - here[i], -reach), reach)
        return here

    def _tells_positions(self, state: GripperState) -> bool:
        """Whether the fingers are where the status says: it speaks of the last command, and has
        changed lately if a finger moves."""
        return state.fresh and not self._doubtful(state)

    def _doubtful(self, state: GripperState) -> bool:
        moving = any(finger.detection is Detection.MOVING for finger in state.fingers)
        return self._leapt or (moving and self._now_ns - self._changed_ns > self._old_ns)

    def _held(self, state: GripperState) -> Sequence[int]:
        """Targets of fingers that hold: where they are, or their last ones if that is doubtful."""
        wanted = self._exchange.wanted
        if self._doubtful(state) and wanted is not None and wanted.go_to:
            return [axis.position for axis in wanted.axes[:FINGERS]]
        return held_targets(state.fingers, wanted)

    # Images

    def _move(
        self,
        targets: Sequence[int],
        speed_mps: float,
        force_bytes: Sequence[int],
        spread: bool = False,
    ) -> Applied:
        speed = self._calibration.speed_byte_at_most(speed_mps)
        state = self._ready()
        if any(to > at for to, at in zip(targets, state.positions, strict=True)):
            check_closing(self._mode)
        command = self._image(targets, speed, force_bytes, spread)
        if self._exchange.lost:
            return self._nothing(_LOST)
        still = [self._why_still(i, command.axes[i], state) for i in range(FINGERS)]
        for i, byte in enumerate(force_bytes):
            if not still[i]:
                self._grip_bytes[i] = byte
        self._exchange.want(command)
        return self._of(command, "" if "" in still else "; ".join(sorted(set(still))))

    def _image(
        self,
        targets: Sequence[int],
        speed: int,
        force_bytes: Sequence[int],
        spread: bool = False,
    ) -> CommandRegisters:
        """``spread``: in scissor mode, B and C apart; else that motor stays where it is."""
        command = motion_image(self._mode, targets, speed, force_bytes)
        if self._mode != SCISSOR or self._status is None:
            return command
        if spread:
            return with_scissor(command, 0, speed)
        return with_scissor(command, self._status.scissor.position, 0)

    def _why_still(self, i: int, axis: AxisCommand, state: GripperState) -> str:
        if not self._fresh:
            return ""  # stale detections prove nothing
        wanted = self._exchange.wanted
        asked = wanted.axes[i].position if wanted and wanted.go_to else None
        return why_still(state.fingers[i], axis, asked, self._grip_bytes[i])

    # Answers

    def _known(self) -> GripperState:
        state = self.state
        if state is None:
            raise Refused("no status was received yet", "pump the driver first")
        return state

    def _ready(self) -> GripperState:
        state = self._known()
        if self._step is not _Step.NONE:
            raise Refused("activation is under way", "wait until the hand is active")
        if FAULTS[state.fault].severity is Severity.MAJOR:
            raise Refused(f"gripper fault: {state.fault_text}", FAULTS[state.fault].remedy)
        if not state.active:
            raise Refused("the hand is not activated", "activate it first")
        return state

    def _of(self, command: CommandRegisters, note: str = "") -> Applied:
        return applied(self._calibration, command, note)

    def _nothing(self, note: str) -> Applied:
        """Answer of a verb that sends nothing: what is wanted already, with the reason."""
        wanted = self._exchange.wanted
        if wanted is None:
            wanted = self._image(self._known().positions, 0, (0, 0, 0))
        return self._of(wanted, note)
