"""Settings of the gripper driver and of its connection."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta


class DriverSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the gripper driver. "manual": Robotiq 3-Finger manual, 2014 or 2018."""

    calibration: Annotated[
        str, Meta(description="a name in config/calibrations, or a .toml file of this hand")
    ] = ""
    link: Annotated[
        Literal["tcp", "rtu"],
        Meta(description="Modbus link whose registers are used; manual p. 59, 75"),
    ] = "tcp"
    refresh_hz: Annotated[
        Literal[100, 200], Meta(description="register refresh rate of the hand, Hz; manual p. 75")
    ] = 100
    write_interval_s: Annotated[
        float, Meta(ge=0.005, le=0.1, description="s, least time between two writes; manual p. 75")
    ] = 0.01
    whole_writes: Annotated[
        bool, Meta(description="write all registers every time, for a hand that requires it")
    ] = False


class ModbusSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Address of the gripper. "manual": Robotiq 3-Finger manual, 2014 or 2018."""

    host: Annotated[
        str, Meta(description="the gripper's IP address, 192.168.1.11 as shipped; empty: not set")
    ] = ""
    port: Annotated[
        int, Meta(ge=1, le=65535, description="the gripper's TCP port; manual p. 75")
    ] = 502
    serial_port: Annotated[
        str, Meta(description="serial device for Modbus RTU; empty: not set")
    ] = ""
    slave: Annotated[
        int, Meta(ge=1, le=247, description="slave number for Modbus RTU; manual p. 59")
    ] = 9
    timeout_s: Annotated[
        float, Meta(ge=0.01, le=1, description="longest wait for a reply or a connection, s")
    ] = 0.1
