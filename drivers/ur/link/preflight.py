"""Ask a controller, step by step and each with a deadline, whether ur_rtde can work with it.

ur_rtde blocks for ever on a peer that accepts and stays silent, and reports other trouble late and
vaguely. This goes first and names every failure with its remedy. RTDE framing and names: UR's
Real-Time Data Exchange (RTDE) guide; commands: UR's dashboard server guide.
"""

import contextlib
import socket
import struct
import time
from collections.abc import Callable
from typing import Literal, TypeVar

import msgspec

from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import LEAST_SPEED_FRACTION

DASHBOARD_PORT, SCRIPT_PORT, RTDE_PORT = 29999, 30003, 30004

CONNECT_AGAIN = "check power, cable and address of the robot's controller"
Status = Literal["ok", "warn", "fail"]
Version = tuple[int, int, int, int]

# ur_rtde does not ask for remote control at these addresses
_UNCHECKED_HOSTS = ("localhost", "127.0.0.1", "192.168.56.101")
# what ur_rtde 1.6.5 writes to with its register offset 0
_REGISTERS = [f"input_int_register_{i}" for i in range(8)] + [
    f"input_double_register_{i}" for i in range(18)
]
_ASK_AGAIN_S = 0.05  # for claims: a client that has just gone is noticed a moment later
_FIELDS = b"runtime_state,target_speed_fraction"
_LOOKS_HZ = 25.0
_PLAYING = {2: "runs", 5: "resumes"}  # runtime_state; RTDE guide
_FULL_SPEED = 0.995  # a slider that says 100 %
TURN_UP = "set the speed slider to 100 % at the teach pendant"
_HANG_UP_S = 0.2
_LONGEST_LINE = 1024

_Result = TypeVar("_Result")


class PreflightCheck(msgspec.Struct, frozen=True):
    """One question and its answer; ``remedy`` is empty when there is nothing to do."""

    name: str
    status: Status
    detail: str
    remedy: str = ""


class PreflightFindings(msgspec.Struct, frozen=True):
    """Everything that was asked; questions that hang on a failed one are left out."""

    host: str
    checks: tuple[PreflightCheck, ...]
    version: Version | None = None

    @property
    def failures(self) -> tuple[PreflightCheck, ...]:
        return tuple(check for check in self.checks if check.status == "fail")


def preflight(host: str, step_timeout_s: float = 2.0) -> PreflightFindings:
    """Ask everything; never raises on an unfit controller, and no step takes longer than told."""
    checks = [_address(host)]
    reachable = set()
    for port, name in (
        (DASHBOARD_PORT, "dashboard"),
        (SCRIPT_PORT, "script"),
        (RTDE_PORT, "rtde"),
    ):
        check = _port(host, port, name, step_timeout_s)
        checks.append(check)
        reachable |= {port} if check.status == "ok" else set()
    version = None
    if RTDE_PORT in reachable:
        version, found = _ask_rtde(host, step_timeout_s)
        checks += found
    if DASHBOARD_PORT in reachable:
        checks += _ask_dashboard(host, version, step_timeout_s)
    return PreflightFindings(host, tuple(checks), version)


def require(findings: PreflightFindings) -> None:
    """Raise for findings with failures: all of them in one message, by the gravest kind.

    LinkLost when something does not answer, DeviceFault when robot or safety state forbid motion or
    the controller is not set up for remote control by RTDE.
    """
    failures = findings.failures
    if not failures:
        return
    answered = all(check.name in _ANSWERED for check in failures)
    raise (DeviceFault if answered else LinkLost)(
        f"arm at {findings.host}: " + "; ".join(check.detail for check in failures),
        "; ".join(dict.fromkeys(check.remedy for check in failures)),
    )


_ANSWERED = (
    "version", "registers", "program", "speed slider", "remote control", "robot mode",
    "safety mode",
)  # fmt: skip


