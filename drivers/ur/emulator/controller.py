"""Emulated controller: modes, safety, registers and the running program; time is an argument.

Reactions to safety stops are modelled, not measured. A protective stop pauses the program, and
unlocking it ends the program. An emergency stop ends the program and switches the arm off. States
and bits: "RTDE Guide".
"""

import functools
from collections import deque
from enum import IntEnum
from typing import Literal

import msgspec

from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.emulator.urscript import Program
from drivers.ur.emulator.urscript_functions import BUILTINS
from drivers.ur.emulator.urscript_parser import Script, parse
from drivers.ur.emulator.urscript_values import ScriptError
from drivers.ur.settings import ArmModelSettings

Scalar = int | float
Values = tuple[Scalar, ...]

REGISTERS = 48  # 0-23 for fieldbus and PLC, 24-47 for external RTDE clients
_KEPT_MESSAGES = 200
_MESSAGE_CHARS = 500


class Profile(msgspec.Struct, frozen=True):
    """Properties of one controller generation."""

    version: tuple[int, int, int, int]
    rate_hz: int
    e_series: bool  # with force sensor and remote control (PolyScope 5.6: Dashboard Server manual)

    @property
    def polyscope(self) -> str:
        return f"URSoftware {'.'.join(map(str, self.version))} (Aug 01 2022)"

    @property
    def period_ns(self) -> int:
        return 1_000_000_000 // self.rate_hz


PROFILES = {
    "cb3": Profile((3, 15, 8, 106339), 125, False),
    "e-series": Profile((5, 11, 1, 108318), 500, True),
}


class EmulatorSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of the emulated controller; its ports are those of a real one."""

    host: str
    token: str = ""  # of the control channel; only with a token may the host be beyond loopback
    profile: Literal["cb3", "e-series"] = "cb3"
    fault_port: int = 0  # port of the emulator's control channel; 0: any
    start_m: tuple[float, float, float] = ArmModelSettings().start_m
    unlock_delay_s: float = 5.0  # s after a protective stop; UR manual

    @property
    def controller(self) -> Profile:
        return PROFILES[self.profile]


class RobotMode(IntEnum):
    """robot_mode."""

    POWER_OFF = 3
    IDLE = 5
    RUNNING = 7


class SafetyMode(IntEnum):
    """safety_mode."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    ROBOT_EMERGENCY_STOP = 7


