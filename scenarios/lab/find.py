"""Search for devices at given addresses, on known ports only; no network is searched."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from urllib.parse import urlsplit

import msgspec

from drivers.errors import GraspError, UsageError
from drivers.robotiq import protocol
from drivers.robotiq.settings import ModbusSettings
from drivers.takktile.emulator.bus import backend
from drivers.takktile.link import UsbLink, boards
from drivers.ur.link import preflight
from drivers.ur.link.connections import DASHBOARD_PORT, RTDE_PORT, Dashboard
from scenarios.rigs.device_checks import read_registers

MODBUS_PORT = 502
TIMEOUT_S = 1.0  # of each query
ADDRESSES = "HOST, HOST:PORT or tcp://HOST:PORT, one device each; no network is searched"


class Found(msgspec.Struct, frozen=True):
    """Result of a query. ``settings``: sections of a file for `--config`; empty without reply."""

    device: str
    where: str
    answered: bool
    detail: str
    settings: dict[str, dict[str, str | int]] = {}


def find(addresses: Sequence[str]) -> Iterator[Found]:
    """Query each address: HOST for gripper and arm, HOST:PORT for a gripper, tcp://HOST:PORT for an
    emulated board; then list the boards on USB. Raises UsageError for any other form."""
    for scheme, host, port in [_parsed(address) for address in addresses]:
        if scheme:
            url = f"tcp://{host}:{port}"
            yield _query("fingertips", url, partial(_board, url), {"usb": {"url": url}})
            continue
        at: dict[str, str | int] = {"host": host, "port": port or MODBUS_PORT}
        where = f"{host}:{at['port']}, Modbus TCP"
        yield _query("gripper", where, partial(_gripper, host, port or MODBUS_PORT), {"modbus": at})
        if port is None:
            where = f"{host}:{DASHBOARD_PORT}, dashboard"
            yield _query("arm", where, partial(_dashboard, host), {"ur": {"host": host}})
            where = f"{host}:{RTDE_PORT}, RTDE"
            yield _query("arm", where, partial(_rtde, host))
    for board in boards():
        serial = board.serial or "none"
        allowed = "" if board.allowed else ", no permission: `grasp doctor` has the udev rule"
        detail = f"serial number {serial}{allowed}"
        yield Found("fingertips", board.node, True, detail, {"usb": {"serial": serial}})


def settings_of(found: Sequence[Found]) -> str:
    """Text of a file for `--config` with the first device found per section; empty without any."""
    sections: dict[str, dict[str, str | int]] = {}
    for each in found:
        for section, keys in each.settings.items():
            sections.setdefault(section, keys)
    return "\n".join(
        "\n".join([f"[{section}]", *(f"{key} = {_toml(value)}" for key, value in keys.items())])
        for section, keys in sections.items()
    )


def _parsed(address: str) -> tuple[str, str, int | None]:
    scheme, _, rest = address.rpartition("://")
    try:
        parts = urlsplit(f"//{rest}")
        port = parts.port
    except ValueError as error:
        raise UsageError(f"{address!r}: {error}", ADDRESSES) from None
    host, other = parts.hostname, bool(parts.path or parts.query)
    if host is None or other or scheme not in ("", "tcp") or (scheme and port is None):
        raise UsageError(f"{address!r} is not an address of a device", ADDRESSES)
    return scheme, host, port


def _query(
    device: str, where: str, query: Callable[[], str],
    settings: dict[str, dict[str, str | int]] | None = None,
) -> Found:  # fmt: skip
    try:
        return Found(device, where, True, query(), settings or {})
    except (GraspError, OSError, ValueError) as error:
        return Found(device, where, False, _reason(error, where))


def _reason(error: Exception, where: str) -> str:
    """Text of an error without the address."""
    cause = error if isinstance(error, OSError) else error.__context__
    if isinstance(cause, OSError):
        timeout = f"no reply within {TIMEOUT_S:g} s"
        return timeout if isinstance(cause, TimeoutError) else cause.strerror or str(cause)
    return str(error).removeprefix(f"the gripper at {where.partition(',')[0]} ")


def _gripper(host: str, port: int) -> str:
    settings = ModbusSettings(host=host, port=port, timeout_s=TIMEOUT_S)
    before, now = read_registers(settings)
    if implausible := protocol.implausible_values(now, before):
        raise ValueError(", ".join(implausible))
    state = "activated" if now.ready else "answers like a gripper that is not activated"
    return f"{state}, {protocol.FAULTS[now.fault].text or 'no fault'}{now.zeros_note}"


def _dashboard(host: str) -> str:
    with Dashboard(host, TIMEOUT_S) as dashboard:
        greeting = dashboard.line()
        if "Dashboard Server" not in greeting:
            raise ValueError(f"no dashboard server: it sends {greeting!r}")
        return ", ".join([greeting, *map(dashboard.request, ("get robot model", "robotmode"))])


def _rtde(host: str) -> str:
    before, now = preflight.read_status(host, TIMEOUT_S)
    if implausible := preflight.implausible_values(now, before):
        raise ValueError(", ".join(implausible))
    mode, safety, *_ = preflight.status_lines(now)
    return f"{mode}, {safety}"


def _board(url: str) -> str:
    link = UsbLink.find(None, backend(url))
    with suppress(GraspError):
        link.close()
    return f"serial number {link.serial}"


def _toml(value: str | int) -> str:
    return msgspec.json.encode(value).decode()
