"""StopAndClose: the arm stops, the hand closes, then the arm goes on gently."""

from grasp.commands import Command, StopArm
from grasp.observation import Observation
from grasp.slip_response.close import SlipResponse

RESUME_MPS2 = 0.5  # at most, when the arm goes on: a twentieth of gravity
RESUME_QUIET_NS = 50_000_000  # slip is over for so long when it does; assumed
USELESS_PAUSE_S = 1.5  # in all of a lift, for alarms that no closing ends; assumed


class StopAndClose(SlipResponse):
    """In the lift the arm also stops, and goes on gently when slip is over.

    An object that slips there mostly still stands on the table, and the fingers slide up along it:
    slip ends some 30 ms after the arm stops, while the hand needs 100 to 200 ms to press harder.
    """

    _stopped = False  # the arm, for the present response
    _stands = False  # the arm did so in the last sample
    _useless = False  # no closing could have an effect when the arm stopped
    _useless_s = 0.0
    _alarm_ns = 0  # when slip was last not known to be over

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        return (*self._stop_arm(obs, rising), *super().begin(obs, rising, lost))

    def _stop_arm(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """Begin a pause, where the arm is on its way."""
        if not rising:
            return ()
        self._stopped, self._alarm_ns = True, obs.t_ns
        self._stands, self._useless = not obs.arm.moving, obs.closed_out
        return (StopArm(self._settings.slip_stop_mps2),)

    @property
    def arm_stop(self) -> StopArm | None:
        return StopArm(self._settings.slip_stop_mps2) if self._stopped else None

    def update(self, obs: Observation, alarm: bool, passed_ns: int) -> None:
        if self._stopped:
            self.paused_s += passed_ns * 1e-9 * self._stands
            self._useless_s += passed_ns * 1e-9 * self._useless
            self._alarm_ns = obs.t_ns if alarm else self._alarm_ns
            self._stands = not obs.arm.moving

    @property
    def exhausted(self) -> bool:
        return self._useless_s >= USELESS_PAUSE_S

    def over(self, obs: Observation) -> bool:
        """Whether the arm stands and slip has been over for long enough."""
        quiet = obs.t_ns - self._alarm_ns >= RESUME_QUIET_NS
        return not self._stopped or (quiet and not obs.pending and not obs.arm.moving)

    def end(self) -> tuple[Command, ...]:
        """The arm goes on so gently that a grip which only just holds goes on holding. It brakes no
        harder than the stop did, so that a stop on the way carries it past no end."""
        if not self._stopped:
            return ()
        self._stopped = False
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, RESUME_MPS2, s.slip_stop_mps2)
        return (self._line.move(s.lift_height_m, s.lift_speed_mps, gently_mps2),)