class RuntimeState(IntEnum):
    """runtime_state."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


class Registers:
    """General purpose registers, inputs and outputs."""

    def __init__(self) -> None:
        self.values: dict[tuple[str, str], list[Scalar]] = {
            (direction, kind): [nothing] * REGISTERS
            for direction in ("input", "output")
            for kind, nothing in (("int", 0), ("double", 0.0))
        }

    def read(self, direction: str, kind: str, address: object) -> Scalar:
        return self.values[direction, kind][_checked(address)]

    def write(self, kind: str, address: object, value: Scalar) -> None:
        self.values["output", kind][_checked(address)] = value

    def take_input(self, name: str, values: Values) -> None:
        """Store an input by its RTDE name; names that are not a register are ignored."""
        register, _, address = name.partition("_register_")
        direction, _, kind = register.partition("_")
        if (direction, kind) in self.values and address.isdigit():
            self.values[direction, kind][int(address)] = values[0]


def _checked(address: object) -> int:
    if not isinstance(address, int) or not 0 <= address < REGISTERS:
        raise ScriptError(f"no register {address!r:.60}")
    return address


@functools.lru_cache(maxsize=8)
def _program(text: str) -> Script:
    """Translated program, cached because a client sends the same text at each connection."""
    return parse(text, BUILTINS)


class Controller:
    """Model of the controller; ``step`` runs one of its cycles."""

    def __init__(self, settings: EmulatorSettings, motion: RobotMotion, now_ns: int) -> None:
        self.period_s = settings.controller.period_ns * 1e-9
        self.motion = motion
        self.registers = Registers()
        self.speed_fraction = 1.0  # of the speed slider
        self.payload_kg = 0.0
        self.payload_cog_m: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.robot_mode = RobotMode.RUNNING
        self.safety_mode = SafetyMode.NORMAL
        self.runtime_state = RuntimeState.STOPPED
        self.remote_control = True
        self._has_remote_control = settings.controller.e_series
        self._emergency_button = False
        self.cycles = 0
        self.script_errors = 0
        self.messages: deque[str] = deque(maxlen=_KEPT_MESSAGES)
        self._unlock_ns = round(settings.unlock_delay_s * 1e9)
        self._stopped_ns = now_ns
        self._now_ns = now_ns
        self._program: Program | None = None
        self._watchdog: tuple[str, int] | None = None  # name of the input, and its longest interval
        self._kicked_ns = now_ns

    def step(self, now_ns: int, inputs: dict[str, Values]) -> None:
        """Run one cycle: read the inputs, update the arm's state, run the program."""
        self._now_ns = now_ns
        self.cycles += 1
        for name, values in inputs.items():
            self.registers.take_input(name, values)
        if int(inputs.get("speed_slider_mask", (0,))[0]) & 1:
            self.set_speed_slider(float(inputs.get("speed_slider_fraction", (1.0,))[0]))
        self.motion.set_speed_slider(self.speed_fraction)
        problem = self.motion.update(now_ns)
        if self.ready and problem:
            self.log(problem)
        if self.ready and (problem or self.motion.tripped):
            self.protective_stop()
        self._check_watchdog(inputs)
        if self.runtime_state is RuntimeState.PLAYING:
            self._run()
        self.motion.brake_if_unowned()

    def _check_watchdog(self, inputs: dict[str, Values]) -> None:
        """End the program when the watchdog's input was not written in time."""
        if self._watchdog is None:
            return
        name, longest_ns = self._watchdog
        if name in inputs:
            self._kicked_ns = self._now_ns
        elif self._now_ns - self._kicked_ns > longest_ns:
            self.stop_program(f"watchdog on {name}")

    def _run(self) -> None:
        if self._program is None:
            return
        try:
            if not self._program.step():
                self.stop_program("program ended")
        except ScriptError as error:
            self.script_errors += 1
            self.stop_program(f"script error: {error}")

    def set_speed_slider(self, fraction: float) -> None:
        """Set the speed slider; invalid values have no effect."""
        if 0.0 <= fraction <= 1.0:
            self.speed_fraction = fraction

    def log(self, message: str) -> None:
        self.messages.append(f"{self.cycles}: {message[:_MESSAGE_CHARS]}")

    # program

    def load(self, text: str) -> None:
        """Load and start a program from the next cycle on; an invalid one only ends the old one."""
        if not self.remote_control:
            self.log("program refused: not in remote control")
            return
        self.stop_program("replaced")
        if not self.ready:
            self.log("program refused: the robot is not ready")
            return
        try:
            self._program = Program(_program(text), self)
            self.runtime_state = RuntimeState.PLAYING
        except ScriptError as error:
            self.script_errors += 1
            self.log(f"script error: {error}")

    @property
    def ready(self) -> bool:
        """Whether a program may start."""
        return self.robot_mode is RobotMode.RUNNING and self.safety_mode is SafetyMode.NORMAL

    def stop_program(self, why: str) -> None:
        if self._program is not None:
            self.log(f"{self._program.name} stopped: {why}")
            self._program.close()
        self._program = None
        self._watchdog = None
        self.runtime_state = RuntimeState.STOPPED

    def set_watchdog(self, name: str, frequency_hz: float) -> None:
        self._watchdog = name, round(1e9 / frequency_hz)
        self._kicked_ns = self._now_ns

    def set_payload(self, mass_kg: float, cog_m: tuple[float, ...]) -> None:
        self.payload_kg, self.payload_cog_m = mass_kg, cog_m
        self.motion.set_payload(mass_kg)

    # safety and power

    def protective_stop(self) -> None:
        if self.safety_mode is not SafetyMode.NORMAL:
            return
        self.log("protective stop")
        self.safety_mode = SafetyMode.PROTECTIVE_STOP
        self._stopped_ns = self._now_ns
        self.motion.trip()
        if self._program is not None:
            self.runtime_state = RuntimeState.PAUSED

    def unlock_protective_stop(self) -> bool:
        """Unlock; False within the first seconds, as on the real controller."""
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return True
        if self._now_ns - self._stopped_ns < self._unlock_ns:
            return False
        self.safety_mode = SafetyMode.NORMAL
        self.stop_program("protective stop unlocked")
        self.motion.release()
        return True

    def emergency_stop(self, pressed: bool) -> None:
        """Press or release the emergency button; after release the arm must be powered on again."""
        self._emergency_button = pressed
        if pressed:
            self.log("emergency stop")
            self.safety_mode = SafetyMode.ROBOT_EMERGENCY_STOP
            self.power_off()

    def power_off(self) -> None:
        self.motion.trip()
        self.stop_program("power off")
        self.robot_mode = RobotMode.POWER_OFF

    def power_on(self) -> bool:
        """Power on; False while the emergency button is pressed."""
        if self._emergency_button:
            return False
        if self.robot_mode is RobotMode.POWER_OFF:
            self.safety_mode = SafetyMode.NORMAL
            self.robot_mode = RobotMode.IDLE
            self.motion.release()
        return True

    def release_brakes(self) -> bool:
        if self.robot_mode is RobotMode.POWER_OFF and not self.power_on():
            return False
        self.robot_mode = RobotMode.RUNNING
        return True

    def check_remote_control(self) -> None:
        """Raises ValueError for a controller without remote control mode."""
        if not self._has_remote_control:
            raise ValueError("a CB3 (PolyScope 3) has no remote control mode; an e-Series has")

    def set_remote_control(self, on: bool) -> None:
        """Switch the pendant to Remote or Local; Local ends the program (assumed). Raises
        ValueError as ``check_remote_control``."""
        self.check_remote_control()
        if self.remote_control and not on:
            self.stop_program("local control")
        self.remote_control = on