def judge_version(version: Version) -> PreflightCheck:
    """Tested with 3.15 and 5.5 to 5.22; refused where the registers do not exist yet."""
    release, text = version[:2], ".".join(map(str, version))
    if release < (3, 4) or (4, 0) <= release < (5, 4):
        remedy = "update PolyScope to 3.15 (CB3) or to 5.5 or later (e-Series)"
        return PreflightCheck(
            "version", "fail", f"PolyScope {text} has no RTDE registers for ur_rtde", remedy
        )
    if release == (3, 15) or (5, 5) <= release <= (5, 22):
        return PreflightCheck("version", "ok", f"PolyScope {text}")
    return PreflightCheck(
        "version",
        "warn",
        f"PolyScope {text} is untested",
        "tested: 3.15 and 5.5 to 5.22; try slow moves first",
    )


def _address(host: str) -> PreflightCheck:
    if host not in _UNCHECKED_HOSTS:
        return PreflightCheck("address", "ok", host)
    return PreflightCheck(
        "address",
        "warn",
        f"at {host} ur_rtde does not check for remote control",
        "use the controller's own address",
    )


def _port(host: str, port: int, name: str, timeout_s: float) -> PreflightCheck:
    what = f"{name} port {port}"
    try:
        socket.create_connection((host, port), timeout_s).close()
    except OSError as error:
        remedy = f"{CONNECT_AGAIN}; no firewall may stand before its ports"
        return PreflightCheck(f"{name} port", "fail", f"{what}: {_reason(error)}", remedy)
    return PreflightCheck(f"{name} port", "ok", f"{what} open")


def _reason(error: Exception) -> str:
    return "no answer in time" if isinstance(error, TimeoutError) else str(error) or "no answer"


