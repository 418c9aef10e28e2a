"""PhaseClock: how long the present phase has lasted, at the pace of what it waits for.

An arm whose speed slider is turned down takes longer, and is as far in its own time as it would be
at full pace: where it is waited for, time-outs count that. It is waited for in the air too, since
what is in the hand can come down no other way.
"""

from drivers.interfaces import LEAST_SPEED_FRACTION
from grasp.observation import Observation
from grasp.phases import LOWERING_PHASES, Phase

SLOWED_PHASES = frozenset({Phase.HOME, Phase.LIFT, Phase.RETREAT}) | LOWERING_PHASES
RISING_PHASES = frozenset({Phase.LISTEN, Phase.LIFT})  # about to, or doing so
# No arm is waited for without end: slower than this it counts as going at this, and once it has
# been so for a while as one that stands.
LEAST_PACE = 0.05
STANDS_NS = 1_000_000_000


class PhaseClock:
    """``take`` once a step, ``restart`` with every phase."""

    def __init__(self) -> None:
        self._before_ns: int | None = None
        self._slow_ns = 0.0  # for so long the slider has let the arm stand
        self._lasted_ns = 0.0
        self.excused_ns = 0.0  # of the run: what the arm was slow by

    def take(self, obs: Observation, phase: Phase) -> None:
        """One step in that phase."""
        before_ns = obs.t_ns if self._before_ns is None else self._before_ns
        passed_ns, self._before_ns = obs.t_ns - before_ns, obs.t_ns
        slowed = phase in SLOWED_PHASES
        fraction = obs.arm.speed_fraction
        pace = min(1.0, max(LEAST_PACE, fraction)) if slowed else 1.0
        self._lasted_ns += pace * passed_ns
        self.excused_ns += (1.0 - pace) * passed_ns
        self._slow_ns = self._slow_ns + passed_ns if slowed and fraction < LEAST_PACE else 0.0

    def restart(self) -> None:
        """Another phase begins."""
        self._lasted_ns = 0.0

    def over(self, timeout_s: float) -> bool:
        """Whether the phase has lasted this long."""
        return self._lasted_ns >= timeout_s * 1e9

    def trouble(self, obs: Observation, phase: Phase) -> str:
        """What the slider makes impossible; empty if nothing."""
        percent = 100.0 * obs.arm.speed_fraction
        said = f"the arm's speed slider is at {percent:.3g} %"
        if phase in RISING_PHASES and obs.arm.speed_fraction < LEAST_SPEED_FRACTION:
            return f"{said}, and no lift goes on below {100.0 * LEAST_SPEED_FRACTION:g} %"
        return f"{said}: it comes to no end" if self._slow_ns >= STANDS_NS else ""
