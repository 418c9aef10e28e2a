"""Thread-free core of the arm driver: limits before anything is sent, typed trouble afterwards."""

import math
from typing import Annotated, Protocol

import msgspec
from msgspec import Meta

from drivers.errors import DeviceFault, Refused, Stale
from drivers.interfaces import ArmState, Vector3
from drivers.ur.model import ArmSample


class ArmSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits on what this driver will send. The workspace is a box around the pose at start."""

    max_speed_mps: Annotated[float, Meta(gt=0.0, le=1.0, description="of the tool")] = 0.25
    max_acceleration_mps2: Annotated[float, Meta(gt=0.0, le=10.0, description="of the tool")] = 1.2
    workspace_low_m: Annotated[
        tuple[float, float, float], Meta(description="lowest x, y, z, relative to the start")
    ] = (-0.05, -0.05, -0.01)
    workspace_high_m: Annotated[
        tuple[float, float, float], Meta(description="highest x, y, z, relative to the start")
    ] = (0.05, 0.05, 0.5)
    max_jump_m: Annotated[
        float, Meta(gt=0.0, le=1.0, description="longest single move from the present position")
    ] = 0.5
    max_payload_kg: Annotated[float, Meta(gt=0.0, le=12.5, description="UR10 manual: 10 kg")] = 10.0
    stale_after_s: Annotated[
        float, Meta(ge=0.016, le=1.0, description="the controller's own timestamp may stand still")
    ] = 0.05


class ArmLink(Protocol):
    """The robot as the driver reaches it; every call may raise LinkLost."""

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> None: ...

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None: ...

    def set_payload(self, mass_kg: float) -> None: ...

    def read(self, now_ns: int) -> ArmSample: ...


class ArmDriver:
    """Implements ``drivers.interfaces.Arm`` on a link. ``pump`` is one exchange."""

    def __init__(self, link: ArmLink, settings: ArmSettings) -> None:
        self._link = link
        self._settings = settings
        self._start_m: Vector3 | None = None
        self._state: ArmState | None = None
        self._sample_ns = -1
        self._fresh_ns = 0
        self._now_ns = 0
        self._seq = 0
        self._tripped = False

    @property
    def state(self) -> ArmState | None:
        return self._state

    def pump(self, now_ns: int) -> None:
        """Read one sample; raises Stale and DeviceFault, the latter once an onset."""
        self._now_ns = now_ns
        sample = self._link.read(now_ns)
        if sample.t_ns != self._sample_ns:
            self._sample_ns, self._fresh_ns = sample.t_ns, now_ns
        if self._start_m is None:
            self._start_m = sample.position_m
        self._seq += 1
        self._state = ArmState(
            self._fresh_ns, self._seq, sample.position_m, sample.velocity_mps, sample.moving,
            sample.protective_stop,
        )  # fmt: skip
        self._check(now_ns, sample)

    def _check(self, now_ns: int, sample: ArmSample) -> None:
        if now_ns - self._fresh_ns > self._settings.stale_after_s * 1e9:
            raise Stale(
                "the arm controller's clock stands still",
                "look at the teach pendant, then start the run again",
            )
        onset = sample.protective_stop and not self._tripped
        self._tripped = sample.protective_stop
        if onset:
            raise DeviceFault(
                "the arm made a protective stop",
                "see the teach pendant for the cause, clear it there, then start the run again",
            )

    def move_to(self, position_m: Vector3, speed_mps: float, acceleration_mps2: float) -> None:
        """Straight line; raises Refused outside any limit, before anything is sent."""
        s = self._settings
        _require("arm.max_speed_mps", speed_mps, 0.0, s.max_speed_mps, "m/s")
        _require("arm.max_acceleration_mps2", acceleration_mps2, 0.0, s.max_acceleration_mps2, "m/s2")
        if self._state is None or self._start_m is None:
            raise Refused("the arm's position is not known yet", "connect first")
        jump = math.dist(position_m, self._state.position_m)
        _require("arm.max_jump_m", jump, -1.0, s.max_jump_m, "m")
        limits = zip("xyz", position_m, self._start_m, s.workspace_low_m, s.workspace_high_m,
                     strict=True)  # fmt: skip
        for axis, value, start, low, high in limits:
            _require(f"arm.workspace ({axis} from start)", value - start, low - 1e-9, high + 1e-9, "m")
        self._link.move_l(position_m, speed_mps, acceleration_mps2, self._now_ns)

    def stop(self, deceleration_mps2: float) -> None:
        """Always allowed; a deceleration that makes no sense is replaced by the highest limit."""
        most = self._settings.max_acceleration_mps2
        allowed = deceleration_mps2 if 0.0 < deceleration_mps2 < math.inf else most
        self._link.stop_l(allowed, self._now_ns)

    def set_payload(self, mass_kg: float) -> None:
        _require("arm.max_payload_kg", mass_kg, -1e-9, self._settings.max_payload_kg, "kg")
        self._link.set_payload(mass_kg)


def _require(key: str, value: float, above: float, most: float, unit: str) -> None:
    if not above < value <= most:
        raise Refused(
            f"{value:g} {unit} is outside {key}", f"allowed: more than {above:g} up to {most:g} {unit}"
        )

