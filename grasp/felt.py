"""Felt: what has been felt so far, above all by the thumb, which opposes both other fingers."""

from grasp.controller_settings import ControllerSettings
from grasp.observation import Observation

LEVEL_NS = 60e6  # time constant of a force's level: longer than the pads' restlessness swings


class Felt:
    """Facts of the world, of every sample: when there was contact last, when force was within the
    limit last, how steady force is.

    ``level_n``: the grip, averaged over 60 ms.
    ``gap_ns``: the longest that nothing was felt while the object may have been in the air.
    """

    def __init__(self, settings: ControllerSettings) -> None:
        self._contact_n = settings.contact_n
        self._lost_ns = settings.contact_lost_s * 1e9
        self._seen_ns = 0
        self._touched_ns = 0
        self._felt_ns = 0
        self._within_ns = 0
        self.level_n = 0.0
        self.gap_ns = 0

    def take(self, obs: Observation, airborne: bool) -> None:
        """One sample; ``airborne``: the object may be in the air."""
        force_n = obs.measured_n[0]
        if force_n >= self._contact_n and sum(obs.felt_n) >= self._contact_n:
            self._touched_ns = obs.t_ns
        elif airborne:
            self.gap_ns = max(self.gap_ns, obs.t_ns - self._touched_ns)
        if max(obs.felt_n) >= self._contact_n:
            self._felt_ns = obs.t_ns
        weight = min(1.0, (obs.t_ns - self._seen_ns) / LEVEL_NS)
        self.level_n += weight * (grip_n(obs) - self.level_n)
        self._seen_ns = obs.t_ns
        if not obs.overloaded:
            self._within_ns = obs.t_ns

    def contact_lost(self, now_ns: int) -> bool:
        """Whether the thumb has touched nothing for too long."""
        return now_ns - self._touched_ns >= self._lost_ns

    def nothing_felt(self, now_ns: int) -> bool:
        """Whether no finger has felt anything for too long: on the way down a thumb that bears the
        object by a taxel or two may feel nothing once it stands, and be pressed as before."""
        return now_ns - self._felt_ns >= self._lost_ns

    def overload_ns(self, now_ns: int) -> int:
        """How long measured force has been above the limit and its margin."""
        return now_ns - self._within_ns


def grip_n(obs: Observation) -> float:
    """What the thumb bears, by all fingers: those whose taxels are at a rail feel no rise."""
    return sum(obs.measured_n) / 2
