"""Touch: closes the first grasp until the fingertips feel the object, then by single counts.

B and C close slowly until one feels the object, or to where they brace it; then the thumb. A finger
holds as soon as it feels. Whatever the other side has not met yet, closes until it does. Then the
thumb closes by one count at a time, and the force is read at rest, until it is the first force.
"""

from enum import Enum, auto

from drivers.interfaces import Counts3, Detection, Vector3
from grasp.control.commands import GripperCommand, HoldFingers, MoveFingers
from grasp.control.controller_settings import ControllerSettings
from grasp.control.observation import Observation

# Rise of the estimated force that counts as contact: three times what free motion shows. The
# hand's contact bit would need a stalled motor, which presses with more than the limit.
CONTACT_RISE_N = 0.1
OPPOSITE_N = 0.5  # rise of B + C by which a thumb with a dead fingertip is felt; assumed
BRACE_COUNTS = 30  # where B and C wait for an object that they do not meet; assumed
CLOSED_COUNTS = 240  # software limit of the hand; manual p. 74
SILENT_COUNTS = 10  # counts for which one side may feel nothing; assumed
UNEVEN_N = 0.5  # by so much less than the thumb B + C must feel to close instead of it; assumed
REPEAT_NS = 300_000_000  # until a hold that stops no finger counts as lost; assumed
ONE_SIDE_SHARE = 0.6  # of the limit, that the table or a dead fingertip may oppose; assumed
OTHERS_COUNTS = 12  # longest closing of B and C; then their fingertips read too little; assumed
MOST_COUNTS = 60  # longest closing by single counts; assumed
NOTHING = "nothing is between the fingers, or the fingertips do not feel it"
NOTHING_REMEDY = "put the object between the fingers; else look at the fingertips: `grasp doctor`"
STIFF_REMEDY = "the object is too stiff for this hand's counts: raise guard.force_limit_n"


class Step(Enum):
    """Steps of a first grasp by touch; each motion ends at the first contact."""

    BRACE = auto()  # B and C close
    THUMB = auto()  # the thumb closes
    OTHERS = auto()  # B and C come to an object that only the thumb has met
    COUNTS = auto()  # the thumb closes by single counts


