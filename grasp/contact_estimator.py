"""ContactEstimator: contact and grip force from the fingertips; stiffness of a contact."""

import math

import msgspec

from grasp.observation import Observation

LOST_NS = 50_000_000  # contact that is absent for so long is lost; assumed
GRIP_NS = 60e6  # time constant of the grip force: longer than the pads' own oscillation


class Stiffness(msgspec.Struct, frozen=True):
    """Rise of the thumb's force a count that it closes further, N."""

    newtons_per_count: float

    def counts_within(self, rise_n: float) -> int:
        """Most whole counts of closing that raise the force by no more than this; none below 0."""
        return max(0, math.floor(rise_n / self.newtons_per_count))


class ContactEstimate(msgspec.Struct, frozen=True):
    """Estimate after all samples up to ``t_ns``; a time is that of the last such sample.

    ``grip_n``: force of the thumb, low-pass filtered. ``longest_gap_ns``: longest time without
    contact of the thumb while the object may have been in the air.
    """

    t_ns: int = 0
    thumb_contact_ns: int = 0
    contact_ns: int = 0  # of any finger
    within_limit_ns: int = 0  # measured force was within the limit and its margin
    grip_n: float = 0.0
    longest_gap_ns: int = 0


class ContactEstimator:
    """The latest estimate. The thumb counts most: it opposes both other fingers."""

    def __init__(self, contact_n: float) -> None:
        self._contact_n = contact_n
        self.estimate = ContactEstimate()

    def update(self, obs: Observation, airborne: bool) -> None:
        """Take one sample; ``airborne``: the object may be in the air."""
        e, t_ns, least_n = self.estimate, obs.t_ns, self._contact_n
        touches = obs.measured_n[0] >= least_n and sum(obs.felt_n) >= least_n
        gap_ns = t_ns - e.thumb_contact_ns if airborne and not touches else 0
        weight = min(1.0, (t_ns - e.t_ns) / GRIP_NS)
        self.estimate = ContactEstimate(
            t_ns,
            thumb_contact_ns=t_ns if touches else e.thumb_contact_ns,
            contact_ns=t_ns if max(obs.felt_n) >= least_n else e.contact_ns,
            within_limit_ns=e.within_limit_ns if obs.overloaded else t_ns,
            grip_n=e.grip_n + weight * (thumb_n(obs) - e.grip_n),
            longest_gap_ns=max(e.longest_gap_ns, gap_ns),
        )

    @property
    def thumb_lost(self) -> bool:
        """Whether the thumb has had no contact for too long."""
        return self.estimate.t_ns - self.estimate.thumb_contact_ns >= LOST_NS

    @property
    def lost(self) -> bool:
        """Whether no finger has had contact for too long. On the way down the thumb alone may show
        none once the object stands, though it is pressed as before."""
        return self.estimate.t_ns - self.estimate.contact_ns >= LOST_NS

    @property
    def overload_ns(self) -> int:
        """How long measured force has been above the limit and its margin."""
        return self.estimate.t_ns - self.estimate.within_limit_ns


def thumb_n(obs: Observation) -> float:
    """Force of the thumb in one sample, as half the sum of all fingers: a finger whose taxels are
    at a rail shows no rise."""
    return sum(obs.measured_n) / 2
