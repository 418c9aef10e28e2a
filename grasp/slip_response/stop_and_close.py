"""StopAndClose: the arm stops for slip in the lift, the hand closes, then the arm goes on gently.

An object that slips there mostly still stands on the table, and the fingers slide up along it: when
the arm stops, slip ends, some 30 ms later, while the hand needs 100 to 200 ms to press harder.
"""

import msgspec

from grasp.commands import Command, StopArm
from grasp.observation import Observation
from grasp.slip_response.close import Close

RESUME_MPS2 = 0.5  # at most, when the arm goes on: a twentieth of gravity
RESUME_QUIET_NS = 50_000_000  # slip is over for so long when it does; assumed
USELESS_PAUSE_S = 1.5  # in all of a lift, for alarms that no closing ends; assumed


class Pause(msgspec.Struct, frozen=True):
    """A stop of the arm as of one sample. ``alarm_ns``: when slip was last not known to be over;
    ``useless``: no closing could do anything when it began."""

    alarm_ns: int
    stands: bool
    useless: bool


class StopAndClose(Close):
    """At the top of the lift, where the arm stands, as ``Close``."""

    _pause: Pause | None = None
    _useless_s = 0.0

    def begin(self, obs: Observation, rising: bool, lost: bool) -> tuple[Command, ...]:
        return (*self.stop_arm(obs, rising), *super().begin(obs, rising, lost))

    def stop_arm(self, obs: Observation, rising: bool) -> tuple[Command, ...]:
        """Begin a pause, where the arm is on its way."""
        if not rising:
            return ()
        self._pause = Pause(obs.t_ns, not obs.arm.moving, obs.closed_out)
        return (StopArm(self._settings.answer_stop_mps2),)

    @property
    def arm_stop(self) -> StopArm | None:
        return StopArm(self._settings.answer_stop_mps2) if self._pause else None

    def update(self, obs: Observation, alarm: bool, passed_ns: int) -> None:
        if self._pause is None:
            return
        self.paused_s += passed_ns * 1e-9 * self._pause.stands
        self._useless_s += passed_ns * 1e-9 * self._pause.useless
        alarm_ns = obs.t_ns if alarm else self._pause.alarm_ns
        self._pause = Pause(alarm_ns, not obs.arm.moving, self._pause.useless)

    @property
    def exhausted(self) -> bool:
        return self._useless_s >= USELESS_PAUSE_S

    def over(self, obs: Observation) -> bool:
        """Whether the arm stands and slip has been over for long enough."""
        if self._pause is None:
            return True
        quiet = obs.t_ns - self._pause.alarm_ns >= RESUME_QUIET_NS
        return quiet and not obs.pending and not obs.arm.moving

    def end(self) -> tuple[Command, ...]:
        """The arm goes on, no faster than that a grip which only just holds goes on holding, and
        brakes no harder than the stop did, so that one on the way carries it past no end."""
        if self._pause is None:
            return ()
        self._pause = None
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, RESUME_MPS2, s.answer_stop_mps2)
        return (self._line.move(s.lift_height_m, s.lift_speed_mps, gently_mps2),)
