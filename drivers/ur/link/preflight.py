"""Pre-flight checks of a controller, each with a deadline, before ur_rtde connects.

ur_rtde blocks forever on a peer that accepts and stays silent, and reports other problems late and
vaguely. These checks run first and report every failure with its remedy. Names: UR's Real-Time Data
Exchange (RTDE) guide; commands: UR's dashboard server guide.
"""

import importlib.util
import math
import platform
import socket
import struct
import sys
import time
from typing import Final

import msgspec

from drivers.checks import Check
from drivers.errors import DeviceFault, LinkLost, UsageError
from drivers.interfaces import MIN_SPEED_FRACTION
from drivers.ur.link.connections import (
    CHECK_CONNECTION,
    DASHBOARD_PORT,
    RTDE_PORT,
    SCRIPT_PORT,
    Dashboard,
    Rtde,
    reason,
)
from drivers.ur.link.messages import PROGRAM_RUNNING, ROBOT_RUNNING
from drivers.ur.settings import Pose

FULL_SPEED_REMEDY = "set the speed slider to 100 % at the teach pendant"
ARM_MOVES, END_PROGRAM = "the arm moves", "end the program that moves it"
Version = tuple[int, ...]

_REGISTERS = ("int", 8), ("double", 18)  # inputs that ur_rtde 1.6.5 writes: type, number
_UPPER = 24  # first register that no fieldbus uses; RTDE guide
_NO_UPPER_FROM = (5, 23)  # ur_rtde 1.6.5 then mixes both ranges, and no command is executed
_END_OTHERS = (
    "end other RTDE clients, disable the fieldbus (EtherNet/IP, PROFINET, MODBUS) and URCaps that "
    "claim registers, then try again"
)
_RETRY_S = 0.05  # claims of a disconnected client are released with a delay
_PLAYING = {2: "runs", 5: "resumes"}  # runtime_state; RTDE guide
_FULL_SPEED = 0.995  # shown as 100 %
_POLYSCOPE_X = (10,)  # and later versions
_PORTS = {DASHBOARD_PORT: "dashboard", SCRIPT_PORT: "script", RTDE_PORT: "rtde"}


def require_ur_rtde() -> None:
    """Raises UsageError if ur_rtde is not installed, as where it has no wheel."""
    if importlib.util.find_spec("rtde_control") is None:
        here = f"Python {sys.version_info[0]}.{sys.version_info[1]} on {platform.machine()}"
        raise UsageError(
            f"a UR arm, real or emulated, needs ur-rtde, which is not installed: this is {here}; "
            "ur-rtde has wheels for Python 3.11 and 3.12 on x86_64",
            "use one of these, or the rig simulated",
        )


def preflight(host: str, step_timeout_s: float = 2.0, upper_registers: bool = False) -> list[Check]:
    """Run all checks; those that depend on a failed one are omitted. Never raises on an unfit
    controller; each step has a time-out."""
    checks = _Checks(host, step_timeout_s, upper_registers)
    open_ports = checks.ports()
    if RTDE_PORT in open_ports:
        checks.rtde()
    if DASHBOARD_PORT in open_ports:
        checks.dashboard()
    return checks.checks


