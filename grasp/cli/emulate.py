"""`grasp emulate`: the emulated cell for any client, and a console for its operator's actions."""

import json
import os
import secrets
import signal
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

import msgspec

from drivers.addresses import cannot_listen, check_free, check_host
from drivers.errors import ConfigError, UsageError
from drivers.ur.emulator.server import PORTS
from grasp.cli import exits
from grasp.cli.device_commands import OPERATOR_ACTIONS, EmulateOptions
from grasp.cli.options import check_writable
from grasp.cli.output import JsonObject, print_status
from grasp.files import write_whole
from grasp.settings import config_dir, read_toml
from scenarios.campaign.config import load_for_devices
from scenarios.report.run_settings import toml
from scenarios.report.run_view import turned_text
from scenarios.rigs.cell_faults import describe_all_faults
from scenarios.rigs.cell_order import CellOrder
from scenarios.rigs.emulated_cell import CellOptions, EmulatedCell, end_on_signals, serve
from scenarios.tap.config import TapConfig
from scenarios.tap.mallet import swing

PERIODS_S = {"cb3": 0.008, "e-series": 0.002}  # of the controller's cycle
DIRECTIONS = ("top", "side", "closing")
STDIN = 0
POLL_S = 0.05
SETTINGS_BEGIN = "# Emulated devices, with timeouts for a busy machine. Not for real devices."
PRESS_S = 1.0  # of a pad


def emulate(args: EmulateOptions) -> int:
    check_address(args.host, args.beyond_loopback, args.gripper_port)
    if args.write is not None:
        check_writable(args.write, SETTINGS_BEGIN)
    there = CellOptions(
        host=args.host, gripper_port=args.gripper_port, profile=args.profile, rtu=args.rtu,
        token=secrets.token_hex(16) if args.beyond_loopback else "",
    )  # fmt: skip
    period = f"arm_model.period_s={PERIODS_S[args.profile]}"
    config = load_for_devices(args.object, "emulated", args.config, [period, *args.set])
    print_status("cell: starting")
    console = Console(config.for_tap(), args.seed)
    order, ended = CellOrder.of(config, args.seed), end_on_signals()

    def opened(cell: EmulatedCell) -> None:
        if args.write is not None:
            write_whole(args.write, lab_settings(cell.endpoints()).encode())
        console.listen(cell)

    try:
        serve(order, there, ended, opened)
    except OSError as error:
        raise cannot_listen(args.host or "loopback", error) from None
    return exits.SUCCESS


def lab_settings(endpoints: JsonObject) -> str:
    """Settings of the rig `hardware` that point at an emulated cell, as TOML."""
    sections = read_toml(config_dir() / "rigs" / "emulated.toml").table
    gripper = endpoints["gripper"]
    sections["modbus"] |= {"host": gripper["host"], "port": gripper["port"]}
    sections["usb"] = {"url": endpoints["tactile"]["url"]}
    sections["ur"]["host"] = endpoints["arm"]["host"]
    sections["calibration"] = {"pressed_bytes": [0], "presses": 10}
    lines = [SETTINGS_BEGIN]
    for name, section in sections.items():
        lines += [f"[{name}]", *(f"{key} = {toml(value)}" for key, value in section.items())]
    return "\n".join(lines) + "\n"


def check_address(host: str | None, beyond_loopback: bool, gripper_port: int = 0) -> None:
    """Check where to listen before the simulation is compiled, which takes a while."""
    if host is not None:
        check_host(host, beyond_loopback)
        check_free(host, (*PORTS, gripper_port))
    elif beyond_loopback:
        raise UsageError("--beyond-loopback needs --host", "name the address to listen on")


