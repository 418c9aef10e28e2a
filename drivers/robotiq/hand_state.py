"""The hand as it is known, an exchange at a time: its state, its faults, resets that nobody asked
for, and the way to an active hand; from status to fingers, and from requests to register images.
What the hand is told to do is in ``drivers.robotiq.driver``.
"""

from collections.abc import Callable, Sequence
from enum import Enum

import msgspec

from drivers.errors import DeviceFault, Refused
from drivers.interfaces import FINGERS, Counts3, Detection, FingerState, GripperState
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.exchange import (
    ACTIVATE,
    RESET,
    DriverSettings,
    Exchange,
    ExchangeStatistics,
    RegisterTransport,
    WriteLog,
)
from drivers.robotiq.protocol import (
    BASIC,
    FAULTS,
    FULL_BYTE,
    LEAP_COUNTS,
    SCISSOR,
    AxisCommand,
    AxisStatus,
    CommandRegisters,
    Severity,
    StatusRegisters,
)

_ACTIVATES = "the gripper lost its activation, and a command that met it so set it activating"
_NOT_ACTIVATED = "activation did not complete: verify that nothing interferes with the fingers"
_OTHER_MODE = "the gripper says that it is in mode {}, and was taken over in mode {}"
_CHANGED = "another client changed the gripper's registers, or they are misreported: {}"
_END_IT = "end every other program that commands the gripper"
_WHO_ELSE = "does anybody else command it? Switch it off and on, activate it"
_DETECTIONS = tuple(Detection)
_MOVING = Detection.MOVING
STATUS_OLD_NS = 100_000_000  # one that stands still although a finger moves tells no position any
# more; assumed: a count takes 0.035 s at least speed
FASTEST_COUNTS_PS = 300.0  # no finger is faster; twice full speed, manual 0.11 m/s
_ACTIVATION_NS = 20_000_000_000  # must end within; assumed
MISREAD_COUNTS = 16  # by which a position is off at most; who was told back further, opens

LATCHED = "contact is latched: a close at no higher force does nothing"
THERE = "already there"


class Step(Enum):
    """Where ``poll`` is on the way to an active hand."""

    NONE = 0
    RESTARTING = 1  # rACT cleared, wait for gACT = 0, then activate
    ACTIVATING = 2  # rACT set, wait for gIMC = 3


