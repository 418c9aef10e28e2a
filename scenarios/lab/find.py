"""Who answers at addresses that a person gives: asked on the ports known, never searched for."""

import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Final
from urllib.parse import urlsplit

import msgspec

from drivers.errors import GraspError, UsageError
from drivers.robotiq import protocol as gripper_words
from drivers.robotiq.modbus import ModbusSettings, ModbusTransport
from drivers.robotiq.protocol import FAULTS, REGISTERS, TCP, StatusRegisters
from drivers.takktile.emulator.bus import backend
from drivers.takktile.link import UsbLink, boards
from drivers.ur.link import preflight as arm_look
from drivers.ur.link.preflight import DASHBOARD_PORT, RTDE_PORT, Dashboard, peek

MODBUS_PORT: Final = 502
SECONDARY_PORT: Final = 30002
ROBOT_STATE, ROBOT_MESSAGE = 16, 20  # kinds of the secondary interface; UR client interfaces
_UNANSWERED = (OSError, ValueError, struct.error)


Setting = tuple[str, str, str | int]


class Asked(msgspec.Struct, frozen=True):
    """One question: who was asked where, whether somebody of that kind answered, and what. What to
    write into a file for `--config` stands in ``settings``: section, key and value of each."""

    device: str
    where: str
    answered: bool
    said: str
    settings: tuple[Setting, ...] = ()


def ask(words: Sequence[str], timeout_s: float) -> Iterator[Asked]:
    """Each word: HOST (all ports known), HOST:PORT (a gripper there), tcp://HOST:PORT (an emulated
    board). Raises UsageError for what is none of these, a whole network among them."""
    for host, port, scheme in [_parsed(word) for word in words]:
        if scheme:
            yield _board(f"tcp://{host}:{port}")
        elif port is not None:
            yield _gripper(host, port, timeout_s)
        else:
            yield _gripper(host, MODBUS_PORT, timeout_s)
            yield _dashboard(host, timeout_s)
            yield _secondary(host, timeout_s)
            yield _rtde(host, timeout_s)


def usb_boards() -> list[Asked]:
    """Fingertip boards on this machine's own USB."""
    found = []
    for board in boards():
        said = f"serial number {board.serial or 'none'}"
        if not board.allowed:
            said += ", no permission: `grasp doctor` has the udev rule"
        setting = ("usb", "serial", board.serial or "any")
        found.append(Asked("fingertips", board.node, True, said, (setting,)))
    return found


def _parsed(word: str) -> tuple[str, int | None, str]:
    remedy = "HOST, HOST:PORT or tcp://HOST:PORT, one device each: nothing is searched for"
    scheme, _, rest = word.rpartition("://")
    try:
        parts = urlsplit(f"//{rest}")
        port = parts.port
    except ValueError as error:
        raise UsageError(f"{word!r}: {error}", remedy) from None
    odd = parts.path or parts.query or not parts.hostname or scheme not in ("", "tcp")
    if odd or (scheme and port is None):
        raise UsageError(f"{word!r} is no address", remedy)
    return str(parts.hostname), port, scheme


def _gripper(host: str, port: int, timeout_s: float) -> Asked:
    where = f"{host}:{port}, Modbus TCP"
    transport = ModbusTransport(ModbusSettings(host=host, port=port, timeout_s=min(1.0, timeout_s)))
    try:
        words = transport.read(TCP.status_register, REGISTERS, time.monotonic_ns())
        status = StatusRegisters.from_registers(words)
    except (GraspError, ValueError) as error:
        return Asked("gripper", where, False, str(error))
    finally:
        transport.close()
    strange = gripper_words.doubts(status, status)
    state = "activated" if status.ready else "not activated"
    said = "; ".join(strange) or f"{state}, {FAULTS[status.fault].text or 'no fault'}"
    at = (("modbus", "host", host), ("modbus", "port", port))
    return Asked("gripper", where, not strange, said, at)


def _dashboard(host: str, timeout_s: float) -> Asked:
    def said() -> str:
        with Dashboard(host, timeout_s) as dashboard:
            lines = [dashboard.line()]
            if "Dashboard Server" not in lines[0]:
                raise ValueError(f"no dashboard server: it says {lines[0]!r}")
            return ", ".join([*lines, *map(dashboard.ask, ("get robot model", "robotmode"))])

    at = (("ur", "host", host),)
    return _answer("arm", f"{host}:{DASHBOARD_PORT}, dashboard", said, at)


def _secondary(host: str, timeout_s: float) -> Asked:
    def said() -> str:
        length, kind = struct.unpack(">IB", peek(host, SECONDARY_PORT, 5, timeout_s))
        if kind not in (ROBOT_STATE, ROBOT_MESSAGE) or length < 5:
            raise ValueError("it sends no messages of a robot")
        return "sends the robot's state"

    return _answer("arm", f"{host}:{SECONDARY_PORT}, secondary interface", said)


def _rtde(host: str, timeout_s: float) -> Asked:
    def said() -> str:
        before, now = arm_look.look(host, timeout_s)
        if strange := arm_look.doubts(now, before):
            raise ValueError("; ".join(strange))
        mode, safety, *_ = arm_look.lines(now)
        return f"{mode}, {safety}"

    return _answer("arm", f"{host}:{RTDE_PORT}, RTDE", said)


def _answer(
    device: str, where: str, said: Callable[[], str], settings: tuple[Setting, ...] = ()
) -> Asked:
    try:
        return Asked(device, where, True, said(), settings)
    except (GraspError, *_UNANSWERED) as error:
        why = "no answer in time" if isinstance(error, TimeoutError) else str(error)
        return Asked(device, where, False, why)


def _board(url: str) -> Asked:
    try:
        link = UsbLink.find(None, backend(url))
    except (GraspError, *_UNANSWERED) as error:
        return Asked("fingertips", url, False, str(error))
    with suppress(GraspError):
        link.close()
    return Asked("fingertips", url, True, f"serial number {link.serial}", (("usb", "url", url),))


def settings_of(found: Sequence[Asked]) -> str:
    """What a file for `--config` would say of those that answered; empty where none did."""
    sections: dict[str, dict[str, str | int]] = {}
    for section, key, value in (one for each in found if each.answered for one in each.settings):
        sections.setdefault(section, {}).setdefault(key, value)
    return "".join(
        f"[{name}]\n" + "".join(f"{k} = {_toml(v)}\n" for k, v in keys.items())
        for name, keys in sections.items()
    )


def _toml(value: str | int) -> str:
    return msgspec.json.encode(value).decode()