class Console:
    """Executes lines of standard input, if it is a terminal or a pipe, until it ends."""

    def __init__(self, config: TapConfig, seed: int) -> None:
        """Search the strength of taps now, before any client waits for a device."""
        self._typed = _is_typed()
        self._taps: dict[str, JsonObject | ConfigError] = {}
        for direction in DIRECTIONS if self._typed else ():
            tap = msgspec.structs.replace(config.tap, direction=direction)
            try:
                found = swing(msgspec.structs.replace(config, tap=tap), seed)
                self._taps[direction] = msgspec.to_builtins(found.impact)
            except ConfigError as error:  # an object that falls by itself cannot be tapped
                self._taps[direction] = error

    def listen(self, cell: EmulatedCell) -> None:
        if not self._typed:
            return
        # in the background, reading from the terminal then fails instead of stopping this process
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
        if os.isatty(STDIN):
            _say(f"actions of an operator, one per line: {OPERATOR_ACTIONS}")
        threading.Thread(target=self._run, args=(cell,), name="console", daemon=True).start()

    def _run(self, cell: EmulatedCell) -> None:
        for line in _lines():
            if line.strip():
                _say(self._execute(cell, line.split()))

    def _execute(self, cell: EmulatedCell, words: list[str]) -> str:
        if words in (["fault"], ["fault", "help"]):
            return f"faults:\n{describe_all_faults()}"
        try:
            reply = cell.execute_request(self._request(words))
        except (ValueError, KeyError, msgspec.MsgspecError) as error:
            return f"{error.args[0] if error.args else error}: {OPERATOR_ACTIONS}"
        while words[0] == "home" and (reply.get("away_m") or reply.get("turned_rad")):
            time.sleep(POLL_S)
            reply = cell.execute_request({"verb": "home"})
        if words[0] == "press":
            time.sleep(PRESS_S)  # until the pad is released
        if "error" in reply:
            return str(reply["error"])
        if words[0] == "look":
            return _look_text(reply["truth"])
        if words[0] == "scale":
            return _scale_text(reply["truth"])
        return f"done: {reply['effect']}" if "effect" in reply else "done"

    def _request(self, words: list[str]) -> JsonObject:
        match words:
            case ["fault", name, *pairs]:
                settings = (pair.partition("=") for pair in pairs)
                return {"verb": "fault", "name": name, **{k: _value(v) for k, _, v in settings}}
            case ["tap"] | ["tap", ("top" | "side" | "closing")]:
                found = self._taps[words[-1] if words[1:] else "top"]
                if isinstance(found, ConfigError):
                    raise ValueError(str(found))
                return {"verb": "tap", **found}
            case ["press", finger, taxel, *newtons] if len(newtons) < 2:
                force = {"newtons": _value(newtons[0])} if newtons else {}
                return {"verb": "press", "finger": finger.upper(), "taxel": _value(taxel), **force,
                        "seconds": PRESS_S}  # fmt: skip
            case ["lay", finger, newtons]:
                return {"verb": "lay", "finger": finger.upper(), "newtons": _value(newtons)}
            case ["look"] | ["scale"]:
                return {"verb": "truth"}
            case ["place"] | ["take"] | ["home"]:
                return {"verb": words[0]}
        raise ValueError(f"{' '.join(words)!r} is no action")


def _scale_text(truth: JsonObject) -> str:
    fingers = zip("ABC", truth["normal_n"], strict=True)
    return "fingertip forces: " + ", ".join(f"{name} {newtons:.2f} N" for name, newtons in fingers)


def _look_text(truth: JsonObject) -> str:
    held = "held" if max(truth["normal_n"]) > 0 else "not touched"
    moved_mm = 1e3 * (truth["slip_distance_m"] ** 2 + truth["across_m"] ** 2) ** 0.5
    turned = turned_text(truth["turn_rad"])
    return (
        f"the object is {held}, {truth['height_m'] * 1e3:.0f} mm above the table, "
        f"{moved_mm:.1f} mm from its mark{', ' if turned else ''}{turned}"
    )


def _value(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _is_typed() -> bool:
    """Whether standard input can be read: a pipe, or a terminal with this program in front."""
    try:
        mode = os.fstat(STDIN).st_mode
        if not os.isatty(STDIN):
            return stat.S_ISFIFO(mode)
        return os.tcgetpgrp(STDIN) == os.getpgrp()
    except OSError:  # closed
        return False


def _lines() -> Iterator[str]:
    """Lines of standard input, without sys.stdin: a waiting thread would hold its lock at exit."""
    typed = b""
    with suppress(OSError):
        while some := os.read(STDIN, 4096):
            *lines, typed = (typed + some).split(b"\n")
            for line in lines:
                yield line.decode(errors="replace")


def _say(text: str) -> None:
    with suppress(OSError):
        print_status(f"cell: {text}")