class _Checks:
    """The checks of a controller and their results."""

    def __init__(self, host: str, timeout_s: float, upper_registers: bool) -> None:
        self.checks: list[Check] = []
        self._version: Version = ()  # not known yet
        self._host, self._timeout_s, self._upper = host, timeout_s, upper_registers

    def _add(self, name: str, ok_text: str, problem: str = "", remedy: str = "") -> None:
        self.checks.append(_result(name, ok_text, problem, remedy))

    def _add_lost(self, name: str, problem: str, remedy: str = CHECK_CONNECTION) -> None:
        self.checks.append(Check(name, "fail", problem, remedy, LinkLost.kind))

    def ports(self) -> list[int]:
        """Check all ports; returns those that are open."""
        problems: dict[int, str] = {}
        for port in _PORTS:
            try:
                socket.create_connection((self._host, port), self._timeout_s).close()
            except OSError as error:
                problems[port] = reason(error)
        remedy = f"{CHECK_CONNECTION}; no firewall may block its ports"
        if len(problems) < len(_PORTS):  # the controller itself is reached
            remedy = (
                "PolyScope 5.10 or later: enable this service at the teach pendant (Settings, "
                "Security, Services); no firewall may block the port"
            )
        for port, name in _PORTS.items():
            if port in problems:
                self._add_lost(f"{name} port", f"{name} port {port}: {problems[port]}", remedy)
            else:
                self._add(f"{name} port", f"{name} port {port} open")
        return [port for port in _PORTS if port not in problems]

    def rtde(self) -> None:
        """Check protocol, then version, then registers and state: each needs the previous one."""
        try:
            with Rtde(self._host, self._timeout_s) as rtde:
                if rtde.request(b"V", struct.pack(">H", 2)) != b"\x01":
                    problem = "RTDE protocol version 2 is refused"
                    self._add("rtde protocol", "", problem, "update PolyScope")
                    return
                self._add("rtde protocol", "RTDE protocol version 2")
                self._version = struct.unpack(">4I", rtde.request(b"v"))
                if self._version >= _POLYSCOPE_X:  # whose missing dashboard is no fault
                    self.checks = [each for each in self.checks if each.name != "dashboard port"]
                self.checks.append(check_version(self._version))
                if self.checks[-1].status != "fail":
                    self._registers(rtde)
                    self._readiness(rtde)
        except (OSError, ValueError, struct.error) as error:
            self._add_lost("rtde protocol", f"no RTDE reply from port {RTDE_PORT}: {reason(error)}")

    def _registers(self, rtde: Rtde) -> None:
        """Check the input registers; those in use are requested again until the step's time-out."""
        if self._upper and self._version >= _NO_UPPER_FROM:
            problem = "ur_rtde cannot use RTDE registers 24 to 47 from PolyScope 5.23 on"
            self._add("registers", "", problem, f"set ur.upper_registers = false; {_END_OTHERS}")
            return
        deadline = time.monotonic() + self._timeout_s
        while True:
            types = _register_types(rtde, self._upper)
            if "IN_USE" not in types.values() or time.monotonic() + _RETRY_S > deadline:
                break
            time.sleep(_RETRY_S)
        taken = [name for name, kind in types.items() if kind == "IN_USE"]
        missing = [name for name, kind in types.items() if kind == "NOT_FOUND"]
        problem, remedy = "", ""
        if taken:
            problem = f"RTDE input registers are in use by another client: {_shortened_list(taken)}"
            remedy = _END_OTHERS
            others_free = {"IN_USE", "NOT_FOUND"}.isdisjoint(
                _register_types(rtde, not self._upper).values()
            )
            if others_free and (self._upper or self._version < _NO_UPPER_FROM):
                use, others = ("false", "0 to 23") if self._upper else ("true", "24 to 47")
                remedy = f"set ur.upper_registers = {use}: registers {others} are free; or {remedy}"
        elif missing:
            problem = f"the controller does not know {_shortened_list(missing)}"
            remedy = "update PolyScope"
        self._add("registers", f"{len(types)} RTDE input registers free", problem, remedy)

    def _readiness(self, rtde: Rtde) -> None:
        """Check for a running program and the speed slider.

        A running program is checked again until the step's time-out, since the program of a client
        that has just disconnected is ending.
        """
        rtde.subscribe(25.0, {"runtime_state": "I", "target_speed_fraction": "d"})
        deadline = time.monotonic() + self._timeout_s
        while True:
            state, fraction = struct.unpack(">xId", rtde.wait(b"U"))
            if state not in _PLAYING or time.monotonic() > deadline:
                break
        problem = state in _PLAYING and (
            f"a program {_PLAYING[state]} on the arm already, another client's or the teach "
            "pendant's"
        )
        remedy = "end it where it was started, or by `grasp arm stop`"
        self._add("program", "no program runs on the arm", problem or "", remedy)
        self.checks.append(check_speed_slider(fraction))

    def dashboard(self) -> None:
        try:
            with Dashboard(self._host, self._timeout_s) as dashboard:
                banner = dashboard.line()
                if "Dashboard Server" in banner:
                    self._add("dashboard", banner)
                else:
                    self._add_lost("dashboard", f"no dashboard server: it sends {banner!r}")
                if self._version >= (5, 6):  # CB3 has no such switch
                    self._state("remote control", dashboard.request("is in remote control"), "TRUE")
                self._state("robot mode", dashboard.request("robotmode"), "RUNNING")
                safety = dashboard.request("safetystatus")
                if not safety.lower().startswith("safetystatus"):  # before PolyScope 5.4
                    safety = dashboard.request("safetymode")
                self._state("safety mode", safety, "NORMAL")
        except (OSError, ValueError) as error:
            self._add_lost("dashboard", f"dashboard server does not reply: {reason(error)}")

    def _state(self, name: str, reply: str, expected: str) -> None:
        """Check the value of a reply such as "Safetystatus: NORMAL"."""
        state = reply.rpartition(":")[2].strip().upper()
        problem = "" if state == expected else f"{name} is {state}, not {expected}"
        remedies = ((key, remedy) for key, remedy in _REMEDIES.items() if key in f"{name} {state}")
        self._add(
            name, f"{name} {state}", problem, next(remedies, ("", "see the teach pendant"))[1]
        )


