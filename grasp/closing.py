"""Closing: how the hand closes to the force cap, in one stage or in two.

Of two, the first goes by position alone, as fast as the hand can, to where the limit is kept even
on a contact that is stiffer and grasped harder than believed (``ForceGuard.reach``). It lasts about
as long as a command is on its way, so nothing that is fed back could steer it. The second begins at
rest and rises to the cap at the hand's slowest, so that little momentum carries it past.
"""

from drivers.interfaces import Counts3, Detection
from grasp.commands import CloseFast
from grasp.controller_settings import ControllerSettings
from grasp.observation import Observation

CLOSED_COUNTS: Counts3 = (255, 255, 255)
ALL_FINGERS = (True, True, True)
STAGE_NS = 500_000_000  # a first stage that is not seen to rest by then is not waited for


class Closing:
    """Which closing is due. ``since_ns``: since when a first stage has been asked for."""

    def __init__(self, settings: ControllerSettings, force_cap_n: float) -> None:
        self._settings = settings
        self._cap_n = force_cap_n
        self.since_ns: int | None = None

    def command(self, obs: Observation, lost: bool = False) -> CloseFast:
        """What to ask for now; the same again while a first stage is under way.

        ``lost``: nothing is felt, so nothing says where contact will be.
        """
        s, reach = self._settings, obs.reach_counts
        if s.closing == "constant" or lost or reach is None:
            return self._to_cap(s.closing_speed_mps)
        if not self._is_first(obs, reach[0]):
            self.since_ns = None
            return self.slowly()
        if self.since_ns is None:
            self.since_ns = obs.t_ns
        return CloseFast(self._cap_n, ALL_FINGERS, reach, s.closing_speed_mps, more=True)

    def slowly(self) -> CloseFast:
        """To the cap where nothing is in a hurry, or nobody can see what a first stage does."""
        s = self._settings
        return self._to_cap(s.closing_speed_mps if s.closing == "constant" else s.top_up_speed_mps)

    def _to_cap(self, speed_mps: float) -> CloseFast:
        return CloseFast(self._cap_n, ALL_FINGERS, CLOSED_COUNTS, speed_mps)

    def _is_first(self, obs: Observation, reach_counts: int) -> bool:
        """Of the thumb, which opposes both others."""
        thumb = obs.gripper.fingers[0]
        overdue = self.since_ns is not None and obs.t_ns - self.since_ns > STAGE_NS
        if overdue or thumb.detection is Detection.CONTACT_CLOSING:
            return False
        if not obs.hand_rests:
            return obs.first_stage
        return not obs.first_stage and thumb.requested_counts < reach_counts
