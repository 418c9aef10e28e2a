"""How far a lift has come: the arm's height on its vertical line, and time in the present state."""

from drivers.interfaces import Vector3
from grasp.commands import MoveArm
from grasp.controller_settings import ControllerSettings
from grasp.observation import Observation
from grasp.states import LOWERING_STATES, State

AT_HEIGHT_M = 0.001  # the arm counts as there within this; assumed
SLOWED_STATES = frozenset({State.HOME, State.LIFT, State.RETREAT}) | LOWERING_STATES
LEAST_PACE = 0.05  # a slower arm counts as this fast, so that every wait for it ends; assumed
STANDS_NS = 1_000_000_000  # an arm that is slower for so long counts as standing; assumed
REPEAT_NS = 100_000_000  # between two equal requests; assumed


class LiftLine:
    """The vertical line through the arm's ``home``; heights are over that, in m."""

    def __init__(self, settings: ControllerSettings, home: Vector3) -> None:
        self._settings = settings
        self.home = home

    def height_m(self, obs: Observation) -> float:
        return obs.arm.position_m[2] - self.home[2]

    def stands_at(self, obs: Observation, height_m: float) -> bool:
        """Whether the arm stands there, and no command is on its way."""
        away_m = abs(self.height_m(obs) - height_m)
        return not obs.pending and not obs.arm.moving and away_m < AT_HEIGHT_M

    def move(
        self, height_m: float, speed_mps: float, acceleration_mps2: float | None = None
    ) -> MoveArm:
        """The arm to that height; by default with the acceleration of the lift."""
        x, y, z = self.home
        ramp_mps2 = acceleration_mps2 or self._settings.lift_acceleration_mps2
        return MoveArm((x, y, z + height_m), speed_mps, ramp_mps2)

    def down(self, height_m: float, speed_mps: float) -> MoveArm:
        """To a height at which something may stand: the arm brakes no harder than a safe stop does,
        so that one that is stopped on the way ends no lower."""
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, s.stop_deceleration_mps2)
        return self.move(height_m, speed_mps, gently_mps2)


class StateClock:
    """All times that count from the beginning of the present state. ``update`` once a step,
    ``restart`` with every transition.

    An arm whose speed slider is turned down takes longer: time-outs of states that wait for it
    count its own time. It is waited for in the air too, since the object comes down no other way.

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