class Rtde:
    """One RTDE connection for a handful of questions; they raise OSError and ValueError."""

    def __init__(self, host: str, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._socket = socket.create_connection((host, RTDE_PORT), timeout_s)

    def __enter__(self) -> "Rtde":
        return self

    def __exit__(self, *_: object) -> None:
        """Wait briefly for the controller to hang up too, whatever it still sends: then the claims
        are free again."""
        deadline = time.monotonic() + min(_HANG_UP_S, self._timeout_s)
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            while True:
                _receive(self._socket, _LONGEST_LINE, deadline)
        self._socket.close()

    def ask(self, kind: bytes, body: bytes = b"") -> bytes:
        """Body of the answer of the same kind; other packets (messages) are skipped."""
        self.tell(kind, body)
        return self.wait(kind)

    def tell(self, kind: bytes, body: bytes) -> None:
        """A packet that is not answered."""
        self._socket.settimeout(self._timeout_s)
        self._socket.sendall(struct.pack(">Hc", 3 + len(body), kind) + body)

    def wait(self, kind: bytes) -> bytes:
        """Body of the next packet of a kind."""
        deadline = time.monotonic() + self._timeout_s
        while True:
            size, found = struct.unpack(">Hc", self._exactly(3, deadline))
            if size < 3:
                raise ValueError(f"RTDE packet of {size} bytes")
            answer = self._exactly(size - 3, deadline)
            if found == kind:
                return answer

    def _exactly(self, count: int, deadline: float) -> bytes:
        data = b""
        while len(data) < count:
            data += _receive(self._socket, count - len(data), deadline)
        return data


def _receive(peer: socket.socket, count: int, deadline: float) -> bytes:
    left_s = deadline - time.monotonic()
    if left_s <= 0.0:
        raise TimeoutError
    peer.settimeout(left_s)
    data = peer.recv(count)
    if not data:
        raise ConnectionError("the peer hung up")
    return data


def peek(host: str, port: int, count: int, timeout_s: float) -> bytes:
    """The first bytes that a port sends unasked; raises OSError."""
    deadline = time.monotonic() + timeout_s
    with socket.create_connection((host, port), timeout_s) as peer:
        data = b""
        while len(data) < count:
            data += _receive(peer, count - len(data), deadline)
        return data


def _ask_rtde(host: str, timeout_s: float) -> tuple[Version | None, list[PreflightCheck]]:
    """Protocol, then version, then claims: each needs the one before."""
    checks: list[PreflightCheck] = []
    version = None
    try:
        with Rtde(host, timeout_s) as rtde:
            (accepted,) = struct.unpack(">B", rtde.ask(b"V", struct.pack(">H", 2)))
            if accepted:
                checks.append(PreflightCheck("rtde protocol", "ok", "RTDE protocol version 2"))
            else:
                detail, remedy = "RTDE protocol version 2 is refused", "update PolyScope"
                return None, [PreflightCheck("version", "fail", detail, remedy)]
            numbers = struct.unpack(">4I", rtde.ask(b"v"))
            version = (numbers[0], numbers[1], numbers[2], numbers[3])
            checks.append(judge_version(version))
            if checks[-1].status != "fail":
                checks.append(_claims(rtde, timeout_s))
                checks += _readiness(rtde, timeout_s)
    except (OSError, ValueError, struct.error) as error:
        detail = f"RTDE port {RTDE_PORT} answers no RTDE: {_reason(error)}"
        checks.append(PreflightCheck("rtde protocol", "fail", detail, CONNECT_AGAIN))
    return version, checks


def _claims(rtde: Rtde, timeout_s: float) -> PreflightCheck:
    """Ask for the registers; what is in use is asked for again while the step's time lasts."""
    deadline = time.monotonic() + timeout_s
    while True:
        types = rtde.ask(b"I", ",".join(_REGISTERS).encode())[1:].decode("ascii").split(",")
        answers = dict(zip(_REGISTERS, types, strict=False))
        taken = [name for name in _REGISTERS if answers.get(name) == "IN_USE"]
        if not taken or time.monotonic() + _ASK_AGAIN_S > deadline:
            break
        time.sleep(_ASK_AGAIN_S)
    if taken:
        return PreflightCheck(
            "registers",
            "fail",
            f"RTDE input registers are in use by another client: {_shortened(taken)}",
            "end other RTDE clients, disable the fieldbus (EtherNet/IP, PROFINET, MODBUS) and "
            "URCaps that claim registers, then try again",
        )
    missing = [name for name in _REGISTERS if answers.get(name, "NOT_FOUND") == "NOT_FOUND"]
    if missing:
        detail = f"the controller does not know {_shortened(missing)}"
        return PreflightCheck("registers", "fail", detail, "update PolyScope")
    return PreflightCheck("registers", "ok", f"{len(_REGISTERS)} RTDE input registers free")


def _readiness(rtde: Rtde, timeout_s: float) -> list[PreflightCheck]:
    """Does another program move the arm, and what does the speed slider make of speeds? A program
    is looked at again while the step's time lasts: one whose client has just gone is ending."""
    types = rtde.ask(b"O", struct.pack(">d", _LOOKS_HZ) + _FIELDS)[1:]
    if b"NOT_FOUND" in types or rtde.ask(b"S") != b"\x01":
        raise ValueError(f"it does not send {_FIELDS.decode()}: {types.decode()}")
    deadline = time.monotonic() + timeout_s
    while True:
        state, fraction = struct.unpack(">xId", rtde.wait(b"U"))
        if state not in _PLAYING or time.monotonic() > deadline:
            return [_program(state), judge_speed(fraction)]


def _program(state: int) -> PreflightCheck:
    if state not in _PLAYING:
        return PreflightCheck("program", "ok", "no program runs on the arm")
    return PreflightCheck(
        "program", "fail", f"a program {_PLAYING[state]} on the arm already, another client's or "
        "the teach pendant's", "end it where it was started, or by `grasp arm stop`",
    )  # fmt: skip


def judge_speed(fraction: float) -> PreflightCheck:
    """Of the speed slider: what it makes slower is said, what it makes too slow is refused."""
    said = f"speed slider at {100 * fraction:.3g} %"
    if fraction >= _FULL_SPEED:
        return PreflightCheck("speed slider", "ok", said)
    if fraction >= LEAST_SPEED_FRACTION:
        slower = f"{said}: the arm moves at so much of every speed that it is told"
        return PreflightCheck("speed slider", "warn", slower, TURN_UP)
    least = f"{said}, and below {100 * LEAST_SPEED_FRACTION:g} % slip is not surely heard"
    return PreflightCheck("speed slider", "fail", least, f"{TURN_UP}; go slower by settings")


def _shortened(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


class Dashboard:
    """Line by line: one command, one answer; raises OSError and ValueError."""

    def __init__(self, host: str, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._socket = socket.create_connection((host, DASHBOARD_PORT), timeout_s)
        self._rest = b""

    def __enter__(self) -> "Dashboard":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def line(self) -> str:
        deadline = time.monotonic() + self._timeout_s
        while b"\n" not in self._rest:
            if len(self._rest) > _LONGEST_LINE:
                raise ValueError("no end of line")
            self._rest += _receive(self._socket, _LONGEST_LINE, deadline)
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("utf-8", "replace").strip()

    def ask(self, command: str) -> str:
        self._socket.settimeout(self._timeout_s)
        self._socket.sendall(command.encode() + b"\n")
        return self.line()


def _ask_dashboard(host: str, version: Version | None, timeout_s: float) -> list[PreflightCheck]:
    checks: list[PreflightCheck] = []
    try:
        with Dashboard(host, timeout_s) as dashboard:
            checks.append(_banner(dashboard.line()))
            if version is not None and version >= (5, 6):  # CB3 has no such switch
                checks.append(_remote(dashboard.ask("is in remote control")))
            checks.append(_robot_mode(dashboard.ask("robotmode")))
            checks.append(_first_known(dashboard.ask, ("safetystatus", "safetymode"), _safety))
    except (OSError, ValueError) as error:
        detail = f"dashboard server does not answer: {_reason(error)}"
        checks.append(PreflightCheck("dashboard", "fail", detail, CONNECT_AGAIN))
    return checks


def _banner(line: str) -> PreflightCheck:
    if "Dashboard Server" in line:
        return PreflightCheck("dashboard", "ok", line)
    return PreflightCheck(
        "dashboard", "fail", f"no dashboard server: it says {line!r}", CONNECT_AGAIN
    )


def _remote(answer: str) -> PreflightCheck:
    if answer.lower() == "true":
        return PreflightCheck("remote control", "ok", "remote control is on")
    return PreflightCheck(
        "remote control",
        "fail",
        f"the robot is not in remote control ({answer})",
        "enable remote control in PolyScope's settings, then switch from Local to Remote at the "
        "top right of the teach pendant",
    )


def _robot_mode(answer: str) -> PreflightCheck:
    mode = _value(answer)
    if mode == "RUNNING":
        return PreflightCheck("robot mode", "ok", "robot mode RUNNING")
    remedy = "power the robot on and release its brakes at the teach pendant"
    return PreflightCheck("robot mode", "fail", f"robot mode is {mode}, not RUNNING", remedy)


_SAFETY_REMEDIES = {
    "PROTECTIVE_STOP": "see the teach pendant for the cause, wait 5 s, clear it there",
    "REDUCED": "leave reduced mode: it changes speeds behind the program's back",
    "SAFEGUARD_STOP": "close the safeguard and reset it",
}
_EMERGENCY = "release the emergency stop, then power the robot on at the teach pendant"


def _safety(answer: str) -> PreflightCheck:
    mode = _value(answer)
    if mode == "NORMAL":
        return PreflightCheck("safety mode", "ok", "safety mode NORMAL")
    fallback = _EMERGENCY if "EMERGENCY" in mode else "see the teach pendant"
    remedy = _SAFETY_REMEDIES.get(mode, fallback)
    return PreflightCheck("safety mode", "fail", f"safety mode is {mode}, not NORMAL", remedy)


def _value(answer: str) -> str:
    """NORMAL of "Safetystatus: NORMAL"."""
    return answer.rpartition(":")[2].strip().upper()


def _first_known(
    ask: Callable[[str], str], commands: tuple[str, ...], judge: Callable[[str], _Result]
) -> _Result:
    """Judge the answer to the first command that this PolyScope understands."""
    answer = ""
    for command in commands:
        answer = ask(command)
        if answer.lower().startswith(command):
            break
    return judge(answer)
