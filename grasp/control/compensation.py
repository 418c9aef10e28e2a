"""Compensation: begins a slip response when slip is registered, and follows it to its end."""

from drivers.interfaces import FINGER_NAMES
from grasp.control.commands import Command
from grasp.control.contact_estimator import ContactEstimator
from grasp.control.controller_settings import ControllerSettings
from grasp.control.observation import Observation
from grasp.control.slip_monitor import SlipMonitor
from grasp.control.slip_response.close import SlipResponse
from grasp.control.state_timer import StateTimer
from grasp.control.states import Trigger
from grasp.control.transition import Transition, lose, repeated_stop, stay


class Compensation:
    """The state `compensate`, and the transitions to it.

    ``update`` returns `steady` once slip is over and `lower` where the force cannot rise further;
    what the arm does then is up to the controller.
    """

    def __init__(
        self, settings: ControllerSettings, monitor: SlipMonitor, contact: ContactEstimator,
        timer: StateTimer, response: SlipResponse,
    ) -> None:  # fmt: skip
        self._settings = settings
        self._monitor = monitor
        self._contact = contact
        self._timer = timer
        self.response = response

    def begin(self, obs: Observation, rising: bool) -> Transition | None:
        """Respond to slip or lost contact, or add a due margin. ``rising``: the arm is lifting."""
        slip, lost, response = self._monitor.status, self._contact.thumb_lost, self.response
        # with `hold_by_clock` slip at the limit is ignored: no closing and no set-down could follow
        ignored = self._settings.hold_by_clock and obs.at_limit
        if lost and obs.at_limit:
            return lose("contact lost, and the thumb can close no further")
        if not self._settings.reactions:
            return None
        if lost or (slip.registered and not ignored):
            registered = f"slip registered at finger {FINGER_NAMES[slip.finger]}"
            cause = "contact lost" if lost else registered
            return Transition(Trigger.SLIP, cause, response.begin(obs, rising, lost))
        if margin := response.follow_up(obs, rising):
            cause = "the force that ended slip has carried the object: margin added"
            return Transition(Trigger.SLIP, cause, margin)
        return None

    def update(self, obs: Observation) -> Transition | None:
        """Follow the response for one sample."""
        slip, response = self._monitor.status, self.response
        alarm = slip.registered or slip.masked or not obs.hand_rests
        response.update(obs, alarm, self._timer.elapsed_ns)
        stop = repeated_stop(obs, self._timer, response.arm_stop)
        if not obs.hand_rests:
            self._monitor.closing(obs.t_ns)
        elif obs.second_stage_due:  # of the same response
            self._monitor.closing(obs.t_ns)
            return stay(*stop, response.closing(obs, self._contact.thumb_lost))
        elif self._contact.thumb_lost:
            return lose("the hand closed and met no object")
        elif slip.masked:
            pass  # the pads still vibrate from the closing
        elif response.exhausted and not self._settings.hold_by_clock:
            return Transition(Trigger.LOWER, "slip recurs and the force cannot rise further")
        elif slip.registered:
            return self._continuing_slip(obs, stop)
        elif response.over(obs):
            return Transition(Trigger.STEADY, "slip has stopped")
        return stay(*stop)

    def _continuing_slip(self, obs: Observation, stop: tuple[Command, ...]) -> Transition | None:
        """Handle slip that is still registered after the closing and its mask have ended."""
        s = self._settings
        waited_ns = obs.t_ns - max(self._timer.entered_ns, self._monitor.masked_until_ns)
        more = self.response.escalate(obs, waited_ns)
        if more is not None:
            return stay(*stop, *more)
        if s.hold_by_clock:
            cause = "slip continues; the hold ends after hold_s"
            return Transition(Trigger.STEADY, cause)
        if waited_ns >= s.limit_patience_s * 1e9:
            return Transition(Trigger.LOWER, "slip continues and the force cannot rise further")
        return stay(*stop)