def _result(name: str, ok_text: str, problem: str = "", remedy: str = "") -> Check:
    return Check(name, "fail", problem, remedy) if problem else Check(name, "ok", ok_text)


_REMEDIES = {  # by text of the check and the state
    "remote control": "enable remote control in PolyScope's settings, then switch from Local to "
    "Remote at the top right of the teach pendant",
    "robot mode": "power the robot on and release its brakes at the teach pendant",
    "PROTECTIVE_STOP": "see the teach pendant for the cause, wait 5 s, clear it there",
    "REDUCED": "leave reduced mode: it changes speeds behind the program's back",
    "SAFEGUARD_STOP": "close the safeguard and reset it",
    "EMERGENCY": "release the emergency stop, then power the robot on at the teach pendant",
}


def check_version(version: Version) -> Check:
    """Check of the version: tested with 3.15 and 5.5 to 5.22; fails where registers are missing."""
    release, text = version[:2], ".".join(map(str, version))
    if release >= _POLYSCOPE_X:
        detail = (
            f"PolyScope X ({text}) is not supported: it has no dashboard server, by which this "
            "program checks remote control, robot and safety mode, and by which `grasp arm stop` "
            "ends programs"
        )
        remedy = "use an arm with PolyScope 3.15 or 5.5 to 5.22"
        return Check("version", "fail", detail, remedy)
    if release < (3, 4) or (4, 0) <= release < (5, 4):
        detail = f"PolyScope {text} has no RTDE registers for ur_rtde"
        remedy = "update PolyScope to 3.15 (CB3) or to 5.5 or later (e-Series)"
        return Check("version", "fail", detail, remedy)
    if release == (3, 15) or (5, 5) <= release <= (5, 22):
        return Check("version", "ok", f"PolyScope {text}")
    remedy = "tested: 3.15 and 5.5 to 5.22; try slow moves first"
    return Check("version", "warn", f"PolyScope {text} is untested", remedy)


def check_speed_slider(fraction: float) -> Check:
    """Check of the speed slider: a slower arm gets a warning, one that is too slow fails."""
    text = f"speed slider at {100 * fraction:.3g} %"
    if fraction >= _FULL_SPEED:
        return Check("speed slider", "ok", text)
    if fraction >= MIN_SPEED_FRACTION:
        slower = f"{text}: the arm moves at this share of every commanded speed"
        return Check("speed slider", "warn", slower, FULL_SPEED_REMEDY)
    least = f"{text}, and below {100 * MIN_SPEED_FRACTION:g} % slip may go undetected"
    return Check("speed slider", "fail", least, f"{FULL_SPEED_REMEDY}; go slower by settings")


def _register_types(rtde: Rtde, upper: bool) -> dict[str, str]:
    """Types of the input registers of a range by name, or IN_USE or NOT_FOUND."""
    names = [
        f"input_{kind}_register_{upper * _UPPER + i}"
        for kind, count in _REGISTERS
        for i in range(count)
    ]
    types = rtde.request(b"I", ",".join(names).encode())[1:].decode("ascii").split(",")
    return dict.fromkeys(names, "NOT_FOUND") | dict(zip(names, types, strict=False))


