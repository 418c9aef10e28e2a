"""State of the hand, updated at each exchange: fingers, faults, unrequested resets, activation.

Also converts a status to finger states, and targets to command registers. The verbs are in
``drivers.robotiq.driver``.
"""

from collections.abc import Callable, Sequence
from enum import Enum

import msgspec

from drivers.errors import DeviceFault, Refused
from drivers.interfaces import FINGERS, Counts3, Detection, FingerState, GripperState
from drivers.robotiq.echo_watch import ACTIVATE, RESET
from drivers.robotiq.exchange import Exchange
from drivers.robotiq.protocol import (
    BASIC,
    FAULTS,
    FULL_BYTE,
    JUMP_TOLERANCE_COUNTS,
    SCISSOR,
    AxisCommand,
    AxisStatus,
    CommandRegisters,
    Severity,
    StatusRegisters,
)

_ACTIVATES = "the gripper lost its activation, and the next command made it activate"
_NOT_ACTIVATED = "activation did not complete: verify that nothing interferes with the fingers"
_DISOBEYS = "activation did not complete: the device does not obey (gACT {:d}, gIMC {})"
_WRONG_DEVICE = "verify that the address is the gripper's; switch the gripper off and on"
_CHANGED = "another client changed the gripper's registers, or they are misreported: {}"
_END_IT = "end every other program that commands the gripper"
_WHO_ELSE = "end every other program that commands it; switch it off and on, activate it"
_DETECTIONS = tuple(Detection)
_MOVING = Detection.MOVING
# A status that stays equal for so long while a finger moves gives no positions any more. Assumed: a
# count takes 0.035 s at the lowest speed.
STATUS_UNCHANGED_NS = 100_000_000
MAX_SPEED_COUNTS_PS = 300.0  # no finger is faster; twice full speed, manual 0.11 m/s
_ACTIVATION_NS = 20_000_000_000  # longest activation; assumed
POSITION_ERROR_COUNTS = 16  # largest position error; a target farther back means opening

LATCHED_NOTE = "contact is latched: closing has no effect without a higher force"
AT_TARGET_NOTE = "already at the target"


class Activation(Enum):
    """Stage of an activation that ``poll`` carries out."""

    NONE = 0
    RESTARTING = 1  # rACT cleared, waits for gACT = 0, then activates
    ACTIVATING = 2  # rACT set, waits for gIMC = 3


