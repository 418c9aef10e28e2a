"""Landing: the way down, from where the arm turns to where the hand lets go.

How far an object slipped is not known, so neither is how high the arm is when it stands. Closed
fingers that slide down over an object that stands and widens are driven apart: the thumb feels it.
"""

import msgspec

from grasp.commands import Command, OpenFingers, StopArm
from grasp.controller_settings import ControllerSettings
from grasp.felt import Felt
from grasp.lift_line import LiftLine
from grasp.observation import Observation
from grasp.phases import Phase, Trigger


class Way(msgspec.Struct, frozen=True):
    """Out of a phase: the trigger, why, and what is asked for with it."""

    trigger: Trigger
    cause: str
    commands: tuple[Command, ...] = ()


class Landing:
    """Phases lower, land, touch and probe; lost where what the hand holds may stand and nothing
    tells where.

    What is remembered: how high the arm was when slip was last in progress, what the thumb felt
    when the arm last began to go down, how often the grip has tightened since, where the hand
    opened.
    """

    def __init__(self, settings: ControllerSettings, line: LiftLine, felt: Felt) -> None:
        self._settings = settings
        self._line = line
        self._felt = felt
        self._slipped_m = 0.0
        self._grip_n = 0.0
        self._touches = 0
        self._let_go_m = 0.0

    @property
    def clear_m(self) -> float:
        """Height of the arm clear of what was set down."""
        return self._let_go_m + self._settings.retreat_m

    def slipping(self, seen: Observation) -> None:
        """On the way up: slip is in progress now."""
        self._slipped_m = self._line.height_m(seen)

    def begin(self, trigger: Trigger, cause: str) -> Way:
        """Down to where the lift began, unless the object may be elsewhere in the hand: it fell and
        was gripped again higher up, and a closed hand would be driven down along it."""
        if self._felt.gap_ns >= self._settings.contact_gap_s * 1e9:
            gap = f"nothing was felt for {self._felt.gap_ns * 1e-9:.2f} s on the way"
            return Way(Trigger.LOSE, f"{gap}: what the hand holds may stand on the table")
        return Way(trigger, cause, (self._line.move(self._near_m, self._settings.lower_speed_mps),))

    def step(self, phase: Phase, lasted_ns: int, seen: Observation) -> Way | None:
        """Out of that phase, which has lasted so long; None while it goes on."""
        if phase is Phase.LOWER:
            return self._lower(seen)
        if phase is Phase.LAND:
            return self._land(seen)
        stands = not seen.pending and not seen.arm.moving
        if not stands or lasted_ns < self._settings.relax_s * 1e9:  # what the thumb feels changes
            return None
        return self._touch(seen) if phase is Phase.TOUCH else self._probe(seen)

    @property
    def _near_m(self) -> float:
        """Higher than this no object stands: it rose with the hand from when slip had ended, so it
        has slipped less than the arm had risen by then."""
        return min(max(self._slipped_m, 0.0), self._settings.lift_height_m)

    def _lower(self, seen: Observation) -> Way | None:
        if self._felt.contact_lost(seen.t_ns):
            return Way(Trigger.LOSE, "contact lost on the way down")
        if self._line.stands_at(seen, self._near_m):
            return self._slowly(seen, Trigger.NEAR, "from here on the object may stand")
        return None

    def _slowly(self, seen: Observation, trigger: Trigger, cause: str) -> Way:
        self._grip_n = self._felt.level_n
        if self._line.stands_at(seen, 0.0):
            return Way(trigger, cause)
        in_time_mps = 2 * self._near_m / self._settings.phase_timeout_s
        speed_mps = max(self._settings.landing_speed_mps, in_time_mps)
        return Way(trigger, cause, (self._line.move(0.0, speed_mps),))

    def _land(self, seen: Observation) -> Way | None:
        """The grip tightens where closed fingers slide down over a flank that widens."""
        rise_n = seen.measured_n[0] - self._grip_n
        if self._felt.contact_lost(seen.t_ns):
            return Way(Trigger.LOSE, "contact lost on the way down")
        if self._line.stands_at(seen, 0.0):
            return self._let_go(seen, "arm where the lift began")
        if rise_n < self._settings.landing_rise_n:
            return None
        self._touches += 1
        cause = f"the thumb feels {rise_n:.1f} N more on the way down"
        return Way(Trigger.TIGHTENED, cause, (StopArm(self._settings.stop_deceleration_mps2),))

    def _touch(self, seen: Observation) -> Way:
        self._grip_n = self._felt.level_n
        lower_m = self._line.height_m(seen) - self._settings.landing_step_m
        step = self._line.move(lower_m, self._settings.landing_speed_mps)
        return Way(Trigger.SETTLED, "the arm stands, the pads have relaxed", (step,))

    def _probe(self, seen: Observation) -> Way:
        """A grip in the air takes no notice of a step down; where it does, the object stands."""
        rise_n = self._felt.level_n - self._grip_n
        if rise_n >= self._settings.landing_check_n:
            return self._let_go(
                seen, f"a step down tightened the grip by {rise_n:.1f} N: it stands"
            )
        if self._touches >= self._settings.landing_tries:
            unsure = "the grip tightens, and it is not certain that the object stands"
            return Way(Trigger.LOSE, unsure)
        return self._slowly(seen, Trigger.LOOSE, "a step down did not tighten the grip")

    def _let_go(self, seen: Observation, cause: str) -> Way:
        self._let_go_m = self._line.height_m(seen)
        return Way(Trigger.LANDED, cause, (OpenFingers(self._settings.approach_speed_mps),))
