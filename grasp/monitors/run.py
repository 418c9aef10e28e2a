"""RunMonitor: conditions that end a run: faults, old states, overforce, a slow arm, time-outs."""

from drivers.interfaces import MIN_SPEED_FRACTION
from grasp.contact_estimator import ContactEstimator
from grasp.controller_settings import ControllerSettings
from grasp.fault import ARM, FINGERTIPS, TRIAL, Fault, stale
from grasp.monitors.checks import failed
from grasp.observation import Observation
from grasp.state_timer import StateTimer
from grasp.states import AIRBORNE_STATES, END_STATES, LOWERING_STATES, OPEN_STATES, State

OVERLOAD_NS = 30_000_000  # estimated force may be so long above the limit in motion; assumed
UNTIMED_STATES = END_STATES | {State.START, State.HOLD}
ARM_STATES = LOWERING_STATES | {State.HOME, State.SHAPE, State.LIFT, State.RETREAT}  # wait for it
RISING_STATES = frozenset({State.BASELINE, State.LIFT})  # the arm is about to rise, or rises


class RunMonitor:
    """Checks whether a run can continue. It keeps no state: timer and contact estimator do."""

    def __init__(
        self, settings: ControllerSettings, timer: StateTimer, contact: ContactEstimator
    ) -> None:
        self._settings = settings
        self._timer = timer
        self._contact = contact

    def check(self, obs: Observation, state: State) -> tuple[Fault, ...]:
        """Why the run cannot continue: faults of the observation, or the first failed check."""
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
            text = "estimated force stays above the limit while the arm moves"
            return Fault("overforce", TRIAL, text)
        return None

    def _slow_arm(self, obs: Observation, state: State) -> Fault | None:
        fraction = obs.arm.speed_fraction
        slider = f"the arm's speed slider is at {100.0 * fraction:.3g} %"
        if state in RISING_STATES and fraction < MIN_SPEED_FRACTION:
            text = f"{slider}; a lift needs at least {100.0 * MIN_SPEED_FRACTION:g} %"
        elif self._timer.arm_halted:
            text = f"{slider}, so its motion does not end"
        else:
            return None
        return Fault("arm_slow", ARM, text, "turn up the speed slider at the arm's pendant")

    def _timeout(self, obs: Observation, state: State) -> Fault | None:
        timeout_s = self._settings.phase_timeout_s
        if state in UNTIMED_STATES or not self._timer.timed_out(timeout_s):
            return None
        if state is State.TARE and obs.hand_rests:
            return failed("fingertips_slow", seconds=timeout_s)
        text = f"phase {state} lasted longer than {timeout_s:g} s: {_why_waiting(obs, state)}"
        return Fault("phase_timeout", TRIAL, text)


def _why_waiting(obs: Observation, state: State) -> str:
    """Condition that this state still waits for, in words."""
    if obs.pending:
        return "a command has not reached its device yet"
    if not obs.gripper.at_rest:
        return "the fingers still move"
    arm = obs.arm.moving or state in ARM_STATES
    return "the arm has not arrived" if arm else "the grip is not complete"