class HandTracker:
    """State of the hand behind an exchange: fingers, faults, and the activation that ``poll``
    carries out."""

    def __init__(self, exchange: Exchange, clock: Callable[[], int] | None) -> None:
        """``clock`` measures the duration of an exchange; it is the clock of ``poll``'s times."""
        self._clock = clock
        self._exchange = exchange
        self.status: StatusRegisters | None = None  # the next two are derived from it
        self._fault = FAULTS[0]
        self._active = False  # the hand obeys motion commands
        self.mode = 0  # rMOD at connection or activation: another one would open the hand
        self._other_mode = False  # the status reports another mode
        self._fingers: tuple[FingerState, FingerState, FingerState] | None = None
        self._state: GripperState | None = None
        self.now_ns = 0
        self._seq = 0
        self.changed_ns = 0  # when the status last differed from the one before
        self._position_jumped = False  # a position changed faster than a motor can move
        self.activation = Activation.NONE
        self._deadline_ns = 0
        self.grip_bytes = [FULL_BYTE] * FINGERS  # force byte of the grip; unknown counts as full
        self._raised_fault = 0  # major fault that was raised already

    # State

    @property
    def state(self) -> GripperState | None:
        """Latest snapshot; None before the first exchange."""
        state = self._state
        if state is not None and state.fresh and not self.fresh:
            self._state = state = msgspec.structs.replace(state, fresh=False)
        return state

    @property
    def fresh(self) -> bool:
        """Whether the status reflects everything requested, and no activation is under way."""
        return self.activation is Activation.NONE and self._exchange.confirmed

    @property
    def positions_uncertain(self) -> bool:
        """Whether reported positions may be wrong: a finger moves while the status stays equal, or
        a position has changed faster than a motor can move."""
        fingers = self._fingers or ()
        moving = any(finger.detection is Detection.MOVING for finger in fingers)
        return self._position_jumped or (moving and self.unchanged)

    @property
    def unchanged(self) -> bool:
        """Whether the status has stayed equal for so long that a moving finger would change it."""
        return self.now_ns - self.changed_ns > STATUS_UNCHANGED_NS

    # Exchange

    def poll(self, now_ns: int) -> None:
        """Do one exchange: at most one write, one read, one change of state.

        Raises ``LinkLost`` when the device does not answer. Raises ``DeviceFault`` once for each
        fault that stops motion, for an activation that does not end and for registers that another
        client changed; the last request is then written again.
        """
        self.now_ns = now_ns
        was_lost = self._exchange.lost
        status = self._exchange.poll(now_ns)
        if status is None:
            return
        overwritten = self._exchange.watch.overwritten
        changed = status is not self.status
        if changed:
            self.status, self._fault = status, FAULTS[status.fault]
            self._active = status.ready and self._fault.severity is not Severity.MAJOR
        if self.activation is not Activation.NONE or self._exchange.requested is None:
            self.mode = status.mode
        unrequested = False
        if was_lost or not self._active:
            unrequested = self._handle_reset(status, was_lost, now_ns)
        if self.activation is not Activation.NONE:
            self._continue_activation(status, now_ns)
        self._publish(status, now_ns, changed)
        self._raise_fault(status, now_ns)
        if unrequested:
            raise DeviceFault(_ACTIVATES, "keep clear: the fingers may have moved; activate it")
        if overwritten:
            raise DeviceFault(_CHANGED.format(overwritten), _END_IT)

    def _handle_reset(self, status: StatusRegisters, was_lost: bool, now_ns: int) -> bool:
        """Respond to an unrequested reset; returns whether the hand activates unrequested. Called
        where the link was lost or the hand is not active."""
        requested, idle = self._exchange.requested, self.activation is Activation.NONE
        activating = status.active and status.initialization == 1 and idle
        stopped = self._fault.severity is Severity.MAJOR
        allowed = requested in (None, ACTIVATE) or (requested == RESET and not was_lost)
        if activating and not allowed and not stopped:
            # it lost power between a read and the next write, which set rACT
            self._exchange.request(RESET)
            self._exchange.poll(now_ns)
            return True
        reset = idle and requested is not None and requested.activate and not status.active
        if was_lost or reset:  # as after a power cycle, whether written yet or not
            self._resynchronize(status)
        elif activating and requested == RESET and self._exchange.settled(now_ns):
            self._exchange.rewrite()  # the reset was written two refreshes ago without effect
        return False

    def _resynchronize(self, status: StatusRegisters) -> None:
        """Drop the request: no motion without a new verb, and no unrequested activation."""
        self.activation, self._position_jumped = Activation.NONE, False
        self.grip_bytes = [FULL_BYTE] * FINGERS
        if self._exchange.requested is None:
            return
        self._exchange.statistics.resynced += 1
        pending = self._exchange.watch.unconfirmed and not status.active
        self._exchange.request(None)
        if pending:  # a booting hand would take up the old request afterwards
            self._exchange.request(RESET)
        if status.ready:
            positions = tuple(finger.position for finger in status.fingers)
            self._exchange.request(self.registers(positions, 0, (0, 0, 0)))

    def _publish(self, status: StatusRegisters, now_ns: int, changed: bool) -> None:
        took_ns = 0 if self._clock is None else self._clock() - now_ns
        if changed or self._fingers is None:
            self._position_jumped |= self._has_jumped(status, now_ns + took_ns)
            self.changed_ns = now_ns
            self._fingers = finger_states(status)
        self._seq += 1
        exchange, fault = self._exchange, self._fault
        self._state = GripperState(
            now_ns, self._seq, self._active, fault.code, fault.text, self.fresh, self._fingers,
            took_ns, exchange.last_write_hex, exchange.last_write_ns,
        )  # fmt: skip

    def _has_jumped(self, status: StatusRegisters, now_ns: int) -> bool:
        """Whether a finger moved farther than a motor can since the previous status was requested;
        ``now_ns`` is when this one arrived."""
        if self._fingers is None or self._state is None:
            return False
        reach = JUMP_TOLERANCE_COUNTS + MAX_SPEED_COUNTS_PS * (now_ns - self._state.t_ns) * 1e-9
        pairs = zip(self._fingers, status.fingers, strict=True)
        return max([abs(was.position_counts - now.position) for was, now in pairs]) > reach

    def _raise_fault(self, status: StatusRegisters, now_ns: int) -> None:
        fault = self._fault
        major = fault.severity is Severity.MAJOR
        onset = major and fault.code != self._raised_fault
        self._raised_fault = fault.code if major else 0
        if onset:
            if self.activation is not Activation.RESTARTING:
                self.activation = Activation.NONE
            raise DeviceFault(f"gripper fault 0x{fault.code:02X}: {fault.text}", fault.remedy)
        was_other = self._other_mode
        self._other_mode = status.mode != self.mode and status.active
        if self._other_mode and not was_other:
            difference = f"rMOD {status.mode}, expected {self.mode}"
            raise DeviceFault(_CHANGED.format(difference), _WHO_ELSE)
        if self.activation is not Activation.NONE and now_ns > self._deadline_ns:
            expected = self.activation is Activation.ACTIVATING
            self.activation = Activation.NONE
            if (status.initialization != 0) != expected:
                seen = _DISOBEYS.format(status.active, status.initialization)
                raise DeviceFault(seen, _WRONG_DEVICE)
            raise DeviceFault(_NOT_ACTIVATED + (fault.text and f" ({fault.text})"), "activate")

    # Activation

    def begin_activation(self, stage: Activation, command: CommandRegisters) -> None:
        self.activation = stage
        self._deadline_ns = self.now_ns + _ACTIVATION_NS
        self._exchange.request(command)

    def _continue_activation(self, status: StatusRegisters, now_ns: int) -> None:
        if not self._exchange.settled(now_ns):
            return
        if self.activation is Activation.RESTARTING and not status.active and not status.fault:
            self.activation = Activation.ACTIVATING
            self._exchange.request(ACTIVATE)
        elif self.activation is Activation.ACTIVATING and status.ready and status.mode == BASIC:
            self.activation, self._position_jumped = Activation.NONE, False

    # Registers

    def registers(
        self, targets: Sequence[int], speed: int, forces: Sequence[int], spread: bool = False
    ) -> CommandRegisters:
        """Command registers for a motion. ``spread``: in scissor mode, spread B and C apart;
        otherwise the scissor axis stays where it is.

        In scissor mode that axis always gets its own target (rICS), at the least force. Without
        one, a hand moves its scissor to finger A's target and obeys no individual finger.
        """
        command = motion_registers(self.mode, targets, speed, forces)
        if self.mode != SCISSOR or self.status is None:
            return command
        to = AxisCommand(0, speed) if spread else AxisCommand(self.status.scissor.position)
        return msgspec.structs.replace(command, individual_scissor=True, scissor=to)


