"""Settings of the arm driver, of its connection and of the modelled controller."""

from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import Vector3

Pose = tuple[float, float, float, float, float, float]  # m and rad
MAX_PAYLOAD_KG = 10.0  # gripper included; UR10 user manual


class ArmSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Limits of commands. The workspace is a box around the start position."""

    max_speed_mps: Annotated[
        float, Meta(gt=0, le=1, description="m/s, limit of the tool; ISO 10218's reduced: 0.25")
    ] = 0.25
    max_acceleration_mps2: Annotated[
        float, Meta(gt=0, le=10, description="m/s2, limit of the tool; UR manual: movel's default")
    ] = 1.2
    max_stop_mps2: Annotated[
        float, Meta(gt=0, le=10, description="m/s2, hardest stop of the tool; ur_rtde's default")
    ] = 10.0
    workspace_low_m: Annotated[
        tuple[float, float, float], Meta(description="m, lowest x, y, z from the start; assumed")
    ] = (-0.05, -0.05, -0.01)
    workspace_high_m: Annotated[
        tuple[float, float, float], Meta(description="m, highest x, y, z from the start; assumed")
    ] = (0.05, 0.05, 0.5)
    max_jump_m: Annotated[
        float, Meta(gt=0, le=1, description="m, longest move of one command; assumed")
    ] = 0.5
    payload_kg: Annotated[
        float,
        Meta(
            ge=0, le=MAX_PAYLOAD_KG, description="kg on the flange; hand 2.3 (manual), rest assumed"
        ),
    ] = 2.6
    stale_after_s: Annotated[
        float, Meta(ge=0.016, le=1, description="s, older controller timestamps are stale; assumed")
    ] = 0.05


class UrSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Connection to the controller, payload on the flange, and time-outs."""

    host: Annotated[str, Meta(description="address of the arm's controller; empty: not set")] = ""
    tcp_offset: Annotated[
        Pose, Meta(description="m and rad, tool centre point from the flange; assumed")
    ] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cog_m: Annotated[
        tuple[float, float, float],
        Meta(description="m, centre of gravity of the payload from the flange; assumed"),
    ] = (0.0, 0.0, 0.06)
    upper_registers: Annotated[
        bool,
        Meta(description="use RTDE registers 24 to 47, since a fieldbus takes those below"),
    ] = False
    watchdog_hz: Annotated[
        float, Meta(ge=1, le=50, description="watchdog kicks per s; with fewer the arm stops")
    ] = 10.0
    heartbeat_timeout_s: Annotated[
        float, Meta(ge=0.05, le=5, description="s without a poll after which a motion is braked")
    ] = 0.15
    step_timeout_s: Annotated[
        float, Meta(ge=0.1, le=10, description="s, longest wait for the reply to a command")
    ] = 2.0

    @property
    def start_timeout_s(self) -> float:
        """Longest wait until the program runs on the controller."""
        return 7.5 * self.step_timeout_s

    @property
    def brake_timeout_s(self) -> float:
        """Longest braking of the worker when the client is gone; 1 m/s at 0.5 m/s2 takes 2 s."""
        return self.step_timeout_s

    @property
    def close_timeout_s(self) -> float:
        """Longest wait for the worker to end before it is killed; exceeds ``brake_timeout_s``."""
        return 2.0 * self.step_timeout_s

    @property
    def stop_margin_s(self) -> float:
        """Time that a stop may take in addition to braking; assumed."""
        return 0.25 * self.step_timeout_s

    @property
    def link_timeout_s(self) -> float:
        """Time without data that ends the link; ur_rtde's own is 2.5 s."""
        return min(2.0, 0.5 * self.step_timeout_s)


class ArmModelSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the modelled controller."""

    start_m: Vector3 = (0.5, 0.1, 0.3)  # tool position at power-up, base frame
    period_s: Annotated[
        float, Meta(ge=0.001, le=0.02, description="s, controller cycle; UR manual: CB3 125 Hz")
    ] = 0.008
