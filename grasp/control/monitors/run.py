"""RunMonitor: conditions that end a run: faults, old states, overforce, a slow arm, time-outs."""

from drivers.interfaces import MIN_SPEED_FRACTION, ArmState
from grasp.control.contact_estimator import ContactEstimator
from grasp.control.controller_settings import ControllerSettings
from grasp.control.fault import ARM, FINGERTIPS, TRIAL, Fault, stale
from grasp.control.monitors.checks import failed
from grasp.control.observation import Observation
from grasp.control.state_timer import StateTimer
from grasp.control.states import AIRBORNE_STATES, END_STATES, LOWERING_STATES, OPEN_STATES, State

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
        arm, settings = obs.arm, self._settings
        if fault := obs.device_fault(settings.stale_after_s * 1e9):
            return (fault,)
        if state in AIRBORNE_STATES and arm.moving and self._contact.overload_ns > OVERLOAD_NS:
            text = "estimated force stays above the limit while the arm moves"
            return (Fault("overforce", TRIAL, text),)
        if state in RISING_STATES and arm.speed_fraction < MIN_SPEED_FRACTION:
            return (_slow(arm, f"; a lift needs at least {100.0 * MIN_SPEED_FRACTION:g} %"),)
        if self._timer.arm_halted:
            return (_slow(arm, ", so its motion does not end"),)
        if state not in UNTIMED_STATES and self._timer.timed_out(settings.phase_timeout_s):
            return (self._timed_out(obs, state),)
        return ()

    def _timed_out(self, obs: Observation, state: State) -> Fault:
        timeout_s = self._settings.phase_timeout_s
        if state is State.TARE and obs.hand_rests:
            return failed("fingertips_slow", seconds=timeout_s)
        text = f"phase {state} lasted longer than {timeout_s:g} s: {_why_waiting(obs, state)}"
        return Fault("phase_timeout", TRIAL, text)


def _slow(arm: ArmState, why: str) -> Fault:
    text = f"the arm's speed slider is at {100.0 * arm.speed_fraction:.3g} %{why}"
    return Fault("arm_slow", ARM, text, "turn up the speed slider at the arm's pendant")


def _why_waiting(obs: Observation, state: State) -> str:
    """Condition that this state still waits for, in words."""
    if obs.pending:
        return "a command has not reached its device yet"
    if not obs.gripper.at_rest:
        return "the fingers still move"
    arm = obs.arm.moving or state in ARM_STATES
    return "the arm has not arrived" if arm else "the grip is not complete"