def finger_states(status: StatusRegisters) -> tuple[FingerState, FingerState, FingerState]:
    """States of all fingers. In scissor mode B and C count as moving while the scissor moves."""
    a, b, c = [finger_state(axis, status) for axis in status.fingers]
    if status.mode == SCISSOR and status.go_to and _DETECTIONS[status.scissor.detection] is _MOVING:
        b, c = (msgspec.structs.replace(finger, detection=_MOVING) for finger in (b, c))
    return a, b, c


def finger_state(axis: AxisStatus, status: StatusRegisters) -> FingerState:
    """State of one finger. gDT = 0 means moving only while gGTO is set (manual, gDT): otherwise a
    hand is stationary unless it is activating or changing its mode.
    """
    detection = _DETECTIONS[axis.detection]
    busy = status.go_to or status.initialization in (1, 2)
    if detection is _MOVING and not busy:
        detection = Detection.AT_TARGET
    return FingerState(axis.echo, axis.position, axis.current_ma, detection)


def scissor_in_contact(status: StatusRegisters) -> bool:
    """Whether B and C hold something between them, as they close on each other in scissor mode."""
    met = _DETECTIONS[status.scissor.detection]
    return status.mode == SCISSOR and met is Detection.CONTACT_CLOSING


def checked_counts(targets: Sequence[int]) -> Sequence[int]:
    """The targets, if they are three counts; raises Refused otherwise."""
    if len(targets) != FINGERS or any(not 0 <= target <= FULL_BYTE for target in targets):
        raise Refused(f"targets {tuple(targets)} are not counts", "give three counts, 0 to 255")
    return targets


