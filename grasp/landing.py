"""Landing: the way down, from where the arm turns to where the hand lets go.

How far an object slipped is not known, so neither is how high the arm is when it stands. Closed
fingers that slide down over an object that stands and widens are driven apart, and feel it.
"""

import math

import msgspec

from grasp.commands import Command, OpenFingers, StopArm
from grasp.controller_settings import ControllerSettings
from grasp.felt import Felt, grip_n
from grasp.lift_line import LiftLine
from grasp.observation import Observation
from grasp.phases import Phase, Trigger

LANDING_SHARE = 0.8  # of the time that a phase may last
SHORTEST_M = 2e-4  # of a step
CERTAIN = 3  # times the rise that tells is what a step aims at


class Way(msgspec.Struct, frozen=True):
    """Out of a phase: the trigger, why, and what is asked for with it."""

    trigger: Trigger
    cause: str
    commands: tuple[Command, ...] = ()


class Still:
    """The grip while the arm stands: its mean over the second half of a time, so that what moves it
    has settled and the pads' restlessness is averaged out."""

    def __init__(self, for_s: float) -> None:
        self._for_ns = for_s * 1e9
        self.restart()

    def restart(self) -> None:
        self._since_ns: int | None = None
        self._sum_n = 0.0
        self._samples = 0

    def take(self, obs: Observation) -> float | None:
        """One sample; the mean once the arm has stood for long enough."""
        if obs.pending or obs.arm.moving:
            self.restart()
            return None
        if self._since_ns is None:
            self._since_ns = obs.t_ns
        stood_ns = obs.t_ns - self._since_ns
        if stood_ns >= self._for_ns / 2:
            self._sum_n += grip_n(obs)
            self._samples += 1
        return self._sum_n / self._samples if stood_ns >= self._for_ns else None