class TrackedHand:
    """Everything of a driver but its verbs."""

    def __init__(
        self,
        transport: RegisterTransport,
        settings: DriverSettings,
        calibration: GripperCalibration,
        log: WriteLog | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        """``clock`` tells how long an exchange took, where time passes meanwhile: that of the times
        given to ``poll``."""
        self._clock = clock
        self._calibration = calibration
        self._exchange = Exchange(transport, settings, log, clock)
        self._status: StatusRegisters | None = None
        self.mode = 0  # rMOD that it was taken over in: to be told another would open it
        self._other_mode = False  # it says that it is in another
        self._fingers: tuple[FingerState, FingerState, FingerState] | None = None
        self._state: GripperState | None = None
        self._now_ns = 0
        self._seq = 0
        self._changed_ns = 0  # when the status last differed from the one before
        self._leapt = False  # a finger was where no motor can have brought it
        self._step = Step.NONE
        self._deadline_ns = 0
        self._grip_bytes = [FULL_BYTE] * FINGERS  # force of the grip; unknown counts as full
        self._raised = 0  # major fault that was raised already

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
    def statistics(self) -> ExchangeStatistics:
        """Counters so far."""
        return self._exchange.statistics

    @property
    def acknowledged_ns(self) -> int:
        """When the gripper answered the latest write; 0: none yet."""
        return self._exchange.acknowledged_ns

    @property
    def acknowledged(self) -> bool:
        """Whether the gripper has answered the write of everything that was asked for."""
        return self._exchange.written

    @property
    def _fresh(self) -> bool:
        return self._step is Step.NONE and self._exchange.confirmed

    # Exchange

    def poll(self, now_ns: int) -> None:
        """One exchange: at most one write, one read, one change of state.

        Raises ``LinkLost`` when the device does not answer, ``DeviceFault`` once for each fault
        that stops motion, for an activation that does not end and for registers that another client
        changed: what was wanted last is written again then.
        """
        self._now_ns = now_ns
        was_lost = self._exchange.lost
        status = self._exchange.poll(now_ns)
        if status is None:
            return
        overwritten = self._exchange.changed
        changed, self._status = status is not self._status, status
        if self._step is not Step.NONE or self._exchange.wanted is None:  # not ours to say yet
            self.mode = status.mode
        unasked = self._answer_reset(status, was_lost, now_ns)
        if self._step is not Step.NONE:
            self._proceed(status, now_ns)
        self._publish(status, now_ns, changed)
        self._raise_fault(status, now_ns)
        if unasked:
            raise DeviceFault(_ACTIVATES, "keep clear: the fingers may have moved; activate it")
        if overwritten:
            raise DeviceFault(_CHANGED.format(overwritten), _END_IT)

    def _answer_reset(self, status: StatusRegisters, was_lost: bool, now_ns: int) -> bool:
        """Act on a reset that nobody asked for; whether the hand activates unasked."""
        wanted, idle = self._exchange.wanted, self._step is Step.NONE
        activating = status.active and status.initialization == 1 and idle
        stopped = FAULTS[status.fault].severity is Severity.MAJOR
        told = wanted in (None, ACTIVATE) or (wanted == RESET and not was_lost)
        if activating and not told and not stopped:
            # it lost power between a read and the write after it: that write set rACT
            self._exchange.want(RESET)
            self._exchange.poll(now_ns)
            return True
        reset = idle and wanted is not None and wanted.activate and not status.active
        if was_lost or reset:  # as after a power cycle, written yet or not
            self._resync(status)
        elif activating and wanted == RESET and self._exchange.settled(now_ns):
            self._exchange.again()  # it was told not to, two refreshes ago
        return False

    def _resync(self, status: StatusRegisters) -> None:
        """Send nothing that moves without a new verb, and never activate by oneself."""
        self._step, self._leapt = Step.NONE, False
        self._grip_bytes = [FULL_BYTE] * FINGERS
        if self._exchange.wanted is None:
            return
        self.statistics.resynced += 1
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
        active = status.ready and fault.severity is not Severity.MAJOR
        written = self._exchange.acknowledged, self._exchange.changed_ns
        self._state = GripperState(
            now_ns, self._seq, active, status.fault, fault.text, self._fresh, self._fingers,
            took_ns, *written,
        )  # fmt: skip

    def _leaps(self, status: StatusRegisters, now_ns: int) -> bool:
        """Since the status before was asked for, ``now_ns`` being when this one was there."""
        if self._fingers is None or self._state is None:
            return False
        reach = LEAP_COUNTS + FASTEST_COUNTS_PS * (now_ns - self._state.t_ns) * 1e-9
        ways = zip(self._fingers, status.fingers, strict=True)
        return any(abs(was.position_counts - now.position) > reach for was, now in ways)

    def _raise_fault(self, status: StatusRegisters, now_ns: int) -> None:
        fault = FAULTS[status.fault]
        major = fault.severity is Severity.MAJOR
        onset = major and fault.code != self._raised
        self._raised = fault.code if major else 0
        if onset:
            if self._step is not Step.RESTARTING:
                self._step = Step.NONE
            raise DeviceFault(f"gripper fault 0x{fault.code:02X}: {fault.text}", fault.remedy)
        was_other, self._other_mode = self._other_mode, status.ready and status.mode != self.mode
        if self._other_mode and not was_other:
            raise DeviceFault(_OTHER_MODE.format(status.mode, self.mode), _WHO_ELSE)
        if self._step is not Step.NONE and now_ns > self._deadline_ns:
            self._step = Step.NONE
            raise DeviceFault(_NOT_ACTIVATED + (fault.text and f" ({fault.text})"), "activate")

    # Activation

    def _begin(self, step: Step, command: CommandRegisters) -> None:
        self._step = step
        self._deadline_ns = self._now_ns + _ACTIVATION_NS
        self._exchange.want(command)

    def _proceed(self, status: StatusRegisters, now_ns: int) -> None:
        if not self._exchange.settled(now_ns):
            return
        if self._step is Step.RESTARTING and not status.active and not status.fault:
            self._step = Step.ACTIVATING
            self._exchange.want(ACTIVATE)
        elif self._step is Step.ACTIVATING and status.ready and status.mode == BASIC:
            self._step, self._leapt = Step.NONE, False

    # Images

    def _image(
        self, targets: Sequence[int], speed: int, forces: Sequence[int], spread: bool = False
    ) -> CommandRegisters:
        """``spread``: in scissor mode, B and C apart; else that motor stays where it is.

        There it always has a place of its own (rICS), at the least force: without one a hand sends
        its scissor to finger A's place, and obeys no single finger.
        """
        command = motion_image(self.mode, targets, speed, forces)
        if self.mode != SCISSOR or self._status is None:
            return command
        to = AxisCommand(0, speed) if spread else AxisCommand(self._status.scissor.position)
        return msgspec.structs.replace(command, individual_scissor=True, scissor=to)


def finger_states(status: StatusRegisters) -> tuple[FingerState, FingerState, FingerState]:
    """All fingers of a status. In scissor mode B and C are moved by a motor of their own, too."""
    a, b, c = (finger_state(axis, status) for axis in status.fingers)
    if status.mode == SCISSOR and status.go_to and _DETECTIONS[status.scissor.detection] is _MOVING:
        b, c = (msgspec.structs.replace(finger, detection=_MOVING) for finger in (b, c))
    return a, b, c


def finger_state(axis: AxisStatus, status: StatusRegisters) -> FingerState:
    """One finger of a status. gDT = 0 means moving only while gGTO is set (manual, gDT): a hand
    without it stands still, ready or reset, unless it is activating or changing its mode.
    """
    detection = _DETECTIONS[axis.detection]
    busy = status.go_to or status.initialization in (1, 2)
    if detection is _MOVING and not busy:
        detection = Detection.AT_TARGET
    return FingerState(axis.echo, axis.position, axis.current_ma, detection)


def pinches(status: StatusRegisters) -> bool:
    """Whether something was met between B and C, which in scissor mode close on each other."""
    met = _DETECTIONS[status.scissor.detection]
    return status.mode == SCISSOR and met is Detection.CONTACT_CLOSING


def checked_counts(targets: Sequence[int]) -> Sequence[int]:
    """Three counts, or Refused."""
    if len(targets) != FINGERS or any(not 0 <= target <= FULL_BYTE for target in targets):
        raise Refused(f"targets {tuple(targets)} are not counts", "give three counts, 0 to 255")
    return targets


def motion_image(
    mode: int, targets: Sequence[int], speed: int, forces: Sequence[int]
) -> CommandRegisters:
    """Fingers one by one (rICF), all targets given: nothing left from before can move them.

    ``mode`` must be the one that the hand is in: another one would open the fingers first.
    """
    a, b, c = (
        AxisCommand(target, speed, byte) for target, byte in zip(targets, forces, strict=True)
    )
    return CommandRegisters(
        activate=True, mode=mode, go_to=True, individual_fingers=True, a=a, b=b, c=c
    )


def held_targets(
    fingers: Sequence[FingerState], wanted: CommandRegisters | None
) -> tuple[int, ...]:
    """Targets that keep the fingers where they are: their positions.

    A finger that rests at its target, by its own word, keeps that target: following the report,
    which may be some counts off, would make it creep or press. For that no finger that has met
    something is told further than it was; but one that was told to open since, and says still that
    it has met something, is not to open on.
    """
    here = [finger.position_counts for finger in fingers]
    if wanted is None or not wanted.go_to:
        return tuple(here)
    for i, finger in enumerate(fingers):
        asked = wanted.axes[i].position
        if finger.detection is Detection.CONTACT_CLOSING:
            if here[i] - asked <= MISREAD_COUNTS:
                here[i] = min(here[i], asked)
        elif abs(asked - here[i]) <= 1 or (
            finger.detection is Detection.AT_TARGET and finger.requested_counts == asked
        ):
            here[i] = asked
    return tuple(here)


def closing_targets(closing: Sequence[bool], limits: Sequence[int], held: Sequence[int]) -> Counts3:
    """Targets of a closing: nothing opens, and a finger that does not close stays where it is."""
    a, b, c = (
        max(limit, here) if closes else here
        for closes, limit, here in zip(closing, limits, held, strict=True)
    )
    return a, b, c


def why_still(finger: FingerState, axis: AxisCommand, asked: int | None, grip_byte: int) -> str:
    """Why a finger will not move at a request, by a fresh status; empty when it may.

    ``asked`` is the position last requested, ``grip_byte`` the force byte it closed with.
    """
    if finger.detection is Detection.MOVING:
        return ""
    if finger.detection is Detection.CONTACT_CLOSING and axis.force <= grip_byte:
        if axis.position > finger.position_counts:
            return LATCHED
    elif finger.detection is Detection.AT_TARGET and axis.position == asked:
        return THERE
    return THERE if axis.position == finger.position_counts else ""
