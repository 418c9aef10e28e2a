"""Driver core of the Robotiq 3-Finger gripper: verbs set intent, ``poll`` does one exchange.

No thread, no sleep, no clock of its own. Source of the rules: Robotiq 3-Finger manual, 2014/2018.
Every register image carries, for each finger, a force byte whose calibrated force is within the
limit of the verb that made it, or byte 0, the least force of the hand.
"""

import math
from collections.abc import Callable, Sequence

import msgspec

from drivers.errors import Refused
from drivers.interfaces import FINGERS, Applied, Counts3, Detection, Gripper, GripperState
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.echo_watch import ACTIVATE, RESET
from drivers.robotiq.exchange import Exchange, ExchangeStatistics, RegisterTransport, WriteLog
from drivers.robotiq.hand_state import (
    POSITION_ERROR_COUNTS,
    Activation,
    HandTracker,
    checked_counts,
    closing_targets,
    hold_targets,
    no_motion_reason,
    scissor_in_contact,
)
from drivers.robotiq.protocol import (
    BASIC,
    FAULTS,
    CommandRegisters,
    Severity,
    check_not_scissor,
)
from drivers.robotiq.settings import DriverSettings

__all__ = ["ExchangeStatistics", "RegisterTransport", "RobotiqDriver"]

LATE_READ_COUNTS = 2  # lag of a position, by refresh and read

_LINK_LOST = "the link is lost: nothing is sent until the gripper answers again"


