"""The dashboard server: one line in, one line out ("Dashboard Server" of the UR manuals)."""

from collections.abc import Callable

from drivers.ur.emulator.controller import Controller, RuntimeState
from drivers.ur.emulator.settings import EmulatorSettings

# the only program file there is: the one that the C++ client library's example loads
PROGRAMS = {"wait_program.urp": "def wait_program():\n while True:\n  sleep(1)\n end\nend\n"}
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
            "robotmode": lambda: f"Robotmode: {controller.robot_mode.name}",
            "safetymode": lambda: f"Safetymode: {controller.safety_mode.name}",
            "safetystatus": lambda: f"Safetystatus: {controller.safety_mode.name}",
            "programstate": self._program_state,
            "running": lambda: f"Program running: {str(self._playing).lower()}",
            "stop": self._stop,
            "play": self._play,
            "pause": self._pause,
            "power off": self._power_off,
            "get loaded program": self._loaded_program,
            "isprogramsaved": lambda: " ".join(("true", self._loaded)).strip(),
            "restart safety": self._restart_safety,
            "shutdown": lambda: self._refuse("shutdown"),
            "get operational mode": lambda: "NONE",
            "clear operational mode": lambda: "No longer controlling the operational mode",
            "is in remote control": self._remote,
            "version": lambda: ".".join(map(str, self._profile.version)),
            "savelog": lambda: "Log saved to disk",
            "quit": lambda: "Disconnected",
            "unlock protective stop": self._unlock,
            "close safety popup": lambda: "closing safety popup",
            "close popup": lambda: "closing popup",
            "power on": lambda: self._allowed(controller.power_on(), "Powering on"),
            "brake release": lambda: self._allowed(controller.release_brakes(), "Brake releasing"),
        }
        self._worded: dict[str, Callable[[str], str]] = {
            "load": self._load,
            "popup": lambda text: self._refuse("popup"),
            "addtolog": self._add_to_log,
        }
        self._loaded = ""

    def answer(self, line: str) -> str:
        """The answer without its line end."""
        text = " ".join(line.split())
        known = self._answers.get(text.lower())
        if known is not None:
            return known()
        word, _, rest = text.partition(" ")
        worded = self._worded.get(word.lower())
        return worded(rest) if worded and rest else f"could not understand: '{line.strip():.200}'"

    @property
    def _playing(self) -> bool:
        return self._controller.runtime_state is RuntimeState.PLAYING

    def _load(self, name: str) -> str:
        if name not in PROGRAMS:
            return f"File not found: {name[:200]}"
        self._loaded = name
        return f"Loading program: /programs/{name}"

    def _loaded_program(self) -> str:
        return f"Loaded program: /programs/{self._loaded}" if self._loaded else "No program loaded"

    def _play(self) -> str:
        if self._controller.runtime_state is RuntimeState.PAUSED:
            done = self._controller.resume_program()
        else:
            done = bool(self._loaded) and self._controller.ready
            if done:
                self._controller.load(PROGRAMS[self._loaded])
        return "Starting program" if done else "Failed to execute: play"

    def _pause(self) -> str:
        return "Pausing program" if self._controller.pause_program() else "Failed to execute: pause"

    def _power_off(self) -> str:
        self._controller.power_off()
        return "Powering off"

    def _restart_safety(self) -> str:
        self._controller.power_off()
        return "Restarting safety"

    def _add_to_log(self, text: str) -> str:
        self._controller.log(text)
        return "Added log message"

    def _refuse(self, what: str) -> str:
        self._controller.log(f"{what} is not emulated")
        return f"Failed to execute: {what}"

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
