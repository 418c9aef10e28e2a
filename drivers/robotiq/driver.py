"""Driver core of the Robotiq 3-Finger gripper: verbs set intent, ``poll`` does one exchange.

No thread, no sleep, no clock of its own. Source of the rules: Robotiq 3-Finger manual, 2014/2018.
Every register image carries, for each finger, a force byte whose calibrated force is within the cap
of the verb that made it, or byte 0: the least force that the hand can be told.
"""

import math
from collections.abc import Sequence

import msgspec

from drivers.errors import Refused
from drivers.interfaces import FINGERS, Applied, Counts3, Detection, GripperState
from drivers.robotiq.exchange import (
    ACTIVATE,
    RESET,
    DriverSettings,
    ExchangeStatistics,
    RegisterTransport,
)
from drivers.robotiq.hand_state import (
    STATUS_OLD_NS,
    Step,
    TrackedHand,
    checked_counts,
    closing_targets,
    held_targets,
    pinches,
    why_still,
)
from drivers.robotiq.protocol import (
    BASIC,
    FAULTS,
    AxisCommand,
    CommandRegisters,
    Severity,
    check_closing,
)

__all__ = ["DriverSettings", "ExchangeStatistics", "RegisterTransport", "RobotiqDriver"]

LATE_COUNTS = 2  # by which a position lags that was read and refreshed

_LOST = "the link is lost: nothing is sent until it answers again"


class RobotiqDriver(TrackedHand):
    """Implements ``drivers.interfaces.Gripper`` over registers.

    Fingers are always commanded one by one (rICF), all their bytes in one write: targets left over
    from an earlier individual request cannot come back to life.
    """

    # Verbs

    def activate(self, dropping: bool = False) -> Applied:
        """Make the hand ready, in basic mode. One that is so and without fault is taken over as it
        is; one that may hold something is left alone, unless it may drop that. One that is ready in
        another mode is told the basic one, for which it opens first."""
        state = self._known()
        if self._exchange.lost:
            return self._nothing(_LOST)
        if self._step is not Step.NONE:
            return self._nothing("activation is under way")
        well = state.active and not state.fault
        if well and self.mode == BASIC:
            return self._nothing("already active: taken over as it is")
        if self._holds(state) and not dropping:
            raise Refused(
                "activation would drop what the fingers hold",
                "open first; switch the hand off and on if it cannot",
            )
        status = self._status
        begun = status is not None and status.active and status.initialization == 1
        if well or (begun and not state.fault):
            self._begin(Step.ACTIVATING, ACTIVATE)  # in another mode, or begun by another master
        else:
            self._begin(Step.RESTARTING, RESET)
        return self._of(ACTIVATE)

    def _holds(self, state: GripperState) -> bool:
        """Whether it may hold something; who holds by position feels no contact."""
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
        on to where it was told to, no faster than before.
        """
        byte = self._calibration.byte_at_most(force_cap_n)
        limits = checked_counts(limits_counts)
        held = self._held(self._known())
        targets = closing_targets(closing, limits, held)
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

        Where the reported positions may be old the fingers are stopped instead (rGTO cleared): a
        target that has been passed would move them back. But that writes rACT, which activates a
        hand that has lost power, so it is done only while the status is seen to change. Where it is
        not, a finger goes on by what it may have moved at most.
        """
        state = self._known()
        if not state.active or self._exchange.lost or self._step is not Step.NONE:
            return self._nothing("the hand does not obey motion commands: nothing was sent")
        targets: Sequence[int] = held_targets(state.fingers, self._exchange.wanted)
        go_to = state.fresh and not self._doubtful(state)
        if not go_to and self._now_ns - self._changed_ns > STATUS_OLD_NS:
            targets, go_to = self._reached_at_most(state), True
        command = self._image(targets, 0, (0, 0, 0))
        command = msgspec.structs.replace(command, go_to=go_to)
        self._exchange.want(command)
        return self._of(command)

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

    def _doubtful(self, state: GripperState) -> bool:
        """Whether the fingers may be elsewhere: one moves, and the status has not changed lately.
        Or one was where no motor can have brought it."""
        moving = any(finger.detection is Detection.MOVING for finger in state.fingers)
        return self._leapt or (moving and self._now_ns - self._changed_ns > STATUS_OLD_NS)

    def _held(self, state: GripperState) -> Sequence[int]:
        """Targets of fingers that hold: where they are, or their last ones if that is doubtful."""
        wanted = self._exchange.wanted
        if self._doubtful(state) and wanted is not None and wanted.go_to:
            return [axis.position for axis in wanted.axes[:FINGERS]]
        return held_targets(state.fingers, wanted)

    # Images

    def _move(
        self, targets: Sequence[int], speed_mps: float, forces: Sequence[int], spread: bool = False
    ) -> Applied:
        speed = self._calibration.speed_byte_at_most(speed_mps)
        state = self._ready()
        if any(to > at for to, at in zip(targets, state.positions, strict=True)):
            check_closing(self.mode)
        command = self._image(targets, speed, forces, spread)
        if self._exchange.lost:
            return self._nothing(_LOST)
        still = [self._why_still(i, command.axes[i], state) for i in range(FINGERS)]
        for i, byte in enumerate(forces):
            if not still[i]:
                self._grip_bytes[i] = byte
        self._exchange.want(command)
        return self._of(command, "" if "" in still else "; ".join(sorted(set(still))))

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
            raise Refused("no status was received yet", "poll the driver first")
        return state

    def _ready(self) -> GripperState:
        state = self._known()
        if self._step is not Step.NONE:
            raise Refused("activation is under way", "wait until the hand is active")
        if FAULTS[state.fault].severity is Severity.MAJOR:
            raise Refused(f"gripper fault: {state.fault_text}", FAULTS[state.fault].remedy)
        if not state.active:
            raise Refused("the hand is not activated", "activate it first")
        return state

    def _of(self, command: CommandRegisters, note: str = "") -> Applied:
        """What the bytes of an image say; a note means that nothing will move."""
        a, b, c, _ = command.axes
        return Applied(
            targets_counts=(a.position, b.position, c.position),
            speed_mps=self._calibration.speed_mps(a.speed),
            force_n=self._calibration.force_n(max(axis.force for axis in command.axes)),
            effective=not note,
            note=note,
        )

    def _nothing(self, note: str) -> Applied:
        """Answer of a verb that sends nothing: what is wanted already, with the reason."""
        wanted = self._exchange.wanted
        if wanted is None:
            wanted = self._image(self._known().positions, 0, (0, 0, 0))
        return self._of(wanted, note)