class RobotiqDriver:
    """Implements ``drivers.interfaces.Gripper`` over registers.

    Fingers are always commanded individually (rICF), all their bytes in one write. So targets of
    an earlier individual request cannot become active again.
    """

    def __init__(
        self,
        transport: RegisterTransport,
        settings: DriverSettings,
        calibration: GripperCalibration,
        log: WriteLog | None = None,
        clock: Callable[[], int] | None = None,
    ) -> None:
        """``clock`` measures the duration of an exchange; it is the clock of ``poll``'s times."""
        self._calibration = calibration
        self._exchange = Exchange(transport, settings, log, clock)
        self._hand = HandTracker(self._exchange, clock)

    def poll(self, now_ns: int) -> None:
        """Do one exchange and update the state; see ``HandTracker.poll``."""
        self._hand.poll(now_ns)

    # State

    @property
    def state(self) -> GripperState | None:
        """Latest snapshot; None before the first exchange."""
        return self._hand.state

    @property
    def mode(self) -> int:
        """Grasping mode (rMOD) at connection or activation."""
        return self._hand.mode

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
        """Counters since the driver was made."""
        return self._exchange.statistics

    @property
    def acknowledged_ns(self) -> int:
        """Time at which the gripper acknowledged the latest write; 0: none yet."""
        return self._exchange.acknowledged_ns

    @property
    def acknowledged(self) -> bool:
        """Whether the gripper has acknowledged the write of everything requested."""
        return self._exchange.all_written

    # Verbs

    def set_fallback(self, command: Callable[[Gripper], Applied] | None, text: str) -> None:
        """Nothing: this driver has no thread of its own; `drivers.robotiq.link` has one."""

    def activate(self, dropping: bool = False) -> Applied:
        """Make the hand ready in basic mode.

        A hand that is ready in basic mode without a fault is left as it is. A hand that is ready in
        another mode opens and changes to basic mode. Raises Refused where the hand may hold an
        object, unless ``dropping``.
        """
        state = self._known_state()
        if self._exchange.lost:
            return self._not_sent(_LINK_LOST)
        if self._hand.activation is not Activation.NONE:
            return self._not_sent("activation is under way")
        ready = state.active and not state.fault
        if ready and self.mode == BASIC:
            return self._not_sent("already active: left as it is")
        if self._may_hold_object(state) and not dropping:
            raise Refused(
                "activation would drop the object",
                "open the hand first; switch it off and on if it cannot be opened",
            )
        status = self._hand.status
        started = status is not None and status.active and status.initialization == 1
        if ready or (started and not state.fault):  # another mode, or another client's activation
            self._hand.begin_activation(Activation.ACTIVATING, ACTIVATE)
        else:
            self._hand.begin_activation(Activation.RESTARTING, RESET)
        return self._applied(ACTIVATE)

    def _may_hold_object(self, state: GripperState) -> bool:
        """Whether the hand may hold an object; a grip at the target position reports no contact."""
        contact = Detection.CONTACT_CLOSING in (finger.detection for finger in state.fingers)
        status = self._hand.status
        contact = contact or (status is not None and scissor_in_contact(status))
        return contact or (state.active and not state.is_open)

    def open(self, speed_mps: float) -> Applied:
        """Open all fingers to their software limits at the least force. In scissor mode also spread
        B and C, since they may hold something between them."""
        return self._move((0, 0, 0), speed_mps, (0, 0, 0), spread=True)

    def move_to(self, targets_counts: Counts3, speed_mps: float, force_n: float) -> Applied:
        """Move each finger to a position in counts, with at most ``force_n``."""
        byte = self._calibration.byte_at_most(force_n)
        return self._move(checked_counts(targets_counts), speed_mps, (byte, byte, byte))

    def close_to_limit(
        self,
        force_limit_n: float,
        closing: tuple[bool, bool, bool],
        ends_counts: Counts3,
        speed_mps: float,
    ) -> Applied:
        """Close some fingers to their limits, with at most a force; the others keep their position.

        No finger opens: one that is already beyond its limit keeps its position. Where positions
        are uncertain, it continues to its last target, no faster than before.
        """
        byte = self._calibration.byte_at_most(force_limit_n)
        limits = checked_counts(ends_counts)
        held = self._hold_targets(self._known_state())
        targets = closing_targets(closing, limits, held)
        if self._hand.positions_uncertain:
            speed_mps = self._limited_speed_mps(speed_mps)
        return self._move(targets, speed_mps, tuple(byte if closes else 0 for closes in closing))

    def _limited_speed_mps(self, speed_mps: float) -> float:
        """The speed, limited to the one commanded last."""
        fingers = self._exchange.requested_fingers
        if fingers is None:
            return speed_mps
        fastest = max(finger.speed for finger in fingers)
        return min(speed_mps, self._calibration.speed_mps(fastest))

    def hold(self) -> Applied:
        """Keep the position: every target becomes the finger's position. Never refused once
        connected.

        Where the reported positions may be old, the fingers are stopped instead (rGTO cleared),
        because a target that they have passed would move them back. That writes rACT, which
        activates a hand that has lost power, so it is done only while the status changes. Otherwise
        each target is the farthest position that the finger may have reached.
        """
        state = self._known_state()
        if not state.active or self._exchange.lost or self._hand.activation is not Activation.NONE:
            return self._not_sent("the hand does not obey motion commands: nothing was sent")
        targets: Sequence[int] = hold_targets(state.fingers, self._exchange.requested_fingers)
        go_to = state.fresh and not self._hand.positions_uncertain
        if not go_to and self._hand.unchanged:
            targets, go_to = self._farthest_targets(state), True
        command = self._hand.registers(targets, 0, (0, 0, 0))
        command = msgspec.structs.replace(command, go_to=go_to)
        self._exchange.request(command)
        return self._applied(command)

    def _farthest_targets(self, state: GripperState) -> list[int]:
        """Farthest position that each finger may have reached on the way to its last target."""
        targets = list(state.positions)
        since_ns = max(self._hand.changed_ns, self._exchange.watch.written_ns)
        since_s = (self._hand.now_ns - since_ns) * 1e-9
        for i, axis in enumerate(self._exchange.requested_fingers or ()):
            speed_cps = self._calibration.speed_mps(axis.speed) / self.m_per_count
            reach = math.ceil(since_s * speed_cps) + LATE_READ_COUNTS
            targets[i] += min(max(axis.position - targets[i], -reach), reach)
        return targets

    def _hold_targets(self, state: GripperState) -> Sequence[int]:
        """Targets that keep positions; the last targets where positions are uncertain. While no
        status shows those, a position close to one of them may be wrong too."""
        fingers = self._exchange.requested_fingers
        held = hold_targets(state.fingers, fingers)
        if fingers is None:
            return held
        last = [finger.position for finger in fingers]
        if self._hand.positions_uncertain:
            return last
        if self._hand.fresh:
            return held
        close = POSITION_ERROR_COUNTS
        return [to if abs(at - to) <= close else at for to, at in zip(last, held, strict=True)]

    # Commands

    def _move(
        self, targets: Sequence[int], speed_mps: float, forces: Sequence[int], spread: bool = False
    ) -> Applied:
        speed = self._calibration.speed_byte_at_most(speed_mps)
        state = self._ready_state()
        if any(to > at for to, at in zip(targets, state.positions, strict=True)):
            check_not_scissor(self.mode)
        command = self._hand.registers(targets, speed, forces, spread)
        if self._exchange.lost:
            return self._not_sent(_LINK_LOST)
        still = self._no_motion_reasons(command, state)
        for i, byte in enumerate(forces):
            if not still[i]:
                self._hand.grip_bytes[i] = byte
        self._exchange.request(command)
        return self._applied(command, "" if "" in still else "; ".join(sorted(set(still))))

    def _no_motion_reasons(self, command: CommandRegisters, state: GripperState) -> list[str]:
        """Why each finger will not move; empty where it may."""
        if not self._hand.fresh:
            return [""] * FINGERS  # stale detections are not conclusive
        known = self._exchange.requested_fingers or (None,) * FINGERS
        fingers = zip(state.fingers, command.axes, known, self._hand.grip_bytes, strict=False)
        return [no_motion_reason(finger, axis, was, byte) for finger, axis, was, byte in fingers]

    # Results of verbs

    def _known_state(self) -> GripperState:
        state = self.state
        if state is None:
            raise Refused("no status was received yet", "poll the driver first")
        return state

    def _ready_state(self) -> GripperState:
        state = self._known_state()
        if self._hand.activation is not Activation.NONE:
            raise Refused("activation is under way", "wait until the hand is active")
        if FAULTS[state.fault].severity is Severity.MAJOR:
            raise Refused(f"gripper fault: {state.fault_text}", FAULTS[state.fault].remedy)
        if not state.active:
            raise Refused("the hand is not activated", "activate it first")
        return state

    def _applied(self, command: CommandRegisters, note: str = "") -> Applied:
        """Targets, speed and force in these registers; a note means that nothing will move."""
        a, b, c, _ = command.axes
        return Applied(
            targets_counts=(a.position, b.position, c.position),
            speed_mps=self._calibration.speed_mps(a.speed),
            force_n=self._calibration.force_n(max([axis.force for axis in command.axes])),
            effective=not note,
            note=note,
        )

    def _not_sent(self, note: str) -> Applied:
        """Result of a verb that sends nothing: the present request, with the reason."""
        requested = self._exchange.requested
        if requested is None:
            requested = self._hand.registers(self._known_state().positions, 0, (0, 0, 0))
        return self._applied(requested, note)
