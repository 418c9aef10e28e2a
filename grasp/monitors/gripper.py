"""Gripper status that does not follow a command, or that no hand can have."""

from drivers.interfaces import FINGER_NAMES, FINGERS, Detection, GripperState
from grasp.monitors.settings import Data, MonitorSettings, named, too_often

LOOKS = 5  # without an answer, however long each took: one may be under way for two
TOUCHING = (Detection.CONTACT_CLOSING, Detection.CONTACT_OPENING)  # it stands since
# A finger whose motor draws so much presses on something (manual p. 68-73: 110-160 mA moving
# freely). At its force it creeps, so it may keep its count for as long as this; assumed.
PRESSING_MA = 200
PRESSING_S = 2.0
LEAP_COUNTS = 8  # beside what a finger can have gone: a zero is off by up to 5, manual p. 74
CONTACT_COUNTS = 3  # a finger that reports contact stands; it may move by this; assumed
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
        self.flips_ns: list[list[int]] = [[], [], []]  # when each reported otherwise than before

    @property
    def flickers(self) -> list[bool]:
        """Which report one thing and then another, as another client's commands make them."""
        return [too_often(own, self.state.t_ns) for own in self.flips_ns]

    def update(self, state: GripperState) -> None:
        """The status of this step."""
        first = self.before is None
        self.before, self.state = (state if first else self.state), state
        if state.fresh or first:
            self.fresh_ns, self.unanswered = state.t_ns, 0
        else:
            self.unanswered += 1
        for i, (was, now) in enumerate(zip(self.before.fingers, state.fingers, strict=True)):
            moving = state.fresh and now.detection is Detection.MOVING
            if first or not moving or was.position_counts != now.position_counts:
                self.moved_ns[i] = state.t_ns
            if was.requested_counts != now.requested_counts:
                self.flips_ns[i].clear()
            elif state.fresh and self.before.fresh and was.detection is not now.detection:
                self.flips_ns[i].append(state.t_ns)
            if not state.fresh or now.detection not in TOUCHING:
                self.touched_at[i] = None
            elif self.touched_at[i] is None:
                self.touched_at[i] = now.position_counts


def impossible(h: GripperHistory, s: MonitorSettings) -> Data:
    """A leap, or motion in contact."""
    assert h.before is not None  # noqa: S101  (updated)
    # each tells of a moment between when it was asked for and when it was there
    passed_s = (h.state.t_ns + h.state.took_ns - h.before.t_ns) * 1e-9
    reach = LEAP_COUNTS + FINGER_COUNTS_PS * passed_s
    fingers = zip(FINGER_NAMES, h.before.fingers, h.state.fingers, h.touched_at, strict=True)
    for name, was, now, touched_at in fingers:
        here = now.position_counts
        if abs(here - was.position_counts) > reach:
            return {"finger": name, "how": f"leapt from {was.position_counts} to {here} counts"}
        if touched_at is not None and abs(here - touched_at) > CONTACT_COUNTS:
            return {"finger": name, "how": f"reports contact and moved from {touched_at} to {here}"}
    return None


def silent(h: GripperHistory, s: MonitorSettings) -> Data:
    """The status does not speak of the last command. A hand that refuses has said so."""
    silent_s = (h.state.t_ns - h.fresh_ns) * 1e-9
    refuses = h.state.fault and not h.state.active
    long = silent_s > s.echo_s and h.unanswered >= LOOKS
    return {"seconds": round(silent_s, 3)} if long and not refuses else None


def stands(h: GripperHistory, s: MonitorSettings) -> Data:
    """A finger reports motion and keeps its count."""
    wrong = []
    for finger, since_ns in zip(h.state.fingers, h.moved_ns, strict=True):
        presses = finger.current_ma >= PRESSING_MA
        most_s = max(PRESSING_S, s.finger_start_s) if presses else s.finger_start_s
        wrong.append(since_ns < h.state.t_ns and h.state.t_ns - since_ns >= most_s * 1e9)
    return named(wrong)
