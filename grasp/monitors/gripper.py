"""Plausibility of the gripper's status: impossible values, and motion that ignores commands."""

from drivers.interfaces import FINGER_NAMES, FINGERS, Detection, GripperState
from grasp.monitors.settings import Data, MonitorSettings, finger_names, too_often

OUTDATED_READS = 5  # status reads before `silent` fails: a command may be on its way for two
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

    def __init__(self) -> None:
        self.state: GripperState
        self.before: GripperState | None = None
        self.fresh_ns = 0  # time of the last status that includes the last command
        self.outdated_reads = 0  # status reads since
        self.moved_ns = [0] * FINGERS  # since when each finger reports motion without moving
        self.touched_at: list[int | None] = [None] * FINGERS  # where it first reported contact
        self.flips_ns: list[list[int]] = [[], [], []]  # times at which each report changed

    @property
    def flickers(self) -> list[bool]:
        """Which fingers alternate between reports, as under the commands of another client."""
        return [too_often(flips_ns, self.state.t_ns) for flips_ns in self.flips_ns]

    def update(self, state: GripperState) -> None:
        """Take the status of this step."""
        first = self.before is None
        self.before, self.state = (state if first else self.state), state
        if state.fresh or first:
            self.fresh_ns, self.outdated_reads = state.t_ns, 0
        else:
            self.outdated_reads += 1
        for i, (was, now) in enumerate(zip(self.before.fingers, state.fingers, strict=True)):
            moving = state.fresh and now.detection is Detection.MOVING
            if first or not moving or was.position_counts != now.position_counts:
                self.moved_ns[i] = state.t_ns
            if was.requested_counts != now.requested_counts:
                self.flips_ns[i].clear()
            elif state.fresh and self.before.fresh and was.detection is not now.detection:
                self.flips_ns[i].append(state.t_ns)
            if not state.fresh or now.detection not in CONTACT:
                self.touched_at[i] = None
            elif self.touched_at[i] is None:
                self.touched_at[i] = now.position_counts


def impossible(h: GripperHistory, s: MonitorSettings) -> Data:
    """Fails if a finger jumped, or moved although it reports contact."""
    assert h.before is not None  # noqa: S101  (updated)
    # a status dates from some moment between its request and its arrival
    elapsed_s = (h.state.t_ns + h.state.took_ns - h.before.t_ns) * 1e-9
    most = JUMP_COUNTS + FINGER_COUNTS_PS * elapsed_s
    fingers = zip(FINGER_NAMES, h.before.fingers, h.state.fingers, h.touched_at, strict=True)
    for name, was, now, touched_at in fingers:
        here = now.position_counts
        if abs(here - was.position_counts) > most:
            return {"finger": name, "how": f"jumped from {was.position_counts} to {here} counts"}
        if touched_at is not None and abs(here - touched_at) > CONTACT_COUNTS:
            return {"finger": name, "how": f"moved in contact from {touched_at} to {here} counts"}
    return None


def silent(h: GripperHistory, s: MonitorSettings) -> Data:
    """Fails if the status does not show the last command, except for a faulty, inactive hand."""
    silent_s = (h.state.t_ns - h.fresh_ns) * 1e-9
    refuses = h.state.fault and not h.state.active
    long = silent_s > s.echo_s and h.outdated_reads >= OUTDATED_READS
    return {"seconds": round(silent_s, 3)} if long and not refuses else None


def stands(h: GripperHistory, s: MonitorSettings) -> Data:
    """Fails if a finger reports motion but keeps its count."""
    wrong = []
    for finger, since_ns in zip(h.state.fingers, h.moved_ns, strict=True):
        presses = finger.current_ma >= PRESSING_MA
        most_s = max(PRESSING_S, s.finger_start_s) if presses else s.finger_start_s
        wrong.append(since_ns < h.state.t_ns and h.state.t_ns - since_ns >= most_s * 1e9)
    return finger_names(wrong)