def _shortened_list(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


# status of the arm


JOINTS: Final = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
MAX_REACH_M: Final = 2.5  # of the tool from the base; UR20 manual: 1.75 m, plus a long tool
STATIONARY_MPS: Final = 0.001  # as ``_STATIONARY_BELOW_MPS`` of the worker
_FIELDS: Final = {
    "timestamp": "d", "actual_q": "6d", "actual_TCP_pose": "6d", "actual_TCP_speed": "6d",
    "robot_mode": "i", "safety_mode": "i", "runtime_state": "I", "target_speed_fraction": "d",
}  # fmt: skip
_DATA: Final = struct.Struct(">B" + "".join(_FIELDS.values()))
_FREQUENCY_HZ: Final = 125.0  # available on every controller
_SAMPLES_APART: Final = 10  # number of samples between the two that are compared

ROBOT_MODES: Final = {
    -1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "power off",
    4: "power on", 5: "idle", 6: "backdrive", 7: "running", 8: "updating firmware",
}  # fmt: skip
SAFETY_MODES: Final = {
    1: "normal", 2: "reduced", 3: "protective stop", 4: "recovery", 5: "safeguard stop",
    6: "system emergency stop", 7: "robot emergency stop", 8: "violation", 9: "fault",
}  # fmt: skip


class ArmStatus(msgspec.Struct, frozen=True):
    """Status of one controller cycle; angles in rad, the rest in m and s."""

    t_s: float
    joints_rad: Pose
    pose: Pose
    speed: Pose
    robot_mode: int
    safety_mode: int
    runtime_state: int
    speed_fraction: float

    @property
    def stationary(self) -> bool:
        return math.hypot(*self.speed[:3]) < STATIONARY_MPS

    @property
    def running(self) -> bool:
        """Powered and brakes released; otherwise pose and speed are not those of the tool."""
        return self.robot_mode == ROBOT_RUNNING


def read_status(host: str, timeout_s: float) -> tuple[ArmStatus, ArmStatus]:
    """Two statuses, shortly after each other. Raises LinkLost without valid replies."""
    try:
        with Rtde(host, timeout_s) as rtde:
            rtde.request(b"V", struct.pack(">H", 2))
            rtde.subscribe(_FREQUENCY_HZ, _FIELDS)
            samples = [_decoded(rtde.wait(b"U")) for _ in range(_SAMPLES_APART + 1)]
            return samples[0], samples[-1]
    except (OSError, ValueError, struct.error) as error:
        why = reason(error)
        raise LinkLost(f"arm at {host}, RTDE port {RTDE_PORT}: {why}", CHECK_CONNECTION) from None


def require_stationary(host: str, timeout_s: float) -> None:
    """Raises DeviceFault where the arm moves: our program would end the one that moves it."""
    if any(each.running and not each.stationary for each in read_status(host, timeout_s)):
        raise DeviceFault(f"arm at {host}: {ARM_MOVES}", END_PROGRAM)


def _decoded(body: bytes) -> ArmStatus:
    _, t_s, *v = _DATA.unpack(body)
    one, two, three = (tuple(v[i : i + 6]) for i in (0, 6, 12))
    return ArmStatus(t_s, one, two, three, *v[18:])


def implausible_values(now: ArmStatus, before: ArmStatus) -> list[str]:
    """Values of two statuses that no arm reports; without motor power only the clock is checked."""
    found = []
    if now.t_s <= before.t_s:
        found.append("the controller's clock stands still")
    if not now.running:
        return found
    if not all(map(math.isfinite, (*now.joints_rad, *now.pose, *now.speed))):
        return [*found, "joints or pose are not numbers"]
    if not any(now.joints_rad):
        found.append("all joints read exactly 0")
    away_m = math.hypot(*now.pose[:3])
    if away_m > MAX_REACH_M:
        found.append(f"the tool is {away_m:.2f} m from the base, beyond any arm's reach")
    moved_m, passed_s = math.dist(now.pose[:3], before.pose[:3]), now.t_s - before.t_s
    if now.stationary and before.stationary and moved_m > 0.005 + passed_s * STATIONARY_MPS:
        found.append(f"the tool went {moved_m * 1e3:.0f} mm at no speed")
    return found


def status_lines(now: ArmStatus) -> list[str]:
    """Text of a status, one line for each item."""
    degrees = ", ".join(
        f"{name} {math.degrees(q):.1f}" for name, q in zip(JOINTS, now.joints_rad, strict=True)
    )
    x, y, z, *turn = now.pose
    program = "runs" if now.runtime_state == PROGRAM_RUNNING else "does not run"
    return [
        f"robot mode {now.robot_mode}: {ROBOT_MODES.get(now.robot_mode, 'unknown')}",
        f"safety mode {now.safety_mode}: {SAFETY_MODES.get(now.safety_mode, 'unknown')}",
        f"program: {program} (runtime state {now.runtime_state})",
        f"speed slider: {now.speed_fraction * 100:.3g} %",
        f"joints, degrees: {degrees}",
        f"tool by the controller's own TCP, mm: x {x * 1e3:.1f}, y {y * 1e3:.1f}, "
        f"z {z * 1e3:.1f}; "
        f"turned, rad: {', '.join(f'{a:.3f}' for a in turn)}",
        f"tool speed, mm/s: {math.hypot(*now.speed[:3]) * 1e3:.1f}",
    ]
