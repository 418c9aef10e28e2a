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
        self._lasts = False
        self._useless = False
        self._seen_ns = self._asked_ns = self._alarm_ns = 0
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
        self._lasts, self._useless = True, obs.closed_out
        self._stands = not obs.arm.moving
        self._seen_ns = self._alarm_ns = obs.t_ns
        return self._ask(obs)

    def take(self, obs: Observation, alarm: bool) -> tuple[Command, ...]:
        """One sample of it; ``alarm``: slip is not known to be over. A stop may be lost on its
        way."""
        if not self._lasts:
            return ()
        lasted_s = (obs.t_ns - self._seen_ns) * 1e-9
        self.useless_s += lasted_s * self._useless
        self.stood_s += lasted_s * self._stands
        self._stands, self._seen_ns = not obs.arm.moving, obs.t_ns
        if alarm:
            self._alarm_ns = obs.t_ns
        due = obs.t_ns - self._asked_ns >= self._settings.repeat_s * 1e9
        return self._ask(obs) if due and obs.arm.moving and not obs.pending else ()

    def over(self, obs: Observation) -> bool:
        """Whether the arm stands and slip has been over for long enough."""
        quiet = obs.t_ns - self._alarm_ns >= self._settings.resume_quiet_s * 1e9
        return not self._lasts or (quiet and not obs.pending and not obs.arm.moving)

    def end(self) -> tuple[Command, ...]:
        """The arm goes on, no faster than that a grip which only just holds goes on holding, and
        brakes no harder than an answer stops it, so that one on the way carries it past no end."""
        if not self._lasts:
            return ()
        self._lasts = False
        s = self._settings
        gently_mps2 = min(s.lift_acceleration_mps2, s.resume_mps2, s.answer_stop_mps2)
        return (self._line.move(s.lift_height_m, s.lift_speed_mps, gently_mps2),)

    def _ask(self, obs: Observation) -> tuple[Command, ...]:
        self._asked_ns = obs.t_ns
        return (StopArm(self._settings.answer_stop_mps2),)
