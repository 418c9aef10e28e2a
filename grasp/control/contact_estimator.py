"""ContactEstimator: contact and grip force from the fingertips. Stiffness of a contact."""

import math

import msgspec

from grasp.control.observation import Observation

LOST_NS = 50_000_000  # contact that is absent for so long counts as lost; assumed
GRIP_NS = 60e6  # time constant of the grip force: longer than the pads' oscillation


class Stiffness(msgspec.Struct, frozen=True):
    """Rise of the thumb's force per motor count of closing, N."""

    newtons_per_count: float

    def counts_within(self, rise_n: float) -> int:
        """Most motor counts of closing that raise the force by at most ``rise_n``; 0 or more."""
        return max(0, math.floor(rise_n / self.newtons_per_count))


class ContactEstimator:
    """Estimate from all samples so far, mostly from the thumb, which opposes both other fingers.

    ``grip_n``: force of the thumb, low-pass filtered. ``thumb_lost``: the thumb has had no contact
    for too long. ``lost``: no finger has had any: while lowering, the thumb alone may show no
    contact once the object touches the table, although the grip is unchanged. ``longest_gap_ns``:
    longest time without contact of the thumb while the object may have been in the air.
    ``overload_ns``: time since estimated force was last within the limit plus the estimate's
    margin.
    """

    def __init__(self, contact_n: float) -> None:
        self._contact_n = contact_n
        self.grip_n = 0.0
        self.thumb_lost = self.lost = False
        self.longest_gap_ns = self.overload_ns = 0
        self._t_ns = 0  # of the last sample
        self._thumb_contact_ns = 0  # of the last sample with contact of the thumb
        self._contact_ns = 0  # of the last sample with contact of any finger
        self._within_limit_ns = 0  # of the last sample that was not overloaded

    def update(self, obs: Observation, airborne: bool) -> None:
        """Take one sample; ``airborne``: the object may be in the air."""
        t_ns, responsive_n = obs.t_ns, obs.responsive_n
        weight = min(1.0, (t_ns - self._t_ns) / GRIP_NS)
        self.grip_n += weight * (grip_force_n(obs) - self.grip_n)
        self._t_ns = t_ns
        a_n, b_n, c_n = obs.estimated_n
        # a thumb whose fingertip shows nothing still bears what both others press in the air
        touches = a_n >= self._contact_n or (airborne and min(b_n, c_n) >= self._contact_n)
        if touches and sum(responsive_n) >= self._contact_n:
            self._thumb_contact_ns = t_ns
        elif airborne:
            self.longest_gap_ns = max(self.longest_gap_ns, t_ns - self._thumb_contact_ns)
        if max(responsive_n) >= self._contact_n:
            self._contact_ns = t_ns
        if not obs.overloaded:
            self._within_limit_ns = t_ns
        self.thumb_lost = t_ns - self._thumb_contact_ns >= LOST_NS
        self.lost = t_ns - self._contact_ns >= LOST_NS
        self.overload_ns = t_ns - self._within_limit_ns


def grip_force_n(obs: Observation) -> float:
    """Force of the thumb in one sample, as half the sum of all fingers, because a finger whose
    taxels are saturated shows no rise."""
    return sum(obs.estimated_n) / 2
