"""Plausibility of the gripper's status: impossible values, and motion that ignores commands."""

from collections.abc import Sequence

from drivers.interfaces import FINGER_NAMES, FINGERS, Counts3, Detection, GripperState
from grasp.control.commands import CloseToLimit, GripperCommand, MoveFingers, OpenFingers
from grasp.control.monitors.settings import FLIPS, Failures, Fields, MonitorSettings, too_often

OUTDATED_READS = 5  # status reads before a command counts as ignored: it may be on its way for two
CONTACT = (Detection.CONTACT_CLOSING, Detection.CONTACT_OPENING)
# A finger whose motor draws so much is in contact (manual p. 68-73: 110-160 mA in free motion). At
# its force limit it creeps, so it may keep its count for as long as this; assumed.
PRESSING_MA = 200
PRESSING_S = 2.0
JUMP_COUNTS = 8  # in addition to possible travel: a zero is off by up to 5, manual p. 74
CONTACT_COUNTS = 3  # most motion of a finger that reports contact; assumed
FINGER_COUNTS_PS = 300.0  # fastest: twice full speed (manual: 0.11 m/s, 143 counts/s)


class GripperHistory:
    """The last status, and since when its parts have not changed."""

    def __init__(self, settings: MonitorSettings) -> None:
        self._settings = settings
        self._last: GripperState | None = None
        self._command: GripperCommand | None = None
        self._fresh_ns = 0  # time of the last status that includes the last command
        self._outdated_reads = 0  # status reads since
        self._moved_ns = [0] * FINGERS  # since when each finger reports motion without moving
        self._touched_at: list[int | None] = [None] * FINGERS  # where it first reported contact
        self._flips_ns: list[list[int]] = [[], [], []]  # times at which each report changed

    def sent(self, command: GripperCommand) -> None:
        """Take a command of this step."""
        self._command = command

    def update(self, state: GripperState) -> Failures:
        """Take the status of this step; returns the checks that it fails."""
        before, self._last = self._last, state
        if before is None:
            before = state
            self._moved_ns = [state.t_ns] * FINGERS
            self._fresh_ns, self._outdated_reads = state.t_ns, -1
        failures: Failures = {}
        if not state.active and not state.fault:  # a fault has its own text
            failures["gripper_inactive"] = {}
        if impossible := self._impossible(before, state):
            failures["gripper_impossible"] = impossible
        if state.fresh:
            self._fresh_ns, self._outdated_reads = state.t_ns, 0
        elif unconfirmed := self._unconfirmed(state):
            failures["gripper_unconfirmed"] = unconfirmed
        if names := self._stands(before, state):
            failures["gripper_stands"] = {"finger": ", ".join(names)}
        if names := self._flickers(before, state):
            failures["gripper_flickers"] = {"finger": ", ".join(names)}
        return failures

    def _impossible(self, before: GripperState, state: GripperState) -> Fields | None:
        """The first finger that jumped, or moved although it reports contact."""
        # a status dates from some moment between its request and its arrival
        elapsed_s = (state.t_ns + state.took_ns - before.t_ns) * 1e-9
        most = JUMP_COUNTS + FINGER_COUNTS_PS * elapsed_s
        wrong: Fields | None = None
        for i, finger in enumerate(state.fingers):
            was, here = before.fingers[i].position_counts, finger.position_counts
            touched_at = self._touched_at[i]
            if not state.fresh or finger.detection not in CONTACT:
                touched_at = None
            elif touched_at is None:
                touched_at = here
            self._touched_at[i] = touched_at
            if abs(here - was) > most:
                how = f"jumped from {was} to {here} counts"
            elif touched_at is not None and abs(here - touched_at) > CONTACT_COUNTS:
                how = f"moved in contact from {touched_at} to {here} counts"
            else:
                continue
            wrong = wrong or {"finger": FINGER_NAMES[i], "how": how}
        return wrong

    def _unconfirmed(self, state: GripperState) -> Fields | None:
        """How long no status has shown the last command, and what it shows. A faulty, inactive hand
        may ignore commands."""
        self._outdated_reads += 1
        since_s = (state.t_ns - self._fresh_ns) * 1e-9
        long = since_s > self._settings.echo_s and self._outdated_reads >= OUTDATED_READS
        refuses = state.fault and not state.active
        if not long or refuses:
            return None
        return {"seconds": round(since_s, 3), "how": self._difference(state.requested)}

    def _difference(self, echo: Counts3) -> str:
        """The targets in the status that are not those of the last command."""
        expected: Sequence[int] = echo  # where the driver chooses the target
        match self._command:
            case MoveFingers(targets):
                expected = targets
            case OpenFingers():
                expected = (0, 0, 0)
            case CloseToLimit(closing=closing, ends_counts=limits):
                closes = zip(closing, limits, echo, strict=True)
                expected = [max(to, at) if moves else at for moves, to, at in closes]
        wrong = [
            f"target of finger {name} {at}, expected {to}"
            for name, at, to in zip(FINGER_NAMES, echo, expected, strict=True)
            if at != to
        ]
        return "; ".join(wrong) or f"targets {echo} or rGTO are not as written"

    def _stands(self, before: GripperState, state: GripperState) -> list[str]:
        """Fingers that report motion but keep their count."""
        wrong, start_s = [], self._settings.finger_start_s
        for i, finger in enumerate(state.fingers):
            moving = state.fresh and finger.detection is Detection.MOVING
            if not moving or finger.position_counts != before.fingers[i].position_counts:
                self._moved_ns[i] = state.t_ns
                continue
            presses = finger.current_ma >= PRESSING_MA
            most_s = max(PRESSING_S, start_s) if presses else start_s
            if state.t_ns - self._moved_ns[i] >= most_s * 1e9:
                wrong.append(FINGER_NAMES[i])
        return wrong

    def _flickers(self, before: GripperState, state: GripperState) -> list[str]:
        """Fingers that alternate between reports, as under the commands of another client."""
        wrong = []
        for i, finger in enumerate(state.fingers):
            was, flips_ns = before.fingers[i], self._flips_ns[i]
            if was.requested_counts != finger.requested_counts:
                flips_ns.clear()
            elif was.detection is not finger.detection and state.fresh and before.fresh:
                flips_ns.append(state.t_ns)
            if len(flips_ns) > FLIPS and too_often(flips_ns, state.t_ns):
                wrong.append(FINGER_NAMES[i])
        return wrong
