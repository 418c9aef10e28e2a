"""StopAndClose: the arm stops, the hand closes, then the arm continues gently."""

from grasp.control.commands import Command, StopArm
from grasp.control.observation import Observation
from grasp.control.slip_response.close import SlipResponse

RESUME_MPS2 = 0.5  # greatest acceleration when the arm continues: adds 5 % to the load; assumed
RESUME_QUIET_NS = 50_000_000  # time without slip before the arm continues; assumed
PATIENCE_NS = 250_000_000  # longer than a detector needs to see the end of slip; assumed
NO_EFFECT_PAUSE_S = 1.5  # longest total pause for alarms that no closing ends; assumed


class StopAndClose(SlipResponse):
    """The hand closes as in ``SlipResponse``. During the lift the arm also stops, and continues
    gently when slip is over.

    An object that slips in the lift mostly still stands on the table while the fingers slide up
    along it. Slip ends some 30 ms after the arm stops; the hand needs 100 to 200 ms to press
    harder.
    """

    _stopped = False  # this response has stopped the arm
    _at_rest = False  # the arm was at rest in the last sample
    _no_effect = (
        False  # closing was already useless when the arm stopped: at the limit, or overloaded
    )
    _no_effect_s = 0.0  # total duration of pauses in which no closing could help
    _alarm_ns = 0  # time of the last sample with ``alarm`` (see ``update``)

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        return (*self._stop_arm(obs, rising), *super().begin(obs, rising, lost))

    def _stop_arm(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """Stop the arm if it is rising."""
        if not rising:
            return ()
        self._stopped, self._alarm_ns = True, obs.t_ns
        self._at_rest, self._no_effect = not obs.arm.moving, obs.closing_exhausted
        return (StopArm(self._settings.slip_stop_mps2),)

    @property
    def arm_stop(self) -> StopArm | None:
        return StopArm(self._settings.slip_stop_mps2) if self._stopped else None

    def update(self, obs: Observation, alarm: bool, elapsed_ns: int) -> None:
        if self._stopped:
            self.paused_s += elapsed_ns * 1e-9 * self._at_rest
            self._no_effect_s += elapsed_ns * 1e-9 * self._no_effect
            self._alarm_ns = obs.t_ns if alarm else self._alarm_ns
            self._at_rest = not obs.arm.moving

    @property
    def exhausted(self) -> bool:
        return self._no_effect_s >= NO_EFFECT_PAUSE_S

    def escalate(self, obs: Observation, waited_ns: int) -> tuple[Command, ...] | None:
        """The next stage; with the arm stopped only where slip outlasts the stop by far."""
        patience_ns = PATIENCE_NS if self._stopped else 0
        return None if waited_ns < patience_ns else super().escalate(obs, waited_ns)

    def over(self, obs: Observation) -> bool:
        """Whether the response stopped no arm, or the arm rests and slip has long been over."""
        quiet = obs.t_ns - self._alarm_ns >= RESUME_QUIET_NS
        return not self._stopped or (quiet and not obs.pending and not obs.arm.moving)

    def end(self) -> tuple[Command, ...]:
        """Continue the lift, gently enough for a grip that barely holds. The arm brakes no harder
        than the stop did, so that a further stop does not carry it past its end."""
        if not self._stopped:
            return ()
        self._stopped = False
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, RESUME_MPS2, s.slip_stop_mps2)
        return (self._line.move(s.lift_height_m, s.lift_speed_mps, gently_mps2),)
