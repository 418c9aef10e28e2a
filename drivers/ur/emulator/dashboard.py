"""Dashboard server, and the emulator's control channel: one line in, one line out.

Commands and replies of the dashboard: "Dashboard Server" of the UR manuals. The control channel is
not part of any UR interface. It injects faults; each message is a line with a JSON object. Where
the emulator is reachable beyond loopback, a request needs its ``token``. A request is
``{"do": verb, ...}``, the reply ``{"ok": true, ...}`` or ``{"ok": false, "error": text}``. Verbs:

- ``state``: position, modes, counters and the last messages
- ``protective_stop``; ``emergency_stop`` with ``pressed`` (default true); ``kill_program``
- ``remote_control`` with ``on`` (e-Series only); ``claim`` with ``names`` (RTDE inputs claimed by
  another client), ``unclaim``
- ``speed_slider`` with ``fraction``, 0 to 1: sets the slider as on the pendant
- ``drop_link``: close every UR connection; ``freeze`` with ``seconds``: serve nothing for so long
"""

import secrets
from collections.abc import Callable
from typing import Any, Protocol

import msgspec

from drivers.ur.emulator.controller import Controller, EmulatorSettings, RuntimeState
from drivers.ur.emulator.rtde import INPUTS, RtdeServer

BANNER = b"Connected: Universal Robots Dashboard Server\n"
_SERIAL_NUMBER = "2015300001"
_OTHER_CLIENT = object()  # owner of the inputs that ``claim`` takes
_MAX_FREEZE_S = 60.0
_SHOWN_MESSAGES = 20


class Dashboard:
    """Replies to dashboard commands; shared by all connections."""

    def __init__(self, settings: EmulatorSettings, controller: Controller) -> None:
        profile = settings.controller
        self._controller = c = controller
        self._replies: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: profile.polyscope,
            "get serial number": lambda: _SERIAL_NUMBER,
            "get robot model": lambda: "UR10",
            "robotmode": lambda: f"Robotmode: {c.robot_mode.name}",
            "safetymode": lambda: f"Safetymode: {c.safety_mode.name}",
            "safetystatus": lambda: f"Safetystatus: {c.safety_mode.name}",
            "programstate": lambda: f"{c.runtime_state.name} <unnamed>",
            "running": self._running,
            "stop": self._stop,
            "power off": self._power_off,
            "power on": lambda: _allowed(c.power_on(), "Powering on"),
            "brake release": lambda: _allowed(c.release_brakes(), "Brake releasing"),
            "unlock protective stop": self._unlock,
            "close safety popup": lambda: "closing safety popup",
            "quit": lambda: "Disconnected",
        }
        if profile.e_series:
            self._replies["is in remote control"] = lambda: str(c.remote_control).lower()

    def reply(self, line: str) -> str:
        """Reply to one command, without line end."""
        known = self._replies.get(" ".join(line.split()).lower())
        return known() if known else f"could not understand: '{line.strip():.200}'"

    def _running(self) -> str:
        playing = self._controller.runtime_state is RuntimeState.PLAYING
        return f"Program running: {str(playing).lower()}"

    def _stop(self) -> str:
        self._controller.stop_program("dashboard")
        return "Stopped"

    def _power_off(self) -> str:
        self._controller.power_off()
        return "Powering off"

    def _unlock(self) -> str:
        if self._controller.unlock_protective_stop():
            return "Protective stop releasing"
        return (
            "Cannot unlock protective stop until 5s after occurrence. "
            "Always inspect cause of protective stop before unlocking"
        )


def _allowed(done: bool, reply: str) -> str:
    return reply if done else "Failed: the emergency stop button is pressed"


class Links(Protocol):
    """Operations of the fault channel on connections."""

    def drop_links(self) -> None: ...

    def freeze(self, seconds: float) -> None: ...


class FaultRequest(msgspec.Struct, forbid_unknown_fields=True):
    """Request of the fault channel: one line."""

    do: str
    token: str = ""
    pressed: bool = True
    on: bool = True
    names: list[str] = []
    seconds: float = 0.0
    fraction: float = 1.0


class FaultChannel:
    """Executes requests of the fault channel."""

    def __init__(
        self, controller: Controller, rtde: RtdeServer, links: Links, token: str = ""
    ) -> None:
        self._token = token.encode()
        self._controller = controller
        self._rtde = rtde
        self._verbs: dict[str, Callable[[FaultRequest], None]] = {
            "state": lambda request: None,
            "protective_stop": lambda request: controller.protective_stop(),
            "emergency_stop": lambda request: controller.emergency_stop(request.pressed),
            "kill_program": lambda request: controller.stop_program("killed by request"),
            "remote_control": lambda request: controller.set_remote_control(request.on),
            "claim": self._claim,
            "unclaim": lambda request: rtde.release(_OTHER_CLIENT),
            "speed_slider": lambda request: controller.set_speed_slider(
                _within("fraction", request.fraction, 1.0)
            ),
            "drop_link": lambda request: links.drop_links(),
            "freeze": lambda request: links.freeze(
                _within("seconds", request.seconds, _MAX_FREEZE_S)
            ),
        }

    def reply(self, line: str) -> str:
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
        if unknown := [name for name in request.names if name not in INPUTS]:
            raise ValueError(f"no input {unknown[0]!r:.60}")
        self._rtde.claim(request.names, _OTHER_CLIENT)


def _within(what: str, value: float, most: float) -> float:
    if not 0.0 <= value <= most:
        raise ValueError(f"{what} must be within 0 and {most:g}")
    return value