class Landing:
    """Phases lower, land, touch and probe; lost where what the hand holds may stand and nothing
    tells where.

    What is remembered: how high the arm was when slip was last in progress, what the grip was when
    the arm last began to go down and the least that it was so, where it tightened last and how
    often, where the hand opened.
    """

    def __init__(self, settings: ControllerSettings, line: LiftLine, felt: Felt) -> None:
        self._settings = settings
        self._line = line
        self._felt = felt
        self._still = Still(settings.landing_still_s)
        self._slipped_m = 0.0
        self._grip_n = 0.0
        self._least_n = math.inf
        self._tight_m = 0.0
        self._touches = 0
        self._let_go_m = 0.0
        self._stopped_ns = 0  # when the arm was last told to

    @property
    def clear_m(self) -> float:
        """Height of the arm clear of what was set down."""
        return self._let_go_m + self._settings.retreat_m

    def slipping(self, obs: Observation) -> None:
        """On the way up: slip is in progress now."""
        self._slipped_m = self._line.height_m(obs)

    def begin(self, trigger: Trigger, cause: str) -> Way:
        """Down to where the lift began, unless the object may be elsewhere in the hand: it fell and
        was gripped again higher up, and a closed hand would be driven down along it."""
        if self._felt.gap_ns >= self._settings.contact_gap_s * 1e9:
            gap = f"nothing was felt for {self._felt.gap_ns * 1e-9:.2f} s on the way"
            return Way(Trigger.LOSE, f"{gap}: what the hand holds may stand on the table")
        return self._quickly(trigger, cause)

    def step(self, phase: Phase, obs: Observation) -> Way | None:
        """Out of that phase; None while it goes on."""
        if self._felt.nothing_felt(obs.t_ns):
            return Way(Trigger.LOSE, "contact lost on the way down")
        if phase in (Phase.LOWER, Phase.LAND):
            return self._go_down(phase, obs)
        level_n = self._still.take(obs)
        if level_n is None:
            return None
        self._still.restart()
        return self._touch(obs, level_n) if phase is Phase.TOUCH else self._probe(obs, level_n)

    def again(self, phase: Phase, obs: Observation) -> tuple[Command, ...]:
        """What was asked for in that phase and is not seen: a stop may be lost on its way."""
        due = obs.t_ns - self._stopped_ns >= self._settings.repeat_s * 1e9
        on_its_way = phase is Phase.TOUCH and obs.arm.moving and not obs.pending
        return self._stop(obs) if due and on_its_way else ()

    @property
    def _near_m(self) -> float:
        """Higher than this no object stands: it rose with the hand from when slip had ended, so it
        has slipped no more than the arm had risen by then, which is all of that where the arm
        stopped while the object still stood; with a margin for what nobody heard."""
        if self._slipped_m <= 0.0:
            return 0.0
        margin_m = self._settings.landing_margin_m
        return min(self._slipped_m + margin_m, self._settings.lift_height_m)

    def _take_grip(self) -> None:
        self._grip_n = self._felt.level_n
        self._least_n = min(self._least_n, self._grip_n)

    def _go_down(self, phase: Phase, obs: Observation) -> Way | None:
        """The grip tightens where closed fingers slide down over a flank that widens."""
        rise_n = self._felt.level_n - self._grip_n
        if phase is Phase.LOWER and self._line.stands_at(obs, self._near_m):
            return self._slowly(obs, Trigger.NEAR, "from here on the object may stand")
        if phase is Phase.LAND and self._line.stands_at(obs, 0.0):
            return self._let_go(obs, "arm where the lift began")
        if rise_n < self._settings.landing_rise_n:
            return None
        self._touches += 1
        self._tight_m = self._line.height_m(obs)
        self._still.restart()
        cause = f"the grip is {rise_n:.1f} N tighter on the way down"
        return Way(Trigger.TIGHTENED, cause, self._stop(obs))

    def _stop(self, obs: Observation) -> tuple[Command, ...]:
        self._stopped_ns = obs.t_ns
        return (StopArm(self._settings.stop_deceleration_mps2),)

    def _quickly(self, trigger: Trigger, cause: str) -> Way:
        self._take_grip()
        return Way(trigger, cause, (self._line.down(self._near_m, self._settings.lower_speed_mps),))

    def _slowly(self, obs: Observation, trigger: Trigger, cause: str) -> Way:
        self._take_grip()
        if self._line.stands_at(obs, 0.0):
            return Way(trigger, cause)
        in_time_mps = self._line.height_m(obs) / (LANDING_SHARE * self._settings.phase_timeout_s)
        speed_mps = max(self._settings.landing_speed_mps, in_time_mps)
        return Way(trigger, cause, (self._line.down(0.0, speed_mps),))

    def _touch(self, obs: Observation, level_n: float) -> Way:
        height_m = self._line.height_m(obs)
        step_m = self._step_m(self._tight_m - height_m, level_n - self._grip_n)
        self._grip_n = level_n
        step = self._line.down(height_m - step_m, self._settings.landing_speed_mps)
        return Way(Trigger.SETTLED, "the arm has stood for long enough", (step,))

    def _step_m(self, braking_m: float, rise_n: float) -> float:
        """As short as will tell, where the grip went on tightening while the arm braked."""
        s = self._settings
        if braking_m <= 0.0 or rise_n <= s.landing_rise_n:
            return s.landing_step_m
        telling_m = CERTAIN * s.landing_check_n * braking_m / (rise_n - s.landing_rise_n)
        return min(max(telling_m, SHORTEST_M), s.landing_step_m)

    def _probe(self, obs: Observation, level_n: float) -> Way:
        """A grip in the air takes no notice of a step down; where it does, the object stands: a
        flank tightens it, a textured face may loosen it, and it stays tight; but not where none can
        stand: codes that drift tighten a grip, too. One that has tightened much, though no step
        tells, may go no further."""
        s = self._settings
        rise_n = level_n - self._grip_n
        tight = level_n - self._least_n >= s.landing_rise_n
        high = self._line.height_m(obs) > self._near_m + s.at_height_m
        stands = rise_n >= s.landing_check_n or (tight and -rise_n >= s.landing_check_n)
        if stands and not high:
            return self._let_go(obs, f"a step down changed the grip by {rise_n:+.1f} N: it stands")
        tightest_n = (1 + s.landing_most_share) * self._least_n
        if self._touches >= s.landing_tries or level_n >= tightest_n:
            unsure = "the grip tightens, and it is not certain that the object stands"
            return Way(Trigger.LOSE, unsure)
        loose = "a step down did not tighten the grip"
        if high:
            return self._quickly(Trigger.HIGH, "no object can stand yet" if stands else loose)
        return self._slowly(obs, Trigger.LOOSE, loose)

    def _let_go(self, obs: Observation, cause: str) -> Way:
        self._let_go_m = self._line.height_m(obs)
        return Way(Trigger.LANDED, cause, (OpenFingers(self._settings.approach_speed_mps),))
