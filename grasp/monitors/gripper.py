"""Gripper status that does not follow a command, or that no hand can have."""

from itertools import compress

from drivers.interfaces import FINGER_NAMES, FINGERS, Detection, FingerState, GripperState
from grasp.monitors.flips import Flips
from grasp.monitors.settings import Data, MonitorSettings

LOOKS = 5  # without an answer, however long each took: one may be under way for two
TOUCHING = (Detection.CONTACT_CLOSING, Detection.CONTACT_OPENING)  # it stands since
# A finger whose motor draws so much presses on something (manual p. 68-73: 110-160 mA moving
# freely). At its force it creeps, so it may keep its count for as long as this; assumed.
PRESSING_MA = 200
PRESSING_S = 2.0
TARGET_COUNTS = 8  # a finger 'at target' may be off it; a zero is off by up to 5, manual p. 74
CONTACT_COUNTS = 3  # a finger that reports contact stands; it may move by this; assumed
SOFT_COUNTS = range(20, 201)  # targets beyond are cut by software limits of opening and closing
FINGER_COUNTS_PS = 300.0  # no finger is faster: twice full speed (manual: 0.11 m/s, 143 counts/s)


class GripperHistory:
    """Since when each part of the status says what it says."""

    def __init__(self) -> None:
        self.state: GripperState
        self.before: GripperState | None = None
        self.fresh_ns = 0  # when it spoke of the last command
        self.unanswered = 0  # looks since
        self.moved_ns = [0] * FINGERS  # since when each finger reports motion without moving
        self.touched_at: list[int | None] = [None] * FINGERS  # where it first reported contact

        self.flips = [Flips() for _ in range(FINGERS)]

    def command(self) -> None:
        """A command goes out: what the hand reports of its motion may change for it."""
        for flips in self.flips:
            flips.clear()

    def restart(self, state: GripperState) -> None:
        """How long it has been silent, or stood, was not seen: that counts from now."""
        self.fresh_ns, self.unanswered = state.t_ns, 0
        self.moved_ns = [state.t_ns] * FINGERS

    def update(self, state: GripperState) -> None:
        """The status of this step."""
        if self.before is None:
            self.state = state
            self.restart(state)
        elif state.fresh:
            self.fresh_ns, self.unanswered = state.t_ns, 0
        else:
            self.unanswered += 1
        self.before, self.state = self.state, state
        for i, (was, now) in enumerate(zip(self.before.fingers, state.fingers, strict=True)):
            moving = state.fresh and now.detection is Detection.MOVING
            if was.requested_counts != now.requested_counts:
                self.flips[i].clear()
            self.flips[i].update(state.t_ns, now.detection if state.fresh else "unknown")
            if not moving or was.position_counts != now.position_counts:
                self.moved_ns[i] = state.t_ns
            if not state.fresh or now.detection not in TOUCHING:
                self.touched_at[i] = None
            elif self.touched_at[i] is None:
                self.touched_at[i] = now.position_counts


def inactive(h: GripperHistory, s: MonitorSettings) -> Data:
    """The activation is lost, and no fault says why."""
    return None if h.state.active or h.state.fault else {}


def impossible(h: GripperHistory, s: MonitorSettings) -> Data:
    """A leap, motion in contact, or 'at target' beside the target."""
    assert h.before is not None  # noqa: S101  (updated)
    # each tells of a moment between when it was asked for and when it was there
    passed_s = (h.state.t_ns + h.state.took_ns - h.before.t_ns) * 1e-9
    reach = TARGET_COUNTS + FINGER_COUNTS_PS * passed_s
    fingers = zip(FINGER_NAMES, h.before.fingers, h.state.fingers, h.touched_at, strict=True)
    for name, was, now, touched_at in fingers:
        here, asked = now.position_counts, now.requested_counts
        if abs(here - was.position_counts) > reach:
            return {"finger": name, "how": f"leapt from {was.position_counts} to {here} counts"}
        if touched_at is not None and abs(here - touched_at) > CONTACT_COUNTS:
            return {"finger": name, "how": f"reports contact and moved from {touched_at} to {here}"}
        if h.state.fresh and _beside_target(now):
            return {"finger": name, "how": f"is 'at target' at {here} counts, asked for {asked}"}
    return None


def _beside_target(finger: FingerState) -> bool:
    asked = finger.requested_counts
    off = abs(finger.position_counts - asked) > TARGET_COUNTS
    return finger.detection is Detection.AT_TARGET and asked in SOFT_COUNTS and off


def silent(h: GripperHistory, s: MonitorSettings) -> Data:
    """The status does not speak of the last command. A hand that refuses has said so."""
    silent_s = (h.state.t_ns - h.fresh_ns) * 1e-9
    refuses = h.state.fault and not h.state.active
    long = silent_s > s.echo_s and h.unanswered >= LOOKS
    return {"seconds": round(silent_s, 3)} if long and not refuses else None


def stands(h: GripperHistory, s: MonitorSettings) -> Data:
    """A finger reports motion and keeps its count."""
    still_ns = [h.state.t_ns - since_ns for since_ns in h.moved_ns]
    if not any(still_ns):  # most often
        return None
    presses = [finger.current_ma >= PRESSING_MA for finger in h.state.fingers]
    most_s = [max(PRESSING_S, s.finger_start_s) if p else s.finger_start_s for p in presses]
    wrong = [ns >= limit_s * 1e9 for ns, limit_s in zip(still_ns, most_s, strict=True)]
    return _named(wrong)


def flickers(h: GripperHistory, s: MonitorSettings) -> Data:
    """As another client's commands make a hand report."""
    return _named([flips.too_many for flips in h.flips])


def _named(fingers: list[bool]) -> Data:
    return {"finger": ", ".join(compress(FINGER_NAMES, fingers))} if any(fingers) else None
