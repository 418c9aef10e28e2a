"""StateClock: when the present state began, and all times that count from there.

An arm whose speed slider is turned down takes longer, and is as far in its own time as it would be
at full pace: where it is waited for, time-outs count that. It is waited for in the air too, since
what is in the hand can come down no other way.
"""

from grasp.observation import Observation
from grasp.states import LOWERING_STATES, State

SLOWED_STATES = frozenset({State.HOME, State.LIFT, State.RETREAT}) | LOWERING_STATES
# No arm is waited for without end: slower than this it counts as going at this, and once it has
# been so for a while as one that stands.
LEAST_PACE = 0.05
STANDS_NS = 1_000_000_000
REPEAT_NS = 100_000_000  # between two equal requests; assumed


class StateClock:
    """``update`` once a step, ``restart`` with every transition. Only here are times kept that
    count from one.

    ``entered_ns``: when the present state began. ``passed_ns``: since the step before.
    ``still_ns``: since when in this state the arm has stood, with no command on its way; None while
    it does not. ``excused_ns``: by how much a slow arm has prolonged the run.
    """

    def __init__(self) -> None:
        self.entered_ns = 0
        self.passed_ns = 0
        self.still_ns: int | None = None
        self.excused_ns = 0.0
        self._before_ns: int | None = None
        self._asked_ns = 0  # when what the state waits for was last asked for
        self._lasted_ns = 0.0  # at the pace of the arm
        self._slow_ns = 0.0  # for so long the slider has let the arm stand

    def update(self, obs: Observation, state: State) -> None:
        """One step in that state."""
        before_ns = obs.t_ns if self._before_ns is None else self._before_ns
        self.passed_ns, self._before_ns = obs.t_ns - before_ns, obs.t_ns
        if obs.pending or obs.arm.moving:
            self.still_ns = None
        elif self.still_ns is None:
            self.still_ns = obs.t_ns
        slowed = state in SLOWED_STATES
        fraction = obs.arm.speed_fraction
        pace = min(1.0, max(LEAST_PACE, fraction)) if slowed else 1.0
        self._lasted_ns += pace * self.passed_ns
        self.excused_ns += (1.0 - pace) * self.passed_ns
        stands = slowed and fraction < LEAST_PACE
        self._slow_ns = self._slow_ns + self.passed_ns if stands else 0.0

    @property
    def arm_stands(self) -> bool:
        """Whether the slider has let the arm stand for so long that it is not waited for."""
        return self._slow_ns >= STANDS_NS

    def restart(self, t_ns: int) -> None:
        """Another state begins."""
        self.entered_ns = self._asked_ns = t_ns
        self._lasted_ns = 0.0
        self.still_ns = None

    def over(self, timeout_s: float) -> bool:
        """Whether the state has lasted this long, at the pace of the arm."""
        return self._lasted_ns >= timeout_s * 1e9

    def ask_again(self, t_ns: int) -> bool:
        """Whether it is time to repeat a request of this state; counts as repeated if so."""
        due = t_ns - self._asked_ns >= REPEAT_NS
        if due:
            self._asked_ns = t_ns
        return due