class Touch:
    """Call ``update`` once a sample from ``begin`` on; it returns the commands due. ``braced``: the
    thumb closes. ``complete``: the grip has the first force. ``failed``: why there is no grip, and
    the remedy."""

    def __init__(self, settings: ControllerSettings, limit_n: float) -> None:
        self._settings = settings
        self._limit_n = limit_n
        self._step = Step.BRACE
        self._zero_n: Vector3 = (0.0, 0.0, 0.0)  # before the present motion
        self._held_ns: int | None = None  # when the present motion was last stopped
        self._counts = 0  # by which the grip was closed
        self._others = 0  # by which B and C were closed
        self._silent = 0  # in a row, with a side that felt nothing
        self.complete = False
        self.failed: tuple[str, str] | None = None

    @property
    def braced(self) -> bool:
        return self._step is not Step.BRACE

    def begin(self, obs: Observation) -> GripperCommand:
        """The first command, with the hand open and rest counts taken."""
        a, _, _ = obs.gripper.positions  # an open hand stops short of its target
        return self._move(obs, Step.BRACE, (a, BRACE_COUNTS, BRACE_COUNTS))

    def update(self, obs: Observation) -> GripperCommand | None:
        if self._step is Step.COUNTS:
            return self._close_by_counts(obs)
        held_ns, fingers = self._held_ns, obs.gripper.fingers
        moves = obs.gripper.fresh and any(f.detection is Detection.MOVING for f in fingers)
        lost = held_ns is not None and moves and obs.t_ns - held_ns >= REPEAT_NS
        if lost or (held_ns is None and self._feels(obs)):
            self._held_ns = obs.t_ns
            return HoldFingers()
        if not obs.hand_rests or obs.reading is None:
            return None
        return self._next_motion(obs)

    def _next_motion(self, obs: Observation) -> GripperCommand | None:
        if self._step is Step.BRACE:
            return self._close_thumb(obs)
        if self._held_ns is None:
            self.failed = NOTHING, NOTHING_REMEDY
            return None
        _, b_n, c_n = obs.estimated_n
        if self._step is Step.THUMB and b_n + c_n < CONTACT_RISE_N:
            a, _, _ = obs.gripper.requested
            return self._move(obs, Step.OTHERS, (a, CLOSED_COUNTS, CLOSED_COUNTS))
        self._step, self._silent = Step.COUNTS, 0
        return self._close_by_counts(obs)

    def _close_thumb(self, obs: Observation) -> MoveFingers:
        _, b, c = obs.gripper.requested
        return self._move(obs, Step.THUMB, (CLOSED_COUNTS, b, c))

    def _move(self, obs: Observation, step: Step, targets: Counts3) -> MoveFingers:
        self._step, self._held_ns, self._zero_n = step, None, obs.estimated_n
        return MoveFingers(targets, self._settings.grip_speed_mps, self._limit_n)

    def _feels(self, obs: Observation) -> bool:
        """Whether a finger that moves feels the object, or presses it onto the other side."""
        a_n, b_n, c_n = (n - was for n, was in zip(obs.estimated_n, self._zero_n, strict=True))
        if self._step is Step.THUMB:
            return a_n >= CONTACT_RISE_N or b_n + c_n >= OPPOSITE_N
        return max(b_n, c_n) >= CONTACT_RISE_N or a_n >= OPPOSITE_N

    def _close_by_counts(self, obs: Observation) -> GripperCommand | None:
        """The finger that feels too little by one count, from a reading at rest; None until there
        is one, or at the end. Until the lift, the table may hold the object against one side."""
        reading, rise_n, s = obs.reading, obs.rise_n, self._settings
        if not obs.hand_rests or reading is None or rise_n is None:
            return None
        force_n, (thumb_n, others_n) = reading.force_n, reading.sides_n
        both = min(thumb_n, others_n) >= s.contact_n
        opens = self._counts == 0 and obs.gripper.requested[0] > 0
        if opens and force_n - rise_n >= s.first_force_n:
            return self._by(obs, -1, 0, 0)  # felt late
        no_room = force_n + rise_n > self._limit_n * (1.0 if both else ONE_SIDE_SHARE)
        latched = obs.gripper.thumb_latched  # by a hand that closes no further
        nearest_n = force_n + min(rise_n, s.first_force_n) / 2  # half a count less is near enough
        enough = nearest_n >= s.first_force_n and obs.rise_measured
        if both and (latched or enough or (no_room and force_n >= s.first_force_n)):
            self.complete = True
            return None
        self._silent = 0 if both else self._silent + 1
        self._counts += 1
        if self._silent > SILENT_COUNTS and force_n < s.contact_n:  # no contact after all
            return self._close_thumb(obs)
        self.failed = self._why_not_further(force_n, rise_n, thumb_n < others_n, no_room)
        if self.failed:
            return None
        _, b_n, c_n = obs.estimated_n
        even = others_n >= thumb_n - UNEVEN_N or self._others >= OTHERS_COUNTS
        if even or (both and nearest_n >= s.first_force_n):
            return self._by(obs, 1, 0, 0)
        self._others += 1
        return self._by(obs, 0, 1, 0) if b_n <= c_n else self._by(obs, 0, 0, 1)

    def _why_not_further(
        self, force_n: float, rise_n: float, thumb_silent: bool, no_room: bool
    ) -> tuple[str, str] | None:
        if self._silent > (0 if no_room else SILENT_COUNTS):
            silent = "finger A feels" if thumb_silent else "fingers B and C feel"
            return f"{silent} nothing, the other side {force_n:.1f} N", NOTHING_REMEDY
        if no_room:
            text = f"one more count could exceed {self._limit_n:g} N: it bears {force_n:.1f} N, and"
            return f"{text} a count is {rise_n:.1f} N", STIFF_REMEDY
        if self._counts >= MOST_COUNTS:
            return f"{MOST_COUNTS} counts did not reach the first force", NOTHING_REMEDY
        return None

    def _by(self, obs: Observation, *counts: int) -> MoveFingers:
        """Move fingers A, B and C by so many counts."""
        a, b, c = (at + n for at, n in zip(obs.gripper.requested, counts, strict=True))
        return MoveFingers((a, b, c), self._settings.grip_speed_mps, self._limit_n)
