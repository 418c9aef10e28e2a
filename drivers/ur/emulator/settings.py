"""What is emulated: a CB3 arm by default, an e-Series controller as the other profile."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.ur.emulator.rtde_wire import E_SERIES_OUTPUT_TYPES, OUTPUT_TYPES
from drivers.ur.model import ArmModelSettings

TOOL_DOWN = (3.141592653589793, 0.0, 0.0)


class Profile(msgspec.Struct, frozen=True):
    """One generation of controller."""

    version: tuple[int, int, int, int]
    rate_hz: int
    output_types: dict[str, str]
    has_remote_control: bool  # PolyScope 5.6 and later: Dashboard Server documentation

    @property
    def polyscope(self) -> str:
        major, minor, bugfix, build = self.version
        return f"URSoftware {major}.{minor}.{bugfix}.{build} (Aug 01 2022)"

    @property
    def period_ns(self) -> int:
        return 1_000_000_000 // self.rate_hz


PROFILES = {
    "cb3": Profile((3, 15, 8, 106339), 125, OUTPUT_TYPES, False),
    "e-series": Profile((5, 11, 1, 108318), 500, E_SERIES_OUTPUT_TYPES, True),
}


class EmulatorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The emulated controller. Ports are those of the real one; port 0 lets the system choose."""

    host: Annotated[str, Meta(description="loopback address of its own; not 127.0.0.1")]
    token: Annotated[
        str, Meta(description="of the control channel; with one, any address may be the host")
    ] = ""
    profile: Literal["cb3", "e-series"] = "cb3"
    fault_port: Annotated[
        int, Meta(ge=0, le=65535, description="the emulator's own control channel; 0: any")
    ] = 0
    serial_number: str = "2015300001"
    start_m: tuple[float, float, float] = ArmModelSettings().start_m
    tool_rotation_rad: Annotated[
        tuple[float, float, float], Meta(description="rotation vector of the flange at the start")
    ] = TOOL_DOWN
    unlock_delay_s: Annotated[
        float, Meta(ge=0.0, le=60.0, description="s after a protective stop; UR manual: 5 s")
    ] = 5.0
    stop_deceleration_mps2: Annotated[
        float, Meta(ge=0.1, le=50.0, description="m/s2 when a program ends in motion; assumed")
    ] = 5.0

    @property
    def controller(self) -> Profile:
        return PROFILES[self.profile]
