"""GripMeasure: force and stiffness of a grip, measured with the fingertips while the hand rests.

The thumb bears B + C, so the grip has two sides. On the table they may differ by its friction on
the object. The largest rise a motor count is the stiffness; the smaller side tells whether the
object is held at all.
"""

import math

import msgspec

from drivers.interfaces import Counts3, Vector3

READ_NS = 50_000_000  # rest before a reading: fingertips are 20 to 80 ms late
LEAST_RISE_N = 0.08  # of a contact: of 100 N/m, the least that settings allow
IN_GRIP_N = 0.5  # least force of the smaller side for a rise to count as stiffness; assumed
# A contact stiffens as it is pressed, and a rise is measured with an error: the first stage of a
# closing uses this share of the room that the stiffness predicts. Then the force is read again. If
# slip goes on, the object falls, so the next stage uses all room, accepted overshoot included.
STAGE_SHARE = 0.7
MOST_COUNTS = 10  # of one stage: a fingertip that fails shows no rise, like a soft object; assumed
SPARE = 1.3  # the first stage is at least one count where so many would fit
# One finger against an object that the table holds is 1.5 times as stiff as against two fingers
FREE_SHARE = 2 / 3
LEAST_SHARE = 0.5  # of the rise before, that the first one in the air has at least; assumed
ERROR_N = 0.5  # of a rise between two readings; assumed
# Fingertips saturate: the force counts as at least this share of what the first reading predicts
LINE_SHARE = 0.9


class Reading(msgspec.Struct, frozen=True):
    """Estimated force at rest."""

    positions: Counts3
    sides_n: tuple[float, float]  # of the thumb, and of B and C together
    in_air: bool  # only the fingers hold the object, so that both sides bear the same
    least_n: float = 0.0  # that the first reading and the counts since predict

    @property
    def force_n(self) -> float:
        """Force of the grip. The errors of both sides are partly opposite, so their mean counts;
        until the lift the larger one, because the table may hold the object, and where one side
        reads less than half of the other, because its fingertips may be at fault."""
        less_n, more_n = sorted(self.sides_n)
        both = self.in_air and less_n >= more_n / 2
        return max((less_n + more_n) / 2 if both else more_n, self.least_n)


class GripMeasure:
    """Call ``update`` once a sample. ``rise_n``: force per count, the largest seen in the grip;
    until there is one, the guess that was given."""

    def __init__(
        self, guess_n: float, limit_n: float, overshoot_n: float, alone: bool = False
    ) -> None:
        """``alone``: nothing else bounds the force."""
        self._limit_n, self._overshoot_n, self._alone = limit_n, overshoot_n, alone
        self._guess_n = self.rise_n = guess_n
        self.measured = False  # ``rise_n`` is no guess any more
        self._replaces = False  # the next rise is the first in the air, where no table holds
        self._since_ns: int | None = None  # since when the hand has rested here
        self._positions: Counts3 = (0, 0, 0)
        self.now: Reading | None = None  # at these positions; None while the hand moves
        self._before: Reading | None = None  # at the positions before
        self.first: Reading | None = None  # when the first grasp was complete
        self._start: Reading | None = None  # the earliest in the grip, until the first grasp
        self.end_counts: int | None = None  # of the thumb, for the next closing

    def update(
        self, t_ns: int, rests: bool, positions: Counts3, estimated_n: Vector3, responsive: bool,
        risen: bool = True,
    ) -> None:  # fmt: skip
        """``responsive``: no taxel is saturated or stuck, so that the fingertips show all rises.
        ``risen``: the arm is so high that the object has left the table."""
        if not rests or positions != self._positions or self._since_ns is None:
            self._since_ns = t_ns if rests else None
            self._positions = positions
            self._before, self.now = self.now or self._before, None
        if self._since_ns is None or t_ns - self._since_ns < READ_NS:
            return
        thumb_n, b_n, c_n = estimated_n
        sides_n = thumb_n, b_n + c_n
        in_air = self.first is not None and responsive and risen
        in_grip = min(sides_n) >= IN_GRIP_N
        if self.now is None:
            read = Reading(positions, sides_n, in_air)
            self._take_rise(read, responsive)
            self._start = (self._start or read) if self._alone and in_grip else None
        least_n, start = 0.0, self.first or self._start
        if start is not None and self.measured:
            counts = positions[0] - start.positions[0]
            least_n = start.force_n + LINE_SHARE * self.rise_n * counts
        self.now = Reading(positions, sides_n, in_air, least_n)
        if self.first is not None:
            self._set_limit(self.now)

    def _take_rise(self, now: Reading, responsive: bool) -> None:
        """Take the rise since the reading before, by the thumb alone: B and C press an object that
        the table holds more stiffly. The count in which contact begins shows only part of a rise,
        so both readings must be in the grip."""
        before = self._before
        if before is None or min(before.sides_n) < IN_GRIP_N:
            return
        (a, *others), (was, *others_were) = now.positions, before.positions
        if a <= was or others != others_were:
            return
        sides = zip(now.sides_n, before.sides_n, strict=True)
        thumb_n, others_n = ((n - was_n) / (a - was) for n, was_n in sides)
        rise_n = (thumb_n + others_n) / 2
        if not now.in_air:
            rise_n = max(rise_n, FREE_SHARE * max(thumb_n, others_n))
        if not responsive:  # at least so much
            rise_n = max(rise_n, self._guess_n)
        if rise_n < LEAST_RISE_N:  # the thumb did not move
            return
        replaces = self._replaces and now.in_air
        if replaces:
            by_share = self.measured or self._alone
            rise_n = max(rise_n, LEAST_SHARE * self.rise_n if by_share else ERROR_N / (a - was))
        elif self.measured:
            rise_n = max(self.rise_n, rise_n)
        self.rise_n, self.measured = rise_n, True
        self._replaces = self._replaces and not replaces

    def begin(self) -> None:
        """The first grasp is complete: from now on the thumb's closing has a limit."""
        self._replaces = True
        if self.now is not None:
            self.first = self.now
            self._set_limit(self.now)

    def _set_limit(self, now: Reading) -> None:
        fit = (self._limit_n - now.force_n) / self.rise_n
        stage = max(0, math.floor(STAGE_SHARE * fit), int(fit >= SPARE))
        if self._alone and not self.measured:
            stage = min(stage, 1)
        elif self.first is not None and now.positions[0] > self.first.positions[0]:
            stage = max(0, math.floor(fit + self._overshoot_n / self.rise_n))
        self.end_counts = now.positions[0] + min(stage, MOST_COUNTS)
