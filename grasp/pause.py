"""Pause: the arm stands while slip in the lift is answered, and then goes on gently.

An object that slips there mostly still stands on the table, and the fingers slide up along it: when
the arm stops, slip ends, some 30 ms later, while the hand needs 100 to 200 ms to press harder.
"""

from grasp.commands import Command, StopArm
from grasp.controller_settings import ControllerSettings
from grasp.lift_line import LiftLine
from grasp.observation import Observation


class Pause:
    """One at a time. ``stood_s``: how long the arm has stood in them, ``useless_s``: how long those
    have lasted in which no closing could do anything."""

    def __init__(self, settings: ControllerSettings, line: LiftLine) -> None:
        self._settings = settings
        self._line = line
        self.lasts = False
        self._useless = False
        self.alarm_ns = 0  # slip was last not known to be over
        self._stands = False
        self.stood_s = self.useless_s = 0.0

    @property
    def tired(self) -> bool:
        """Whether the arm has stood for long enough in all while nothing could be done."""
        return self.useless_s >= self._settings.useless_pause_s

    def begin(self, obs: Observation) -> tuple[Command, ...]:
        """Stop the arm, if that is the answer and it is on its way."""
        if self._settings.answer == "jump":
            return ()
        self.lasts, self._useless = True, obs.closed_out
        self._stands = not obs.arm.moving
        self.alarm_ns = obs.t_ns
        return (StopArm(self._settings.answer_stop_mps2),)

    def take(self, obs: Observation, alarm: bool, passed_ns: int) -> None:
        """One sample of it; ``alarm``: slip is not known to be over."""
        if not self.lasts:
            return
        self.useless_s += passed_ns * 1e-9 * self._useless
        self.stood_s += passed_ns * 1e-9 * self._stands
        self._stands = not obs.arm.moving
        if alarm:
            self.alarm_ns = obs.t_ns

    def over(self, obs: Observation) -> bool:
        """Whether the arm stands and slip has been over for long enough."""
        quiet = obs.t_ns - self.alarm_ns >= self._settings.resume_quiet_s * 1e9
        return not self.lasts or (quiet and not obs.pending and not obs.arm.moving)

    def end(self) -> tuple[Command, ...]:
        """The arm goes on, no faster than that a grip which only just holds goes on holding, and
        brakes no harder than an answer stops it, so that one on the way carries it past no end."""
        if not self.lasts:
            return ()
        self.lasts = False
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, s.resume_mps2, s.answer_stop_mps2)
        return (self._line.move(s.lift_height_m, s.lift_speed_mps, gently_mps2),)
