"""The emulator's own control channel: faults on demand, one JSON object a line each way.

This is no part of any UR interface. Where the emulator is not on loopback alone, a request needs
its ``token``. A request is ``{"do": verb, ...}``, the answer ``{"ok": true, ...}`` or
``{"ok": false, "error": text}``. Verbs:

- ``state``: position, modes, counters and the last messages
- ``protective_stop``; ``emergency_stop`` with ``pressed`` (default true); ``kill_program``
- ``remote_control`` with ``on``, of an e-Series alone; ``claim`` with ``names`` (RTDE inputs taken
  by "somebody else"), ``unclaim``
- ``wrench`` with ``value``, six numbers, N and Nm
- ``inputs`` with ``value``: the digital inputs as one number (bits 0 to 7 standard, 8 to 15
  configurable, 16 and 17 the tool's), and both analog ones
- ``speed_slider`` with ``fraction``, 0 to 1: somebody turns it at the pendant
- ``drop_link``: close every UR connection; ``freeze`` with ``seconds``: serve nothing meanwhile
"""

import math
import secrets
from collections.abc import Callable
from typing import Any, Protocol

import msgspec

from drivers.ur.emulator.controller import Controller
from drivers.ur.emulator.rtde import RtdeServer
from drivers.ur.emulator.rtde_wire import INPUT_TYPES

_STRANGER = object()  # owner of the inputs that ``claim`` takes
_MAX_FREEZE_S = 60.0
_SHOWN_MESSAGES = 20


class Links(Protocol):
    """What faults may do to the connections."""

    def drop_links(self) -> None: ...

    def freeze(self, seconds: float) -> None: ...


class FaultRequest(msgspec.Struct, forbid_unknown_fields=True):
    """One line."""

    do: str
    token: str = ""
    pressed: bool = True
    on: bool = True
    names: list[str] = []
    value: list[float] = []
    seconds: float = 0.0
    fraction: float = 1.0


class FaultChannel:
    """Carries out requests."""

    def __init__(
        self, controller: Controller, rtde: RtdeServer, links: Links, token: str = ""
    ) -> None:
        self._token = token.encode()
        self._controller = controller
        self._rtde = rtde
        self._links = links
        self._verbs: dict[str, Callable[[FaultRequest], None]] = {
            "state": lambda request: None,
            "protective_stop": lambda request: controller.protective_stop(),
            "emergency_stop": lambda request: controller.emergency_stop(request.pressed),
            "kill_program": lambda request: controller.stop_program("killed by request"),
            "remote_control": lambda request: controller.set_remote_control(request.on),
            "claim": self._claim,
            "unclaim": lambda request: rtde.release(_STRANGER),
            "wrench": self._wrench,
            "inputs": self._inputs,
            "speed_slider": self._slider,
            "drop_link": lambda request: links.drop_links(),
            "freeze": self._freeze,
        }

    def answer(self, line: str) -> str:
        try:
            request = msgspec.json.decode(line, type=FaultRequest)
            if not secrets.compare_digest(request.token.encode(), self._token):
                raise ValueError("the emulator's token is asked for")
            verb = self._verbs.get(request.do)
            if verb is None:
                raise ValueError(f"unknown verb {request.do!r}")
            verb(request)
            result = {"ok": True, **(self._state() if request.do == "state" else {})}
        except (msgspec.DecodeError, UnicodeError, ValueError) as error:
            result = {"ok": False, "error": str(error)}
        return msgspec.json.encode(result).decode()

    def _state(self) -> dict[str, Any]:
        controller = self._controller
        return {
            "position_m": controller.motion.position,
            "moving": controller.motion.moving,
            "robot_mode": controller.robot_mode,
            "safety_mode": controller.safety_mode,
            "runtime_state": controller.runtime_state,
            "cycles": controller.cycles,
            "script_errors": controller.script_errors,
            "ignored_packets": self._rtde.ignored_packets,
            "messages": list(controller.messages)[-_SHOWN_MESSAGES:],
        }

    def _claim(self, request: FaultRequest) -> None:
        if unknown := [name for name in request.names if name not in INPUT_TYPES]:
            raise ValueError(f"no input {unknown[0]!r:.60}")
        self._rtde.claim(request.names, _STRANGER)

    def _wrench(self, request: FaultRequest) -> None:
        if len(request.value) != 6 or not all(map(math.isfinite, request.value)):
            raise ValueError("a wrench is six finite numbers")
        self._controller.apply_wrench(tuple(request.value))

    def _inputs(self, request: FaultRequest) -> None:
        if len(request.value) != 3 or not 0 <= request.value[0] < 1 << 18:
            raise ValueError("inputs are 18 bits and two finite numbers")
        bits, *analog = request.value
        self._controller.ports.digital_in = int(bits)
        self._controller.ports.analog_in = analog

    def _slider(self, request: FaultRequest) -> None:
        if not 0.0 <= request.fraction <= 1.0:
            raise ValueError("a fraction is within 0 and 1")
        self._controller.ports.set_speed(request.fraction)

    def _freeze(self, request: FaultRequest) -> None:
        if not 0.0 <= request.seconds <= _MAX_FREEZE_S:
            raise ValueError(f"seconds must be within 0 and {_MAX_FREEZE_S}")
        self._links.freeze(request.seconds)
