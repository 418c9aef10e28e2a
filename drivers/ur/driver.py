"""Core of the arm driver, without thread: checks limits before sending, raises typed errors."""

import math
from collections.abc import Sequence
from typing import Protocol

import msgspec

from drivers.errors import DeviceFault, Refused, Stale
from drivers.interfaces import ArmState, Vector3, Vector6
from drivers.ur.settings import MAX_PAYLOAD_KG, ArmSettings

_NOT_ACCEPTED = "the arm controller did not accept the move", "look at the teach pendant"
_SLACK_M = 1e-9  # rounding of a pose computed from the start pose and a limit


MAX_SPIN_RADPS = 1.5  # about the tool's z axis; paper: 1 rad/s
MAX_TURN_RAD = 1.6  # in either direction from the start, for the cables; assumed
DRIVE_TIMEOUT_S = 0.1  # a drive that is not renewed for so long is stopped; assumed
_ARRIVED_WITHIN_M = 0.0005  # a move ends within this distance of its target; assumed
_ARRIVED_BELOW_MPS = 0.001  # a move ends below this speed, which the link reports as stationary


class ArmSample(msgspec.Struct, frozen=True):
    """State of one controller cycle; t_ns is the controller's timestamp."""

    t_ns: int
    position_m: Vector3
    velocity_mps: Vector3
    moving: bool
    protective_stop: bool
    angle_rad: float = 0.0  # rotation about the tool's z axis since the start
    spin_radps: float = 0.0
    speed_fraction: float = 1.0  # of the speed slider
    joints_rad: Vector6 | None = None  # base first


