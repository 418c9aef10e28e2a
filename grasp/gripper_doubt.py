"""What a gripper says and cannot be: the part of ``grasp.doubt`` that watches it."""

from itertools import compress

from drivers.interfaces import FINGER_NAMES, FINGERS, Detection, FingerState, GripperState
from grasp.doubt_settings import DoubtSettings
from grasp.flicker import Flicker

LOOKS = 5  # without an answer, however long each took: one may be under way for two
UNKNOWN = -1  # of a finger's motion, while the status speaks of no command
TOUCHING = (Detection.CONTACT_CLOSING, Detection.CONTACT_OPENING)  # it stands since


class GripperDoubt:
    """Status that does not follow a command, or that no hand can have."""

    def __init__(self, settings: DoubtSettings) -> None:
        self._settings = settings
        self._before: GripperState | None = None
        self._fresh_ns: int
        self._unanswered: int  # looks since
        self._moved_ns: list[int]  # since when each finger reports motion without moving
        self._under_way = [False] * FINGERS  # it has moved since it was told to
        self._touched_at: list[int | None] = [None] * FINGERS  # where it first reported contact
        self._flickers = tuple(Flicker() for _ in range(FINGERS))

    def begin_anew(self, state: GripperState) -> None:
        """How long it has been silent, or stood, was not seen: that counts from now."""
        self._fresh_ns, self._unanswered = state.t_ns, 0
        self._moved_ns = [state.t_ns] * FINGERS

    def told(self) -> None:
        """A command goes out: what the hand says of its motion may change for it."""
        for flicker in self._flickers:
            flicker.told()

    def see(self, state: GripperState) -> str:
        """What is wrong with it."""
        before, self._before = self._before, state
        if before is None:
            before = state
            self.begin_anew(state)
        elif state.fresh:
            self._fresh_ns, self._unanswered = state.t_ns, 0
        else:
            self._unanswered += 1
        for i, (was, now) in enumerate(zip(before.fingers, state.fingers, strict=True)):
            moving = state.fresh and now.detection is Detection.MOVING
            if not moving or was.position_counts != now.position_counts:
                self._moved_ns[i] = state.t_ns
                # told the same as before, it is seen to move
                self._under_way[i] = moving and was.requested_counts == now.requested_counts
            if not state.fresh or now.detection not in TOUCHING:
                self._touched_at[i] = None
            elif self._touched_at[i] is None:
                self._touched_at[i] = now.position_counts
        # both: a hand that has lost power may say nonsense of where it is, too
        found = "; ".join(filter(None, (self._inactive(state), self._impossible(before, state))))
        return found or self._flickering(before, state) or self._idle(state)

    def _flickering(self, before: GripperState, state: GripperState) -> str:
        fingers = zip(self._flickers, before.fingers, state.fingers, strict=True)
        wrong = []
        for flicker, was, now in fingers:
            if was.requested_counts != now.requested_counts:
                flicker.told()
            wrong.append(flicker.take(state.t_ns, now.detection if state.fresh else UNKNOWN))
        if not any(wrong):
            return ""
        names = ", ".join(compress(FINGER_NAMES, wrong))
        return f"gripper_flickers: finger {names} says one thing of its motion and then another"

    def _inactive(self, state: GripperState) -> str:
        if state.active or state.fault:
            return ""  # a fault has a text of its own
        return "gripper_inactive: the hand has lost its activation and obeys no motion"

    def _impossible(self, before: GripperState, state: GripperState) -> str:
        s = self._settings
        # each tells of a moment between when it was asked for and when it was there
        passed_s = (state.t_ns + state.took_ns - before.t_ns) * 1e-9
        reach = s.target_counts + s.finger_counts_ps * passed_s
        fingers = zip(FINGER_NAMES, before.fingers, state.fingers, self._touched_at, strict=True)
        for name, was, now, first in fingers:
            here = now.position_counts
            if not 0 <= here <= 255:
                return f"gripper_impossible: finger {name} at {here} counts"
            if abs(here - was.position_counts) > reach:
                return f"gripper_impossible: finger {name} leapt {was.position_counts} to {here}"
            if first is not None and abs(here - first) > s.contact_counts:
                return (
                    f"gripper_impossible: finger {name} reports contact and moved {first} to {here}"
                )
            if state.fresh and self._contradicts(now):
                return (
                    f"gripper_impossible: finger {name} says 'at target' at {here} counts, "
                    f"asked for {now.requested_counts}"
                )
        return ""

    def _contradicts(self, finger: FingerState) -> bool:
        s, asked = self._settings, finger.requested_counts
        return (
            finger.detection is Detection.AT_TARGET
            and s.soft_low_counts <= asked <= s.soft_high_counts
            and abs(finger.position_counts - asked) > s.target_counts
        )

    def _idle(self, state: GripperState) -> str:
        s = self._settings
        silent_s = (state.t_ns - self._fresh_ns) * 1e-9
        refuses = state.fault and not state.active  # and said so: no answer is to be waited for
        if silent_s > s.echo_s and self._unanswered >= LOOKS and not refuses:
            return f"gripper_silent: {silent_s:.2f} s without an answer to a command"
        standing = [state.t_ns - since_ns for since_ns in self._moved_ns]
        if not any(standing):  # most often
            return ""
        fingers = zip(standing, state.fingers, strict=True)
        stands = [ns >= self._patience_s(i, f) * 1e9 for i, (ns, f) in enumerate(fingers)]
        if any(stands):
            names = ", ".join(compress(FINGER_NAMES, stands))
            return f"gripper_stands: finger {names} reports motion and does not move"
        return ""

    def _patience_s(self, i: int, finger: FingerState) -> float:
        """One that presses is as slow as what gives way lets it be."""
        s = self._settings
        if finger.current_ma >= s.pressing_ma:
            return max(s.pressing_s, s.finger_start_s)
        return s.stands_s if self._under_way[i] else s.finger_start_s