def motion_registers(
    mode: int, targets: Sequence[int], speed: int, forces: Sequence[int]
) -> CommandRegisters:
    """Individual finger commands (rICF) with all targets, so that no earlier target stays valid.

    ``mode`` must be the hand's present mode: another one would open the fingers first.
    """
    a, b, c = [
        AxisCommand(target, speed, byte) for target, byte in zip(targets, forces, strict=True)
    ]
    return CommandRegisters(
        activate=True, mode=mode, go_to=True, individual_fingers=True, a=a, b=b, c=c
    )


def hold_targets(
    fingers: Sequence[FingerState], last: Sequence[AxisCommand] | None
) -> tuple[int, ...]:
    """Targets that keep the fingers where they are: their positions.

    A finger that reports to be at its target keeps that target. Its reported position may be some
    counts off, and following it would make the finger creep or press. For the same reason a finger
    in contact gets no target beyond the present one. An exception is a finger that was commanded
    to open and still reports contact: it must not continue to open. ``last``: the last requests for
    the fingers, None where no motion is requested.
    """
    targets = [finger.position_counts for finger in fingers]
    for i, axis in enumerate(last or ()):
        finger, commanded = fingers[i], axis.position
        if finger.detection is Detection.CONTACT_CLOSING:
            if targets[i] - commanded <= POSITION_ERROR_COUNTS:
                targets[i] = min(targets[i], commanded)
        elif abs(commanded - targets[i]) <= 1 or (
            finger.detection is Detection.AT_TARGET and finger.requested_counts == commanded
        ):
            targets[i] = commanded
    return tuple(targets)


def closing_targets(
    closing: Sequence[bool], limits: Sequence[int], positions: Sequence[int]
) -> Counts3:
    """Closing targets: no finger opens, and a finger that does not close keeps its position."""
    a, b, c = (
        max(limit, position) if closes else position
        for closes, limit, position in zip(closing, limits, positions, strict=True)
    )
    return a, b, c


def no_motion_reason(
    finger: FingerState, axis: AxisCommand, last: AxisCommand | None, grip_byte: int
) -> str:
    """Reason why a request will not move a finger, by a fresh status; empty when it may move.

    ``last`` is the request before, ``grip_byte`` the force byte that the finger closed with.
    """
    if finger.detection is Detection.MOVING:
        return ""
    if finger.detection is Detection.CONTACT_CLOSING and axis.force <= grip_byte:
        if axis.position > finger.position_counts:
            return LATCHED_NOTE
    elif finger.detection is Detection.AT_TARGET and last and axis.position == last.position:
        return AT_TARGET_NOTE
    return AT_TARGET_NOTE if axis.position == finger.position_counts else ""
