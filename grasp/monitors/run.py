"""RunMonitor: what ends a run beside implausible devices: old states, force, pace and time."""

from drivers.interfaces import MIN_SPEED_FRACTION
from grasp.contact_estimator import ContactEstimator
from grasp.controller_settings import ControllerSettings
from grasp.fault import ARM, FINGERTIPS, TRIAL, Fault, stale
from grasp.lift_progress import StateClock
from grasp.monitors.checks import failed
from grasp.observation import Observation
from grasp.states import AIRBORNE_STATES, END_STATES, LOWERING_STATES, OPEN_STATES, State

OVERLOAD_NS = 30_000_000  # measured force may be so long above the limit in motion; assumed
UNTIMED_STATES = END_STATES | {State.START, State.HOLD}
ARM_STATES = LOWERING_STATES | {State.HOME, State.SHAPE, State.LIFT, State.RETREAT}  # end with it
RISING_STATES = frozenset({State.BASELINE, State.LIFT})  # the arm is about to rise, or does


class RunMonitor:
    """Stateless: what it needs beyond the observation, clock and contact estimator keep."""

    def __init__(
        self, settings: ControllerSettings, clock: StateClock, contact: ContactEstimator
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._contact = contact

    def check(self, obs: Observation, state: State) -> tuple[Fault, ...]:
        """Why the run cannot go on: what the step found already, or the first check that fails."""
        if obs.faults:
            return obs.faults
        if obs.frame is not None and obs.frame.stale and state not in OPEN_STATES:
            return (stale(FINGERTIPS, "no fresh fingertip sample"),)
        fault = (
            obs.device_fault(self._settings.stale_after_s * 1e9)
            or self._overforce(obs, state)
            or self._slow_arm(obs, state)
            or self._timeout(obs, state)
        )
        return () if fault is None else (fault,)

    def _overforce(self, obs: Observation, state: State) -> Fault | None:
        moving = state in AIRBORNE_STATES and obs.arm.moving
        if moving and self._contact.overload_ns > OVERLOAD_NS:
            text = "measured force stays above the limit while the arm moves"
            return Fault("overforce", TRIAL, text)
        return None

    def _slow_arm(self, obs: Observation, state: State) -> Fault | None:
        fraction = obs.arm.speed_fraction
        said = f"the arm's speed slider is at {100.0 * fraction:.3g} %"
        if state in RISING_STATES and fraction < MIN_SPEED_FRACTION:
            text = f"{said}, and no lift goes on below {100.0 * MIN_SPEED_FRACTION:g} %"
        elif self._clock.arm_stands:
            text = f"{said}: it comes to no end"
        else:
            return None
        return Fault("arm_slow", ARM, text, "turn up the speed slider at the arm's pendant")

    def _timeout(self, obs: Observation, state: State) -> Fault | None:
        timeout_s = self._settings.phase_timeout_s
        if state in UNTIMED_STATES or not self._clock.over(timeout_s):
            return None
        if state is State.TARE and obs.hand_rests:
            return failed("fingertips_slow", seconds=timeout_s)
        text = f"phase {state} lasted longer than {timeout_s:g} s: {_awaited(obs, state)}"
        return Fault("phase_timeout", TRIAL, text)


def _awaited(obs: Observation, state: State) -> str:
    """What that state is not over without."""
    if obs.pending:
        return "a command has not reached its device yet"
    if not obs.gripper.at_rest:
        return "the fingers still move"
    arm = obs.arm.moving or state in ARM_STATES
    return "the arm has not arrived" if arm else "the grip is not what it has to be"
