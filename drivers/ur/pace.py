"""What the speed slider makes of a line: the same way at a share of its pace.

A line is planned at full pace, in its own time; the slider says how fast that runs. Where a share f
holds, speeds are f times and accelerations f squared times those of the plan, so that the way is
the same and takes 1/f as long.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence

import msgspec

from drivers.interfaces import Vector3

STANDING: Vector3 = (0.0, 0.0, 0.0)


class Segment(msgspec.Struct, frozen=True):
    """Constant acceleration from start_ns on, until the next segment begins."""

    start_ns: int
    origin_m: Vector3
    velocity_mps: Vector3
    acceleration_mps2: Vector3

    @property
    def at_rest(self) -> bool:
        return self.velocity_mps == STANDING and self.acceleration_mps2 == STANDING

    def position(self, t_ns: float) -> Vector3:
        t = (t_ns - self.start_ns) * 1e-9
        (x, y, z), (u, v, w), (a, b, c) = self.origin_m, self.velocity_mps, self.acceleration_mps2
        return x + (u + 0.5 * a * t) * t, y + (v + 0.5 * b * t) * t, z + (w + 0.5 * c * t) * t

    def velocity(self, t_ns: float) -> Vector3:
        return ahead(self.velocity_mps, self.acceleration_mps2, (t_ns - self.start_ns) * 1e-9)

    def upright(self, t_ns: int) -> tuple[float, float]:
        """Height, m, and speed upwards, m/s: the last of ``position`` and of ``velocity``."""
        t = (t_ns - self.start_ns) * 1e-9
        z, w, c = self.origin_m[2], self.velocity_mps[2], self.acceleration_mps2[2]
        return z + (w + 0.5 * c * t) * t, w + c * t


class Pace:
    """The slider: how it was turned, and what share of full pace that has come to at any time.

    An arm does not jump from one pace to another: the share changes evenly, a step a cycle.
    """

    def __init__(self, now_ns: int, period_ns: int, change_s: float) -> None:
        """``change_s``: from full pace to none."""
        self.slider = 1.0
        self._period_ns = period_ns
        self._step = period_ns * 1e-9 / change_s
        self._shares: list[tuple[int, float]] = [(now_ns, 1.0)]  # from when on

    @property
    def full(self) -> bool:
        """Nobody has ever touched the slider, or all is as if nobody had."""
        return len(self._shares) == 1 and self._shares[0][1] == 1.0

    def turn(self, slider: float, effect_ns: int) -> None:
        """From a cycle on."""
        share = self.at(effect_ns - 1)  # of the cycle before
        past = [s for s in self._shares if s[0] < effect_ns]
        changes = math.ceil(abs(slider - share) / self._step)
        step = math.copysign(self._step, slider - share)
        ramp = [
            (effect_ns + i * self._period_ns, share + (i + 1) * step) for i in range(changes - 1)
        ]
        there = (effect_ns + max(0, changes - 1) * self._period_ns, slider)
        self.slider, self._shares = slider, [*past, *ramp, there]

    def at(self, t_ns: int) -> float:
        """The share then."""
        return self._shares[self._index(t_ns)][1]

    def forget(self, before_ns: int) -> None:
        """Nobody asks for what was earlier."""
        self._shares = self._shares[self._index(before_ns) :]

    def own_ns(self, from_ns: int, until_ns: int) -> float:
        """How much own time passes."""
        own_ns, at_ns = 0.0, from_ns
        for i in range(self._index(from_ns), len(self._shares)):
            end_ns = self._shares[i + 1][0] if i + 1 < len(self._shares) else until_ns
            end_ns = min(end_ns, until_ns)
            if end_ns > at_ns:
                own_ns += self._shares[i][1] * (end_ns - at_ns)
                at_ns = end_ns
        return own_ns

    def slowed(self, line: Sequence[Segment], own_ns: float, now_ns: int) -> list[Segment]:
        """What is left of a line, whose own time it is, from now on. It ends with a rest, or where
        the slider does not let it go on."""
        chain: list[Segment] = []
        starts = [s.start_ns for s in line]
        part = max(0, bisect_right(starts, own_ns) - 1)
        for i in range(self._index(now_ns), len(self._shares)):
            share = self._shares[i][1]
            last = i + 1 == len(self._shares)
            until_ns = math.inf if last else self._shares[i + 1][0]
            while True:
                chain.append(_at_share(line[part], own_ns, now_ns, share))
                rests = part + 1 == len(line)
                left_ns = math.inf
                if not rests and share > 0.0:
                    left_ns = (starts[part + 1] - own_ns) / share
                if last and left_ns == math.inf:
                    return chain
                if now_ns + left_ns > until_ns:
                    break
                now_ns, own_ns, part = now_ns + round(left_ns), starts[part + 1], part + 1
            own_ns += share * (until_ns - now_ns)
            now_ns = self._shares[i + 1][0]
        return chain

    def _index(self, t_ns: int) -> int:
        return max(0, bisect_right(self._shares, t_ns, key=lambda s: s[0]) - 1)


def ahead(origin: Vector3, direction: Vector3, distance: float) -> Vector3:
    (x, y, z), (dx, dy, dz) = origin, direction
    return x + distance * dx, y + distance * dy, z + distance * dz


def times(direction: Vector3, size: float) -> Vector3:
    x, y, z = direction
    return x * size, y * size, z * size


def _at_share(part: Segment, own_ns: float, now_ns: int, share: float) -> Segment:
    return Segment(
        now_ns, part.position(own_ns), times(part.velocity(own_ns), share),
        times(part.acceleration_mps2, share * share),
    )  # fmt: skip