class ArmLink(Protocol):
    """Link to the robot; every call may raise LinkLost."""

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Start a straight move and return at once; False when the controller rejects it."""
        ...

    def speed_l(
        self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        """Drive at a velocity and return at once; False when the controller rejects it."""
        ...

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None: ...

    def set_payload(self, mass_kg: float) -> None: ...

    def read(self, now_ns: int) -> ArmSample: ...


class ArmDriver:
    """Implements ``drivers.interfaces.Arm`` on a link. ``poll`` is one exchange."""

    def __init__(self, link: ArmLink, settings: ArmSettings) -> None:
        self._link = link
        self._settings = settings
        self._stale_ns = round(settings.stale_after_s * 1e9)
        self._start_m: Vector3 | None = None
        self._target_m: Vector3 | None = None  # of an unfinished move
        # latest state; its time is when the controller's timestamp last changed
        self.state: ArmState | None = None
        self._sample_ns: int | None = None
        self._sample_changed_ns = 0
        self._now_ns = 0
        self._seq = 0
        self._was_stopped = False
        self._drive_renewed_ns: int | None = None  # last renewal of the current drive
        self._acceleration_mps2 = settings.max_acceleration_mps2  # of that drive

    def poll(self, now_ns: int) -> None:
        """Read one sample. Raises ``Stale`` while the controller's timestamp does not change, and
        ``DeviceFault`` once for each onset of a protective stop."""
        self._now_ns = now_ns
        sample = self._link.read(now_ns)
        if sample.t_ns != self._sample_ns:
            self._sample_ns, self._sample_changed_ns = sample.t_ns, now_ns
        if self._start_m is None:
            self._start_m = sample.position_m
        target_m, stationary = self._target_m, not sample.moving
        if target_m and stationary and (sample.protective_stop or _arrived(sample, target_m)):
            self._target_m = None
        self._seq += 1
        self.state = ArmState(
            t_ns=self._sample_changed_ns,
            seq=self._seq,
            position_m=sample.position_m,
            velocity_mps=sample.velocity_mps,
            # from the command of a move on, although the controller starts it a cycle later
            moving=sample.moving or self._target_m is not None,
            stopped_by_safety=sample.protective_stop,
            angle_rad=sample.angle_rad,
            spin_radps=sample.spin_radps,
            speed_fraction=sample.speed_fraction,
            sampled_ns=sample.t_ns,
            joints_rad=sample.joints_rad,
        )
        renewed_ns = self._drive_renewed_ns
        if renewed_ns is not None and now_ns - renewed_ns > round(DRIVE_TIMEOUT_S * 1e9):
            self.stop(self._acceleration_mps2)
        if now_ns - self._sample_changed_ns > self._stale_ns:
            raise Stale(
                "no new sample of the arm: the arm controller's clock stands still",
                "look at the teach pendant, and at what else takes this computer's processor, then "
                "start the run again",
            )
        onset = sample.protective_stop and not self._was_stopped
        self._was_stopped = sample.protective_stop
        if onset:
            raise DeviceFault(
                "the arm made a protective stop",
                "see the teach pendant for the cause, clear it there, then start the run again",
            )

    def move_to(self, position_m: Vector3, speed_mps: float, acceleration_mps2: float) -> None:
        """Start a straight move; raises ``Refused`` outside any limit, before anything is sent."""
        s = self._settings
        state = self._ready_state(acceleration_mps2)
        _require_up_to("arm.max_speed_mps", speed_mps, s.max_speed_mps, "m/s")
        jump_m = math.dist(position_m, state.position_m)
        _require("arm.max_jump_m", jump_m, 0.0, s.max_jump_m, "m")
        self._require_inside(position_m)
        if not self._link.move_l(position_m, speed_mps, acceleration_mps2, self._now_ns):
            raise Refused(*_NOT_ACCEPTED)
        self._target_m, self._drive_renewed_ns = position_m, None
        self.state = msgspec.structs.replace(state, moving=True)

    def drive(self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float) -> None:
        """Drive at a velocity; raises ``Refused`` outside any limit, before anything is sent.

        Also refused where the tool could leave the workspace or turn too far before an unrenewed
        drive has timed out and braked.
        """
        s = self._settings
        state = self._ready_state(acceleration_mps2)
        _require("arm.max_speed_mps", math.hypot(*velocity_mps), 0.0, s.max_speed_mps, "m/s")
        _require("the limit of spin", abs(spin_radps), 0.0, MAX_SPIN_RADPS, "rad/s")
        self._require_inside(_drive_end(state.position_m, velocity_mps, acceleration_mps2))
        (turned_rad,) = _drive_end((state.angle_rad,), (spin_radps,), acceleration_mps2)
        _require("the limit of turn", abs(turned_rad), 0.0, MAX_TURN_RAD, "rad")
        if not self._link.speed_l(velocity_mps, spin_radps, acceleration_mps2, self._now_ns):
            raise Refused(*_NOT_ACCEPTED)
        self._target_m = None
        self._drive_renewed_ns, self._acceleration_mps2 = self._now_ns, acceleration_mps2

    def stop(self, deceleration_mps2: float) -> None:
        """Stop the arm; never refused. The deceleration is limited to ``max_stop_mps2``. An invalid
        one is replaced by ``max_acceleration_mps2``."""
        s = self._settings
        self._target_m = self._drive_renewed_ns = None
        sane = 0.0 < deceleration_mps2 < math.inf
        asked_mps2 = deceleration_mps2 if sane else s.max_acceleration_mps2
        self._link.stop_l(min(asked_mps2, s.max_stop_mps2), self._now_ns)

    def _ready_state(self, acceleration_mps2: float) -> ArmState:
        most = self._settings.max_acceleration_mps2
        _require_up_to("arm.max_acceleration_mps2", acceleration_mps2, most, "m/s2")
        state = self.state
        if state is None:
            raise Refused("the arm's position is not known yet", "poll the arm driver first")
        if state.stopped_by_safety:
            raise Refused("the arm is in a protective stop", "clear it at the teach pendant")
        return state

    def _require_inside(self, position_m: Sequence[float]) -> None:
        s = self._settings
        start_m = self._start_m or (0.0, 0.0, 0.0)  # known as soon as there is a state
        box = zip("xyz", position_m, start_m, s.workspace_low_m, s.workspace_high_m, strict=True)
        for axis, value, start, low, high in box:
            what = f"arm.workspace_low_m..workspace_high_m ({axis} from start)"
            _require(what, value - start, low, high, "m", _SLACK_M)

    def set_payload(self, mass_kg: float) -> None:
        """Set the mass on the flange, gripper included."""
        _require("the limit of payload", mass_kg, 0.0, MAX_PAYLOAD_KG, "kg")
        self._link.set_payload(mass_kg)


def _arrived(sample: ArmSample, target_m: Vector3) -> bool:
    """Whether position and speed show the end of a move; an arm brakes until the very end."""
    away_m = math.dist(sample.position_m, target_m)
    speed_mps = math.hypot(*sample.velocity_mps)
    return away_m <= _ARRIVED_WITHIN_M and speed_mps <= _ARRIVED_BELOW_MPS


def _drive_end(at: Sequence[float], speed: Sequence[float], acceleration: float) -> list[float]:
    """End of a drive that is not renewed any more: it runs until its time-out, then brakes."""
    braking_s = math.hypot(*speed) / (2.0 * acceleration)
    return [x + v * (DRIVE_TIMEOUT_S + braking_s) for x, v in zip(at, speed, strict=True)]


def _require_up_to(what: str, value: float, most: float, unit: str) -> None:
    if not 0.0 < value <= most:
        raise Refused(f"{value:g} {unit} breaks {what}", f"allowed: above 0, to {most:g} {unit}")


def _require(
    what: str, value: float, least: float, most: float, unit: str, slack: float = 0.0
) -> None:
    if not least - slack <= value <= most + slack:
        raise Refused(f"{value:g} {unit} breaks {what}", f"allowed: {least:g} to {most:g} {unit}")
