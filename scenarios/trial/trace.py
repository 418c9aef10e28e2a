"""Values that a verdict needs, collected at every control step of a lift or tap."""

from drivers.interfaces import Counts3, Vector3
from grasp.control.fault import Fault
from grasp.control.monitors.fingertips import taxels_at_rail
from grasp.control.states import AIRBORNE_STATES, LOWERING_STATES, State
from grasp.run.loop import Issued, Tick
from scenarios.world.truth import Truth

HELD_UP_STATES = AIRBORNE_STATES - LOWERING_STATES  # before the set-down


class Trace:
    """Collects the values that a verdict needs; call ``add`` each control step."""

    def __init__(self) -> None:
        self.last: Tick | None = None
        self.hand: Issued | None = None  # the last command that the gripper accepted
        self.end: Truth | None = None  # before the object was set down
        self.registered_ns: int | None = None
        self.had_compensated = False  # when the object was lost
        self.commanded_force_n = 0.0
        self.peak_estimated_n: Vector3 = (0.0, 0.0, 0.0)  # of each finger, in any phase
        self.estimated_n = 0.0  # of the most loaded finger, before the object was set down
        self.held_n: Vector3 | None = None  # estimated, in the hold
        self.reported: tuple[Fault, ...] = ()  # first fault of each check that ends no run
        self.taxels_at_rail: Counts3 = (0, 0, 0)  # most saturated taxels at once, of each finger
        self._compensated = False
        # greatest height at which the hand lost the object while lowering, or after the run
        self.lost_at_m = 0.0
        self._was_touched = False
        self._was_at_m = 0.0

    def add(self, tick: Tick, truth: Truth | None) -> None:
        """Take one tick; truth is None on hardware."""
        obs, self.last = tick.observation, tick
        for fault in obs.reported:
            if not any(known.code == fault.code for known in self.reported):
                self.reported += (fault,)
        phase = tick.decision.state
        if tick.decision.slip.event and self.registered_ns is None:
            self.registered_ns = obs.t_ns
        for issued in tick.issued:
            if issued.applied is not None:
                self.hand = issued
                self.commanded_force_n = max(self.commanded_force_n, issued.applied.force_n)
        a_n, b_n, c_n = map(max, self.peak_estimated_n, obs.estimated_n)
        self.peak_estimated_n = a_n, b_n, c_n
        if obs.frame is not None:
            a, b, c = map(max, self.taxels_at_rail, taxels_at_rail(obs.frame))
            self.taxels_at_rail = a, b, c
        self._compensated = self._compensated or phase is State.COMPENSATE
        held_up = phase in HELD_UP_STATES
        if held_up:
            self.estimated_n = max(obs.estimated_n)
        if phase is State.HOLD:
            self.held_n = obs.estimated_n
        if truth is None:
            return
        touched = truth.touched
        if self._was_touched and not touched:
            self.lost_at_m = max(self.lost_at_m, self._was_at_m)
            if phase in AIRBORNE_STATES:
                self.had_compensated = self._compensated
        self._was_touched, self._was_at_m = touched, truth.height_m
        if held_up:
            self.end = truth
            self.lost_at_m = 0.0  # a loss before this instant: ``end`` tells whether it is held
