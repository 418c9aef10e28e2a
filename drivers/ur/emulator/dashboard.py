"""The dashboard server: one line in, one line out ("Dashboard Server" of the UR manuals)."""

from collections.abc import Callable

from drivers.ur.emulator.controller import Controller, RuntimeState
from drivers.ur.emulator.settings import EmulatorSettings

BANNER = b"Connected: Universal Robots Dashboard Server\n"


class Dashboard:
    """Answers lines; shared by all connections."""

    def __init__(self, settings: EmulatorSettings, controller: Controller) -> None:
        self._profile = settings.controller
        self._controller = controller
        self._answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: self._profile.polyscope,
            "get serial number": lambda: settings.serial_number,
            "get robot model": lambda: "UR10",
            "is in remote control": self._remote,
            "robotmode": lambda: f"Robotmode: {controller.robot_mode.name}",
            "safetymode": lambda: f"Safetymode: {controller.safety_mode.name}",
            "safetystatus": lambda: f"Safetystatus: {controller.safety_mode.name}",
            "programstate": self._program_state,
            "running": lambda: f"Program running: {str(self._playing).lower()}",
            "stop": self._stop,
            "play": lambda: "Failed to execute: play",  # no program file is ever loaded here
            "unlock protective stop": self._unlock,
            "close safety popup": lambda: "closing safety popup",
            "close popup": lambda: "closing popup",
            "power on": lambda: self._allowed(controller.power_on(), "Powering on"),
            "brake release": lambda: self._allowed(controller.release_brakes(), "Brake releasing"),
        }

    def answer(self, line: str) -> str:
        """The answer without its line end."""
        command = " ".join(line.lower().split())
        known = self._answers.get(command)
        return known() if known else f"could not understand: '{line.strip()}'"

    @property
    def _playing(self) -> bool:
        return self._controller.runtime_state is RuntimeState.PLAYING

    def _remote(self) -> str:
        if not self._profile.has_remote_control:
            return "could not understand: 'is in remote control'"
        return str(self._controller.remote_control).lower()

    def _program_state(self) -> str:
        return f"{self._controller.runtime_state.name} <unnamed>"

    def _stop(self) -> str:
        self._controller.stop_program("dashboard")
        return "Stopped"

    def _unlock(self) -> str:
        if self._controller.unlock_protective_stop():
            return "Protective stop releasing"
        return (
            "Cannot unlock protective stop until 5s after occurrence. "
            "Always inspect cause of protective stop before unlocking"
        )

    def _allowed(self, done: bool, answer: str) -> str:
        return answer if done else "Failed: the emergency stop button is pressed"
