"""StateTimer: all times that count from the beginning of the present state."""

from grasp.control.observation import Observation
from grasp.control.states import LOWERING_STATES, State

SLOWED_STATES = frozenset({State.HOME, State.LIFT, State.RETREAT}) | LOWERING_STATES
LEAST_PACE = 0.05  # a slower arm counts as this fast, so that every wait for it ends; assumed
HALTED_NS = 1_000_000_000  # an arm that is slower for so long counts as halted; assumed
REPEAT_NS = 100_000_000  # between two equal requests; assumed


class StateTimer:
    """Times of the present state. Call ``update`` once a step, ``restart`` at every transition.

    An arm whose speed slider is turned down takes longer. Time-outs of states that wait for the arm
    are therefore scaled by its speed, also in the air: the object comes down no other way.

    ``entered_ns``: when the present state began. ``elapsed_ns``: time since the step before.
    ``still_ns``: since when in this state the arm has been at rest with no command on its way; None
    while it moves. ``arm_delay_ns``: how much longer the run takes because of a slow arm.
    ``arm_halted``: the speed slider has stopped the arm for too long to wait for it.
    """

    def __init__(self) -> None:
        self.entered_ns = 0
        self.elapsed_ns = 0
        self.still_ns: int | None = None
        self.arm_delay_ns = 0.0
        self.arm_halted = False
        self._last_step_ns: int | None = None
        self._requested_ns = 0  # time of the last request of this state
        self._scaled_ns = 0.0  # duration of this state, scaled by the arm's speed
        self._halted_ns = 0.0  # for how long the speed slider has stopped the arm

    def update(self, obs: Observation, state: State) -> None:
        """Take one step in this state."""
        t_ns, arm = obs.t_ns, obs.arm
        last_step_ns = t_ns if self._last_step_ns is None else self._last_step_ns
        elapsed_ns = t_ns - last_step_ns
        self.elapsed_ns, self._last_step_ns = elapsed_ns, t_ns
        if obs.pending or arm.moving:
            self.still_ns = None
        elif self.still_ns is None:
            self.still_ns = t_ns
        slowed = state in SLOWED_STATES
        pace = min(1.0, max(LEAST_PACE, arm.speed_fraction)) if slowed else 1.0
        self._scaled_ns += pace * elapsed_ns
        self.arm_delay_ns += (1.0 - pace) * elapsed_ns
        halted = slowed and arm.speed_fraction < LEAST_PACE
        self._halted_ns = self._halted_ns + elapsed_ns if halted else 0.0
        self.arm_halted = self._halted_ns >= HALTED_NS

    def restart(self, t_ns: int) -> None:
        """Begin another state."""
        self.entered_ns = self._requested_ns = t_ns
        self._scaled_ns = 0.0
        self.still_ns = None

    def timed_out(self, timeout_s: float) -> bool:
        """Whether the state has lasted this long, scaled by the arm's speed."""
        return self._scaled_ns >= timeout_s * 1e9

    def repeat_due(self, t_ns: int) -> bool:
        """Whether it is time to repeat a request of this state; if so, it counts as repeated."""
        due = t_ns - self._requested_ns >= REPEAT_NS
        if due:
            self._requested_ns = t_ns
        return due
