"""The emulated controller: modes, safety, registers and the running program; time is an argument.

What a real controller does at a stop by safety is modelled, not measured: a protective stop pauses
the program and unlocking it ends the program; an emergency stop ends the program and switches the
arm off. States and bits: "RTDE Guide".
"""

from collections import deque
from enum import IntEnum

from drivers.ur.emulator.compiling import Compilation
from drivers.ur.emulator.motion import RobotMotion
from drivers.ur.emulator.ports import Ports
from drivers.ur.emulator.rtde_wire import BITS, REGISTERS, Scalar, Values
from drivers.ur.emulator.settings import EmulatorSettings
from drivers.ur.emulator.urscript.builtins import BUILTINS
from drivers.ur.emulator.urscript.parse import ScriptError, is_secondary
from drivers.ur.emulator.urscript.run import Compiled, Program

_KINDS: tuple[tuple[str, Scalar, int], ...] = (
    ("int", 0, REGISTERS),
    ("double", 0.0, REGISTERS),
    ("bit", False, BITS),
)
_BIT_WORDS = {"bit_registers0_to_31": 0, "bit_registers32_to_63": 32}
_KEPT_MESSAGES = 200
_MESSAGE_CHARS = 500


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
    """General purpose registers of both directions."""

    def __init__(self) -> None:
        self.values: dict[tuple[str, str], list[Scalar]] = {
            (direction, kind): [nothing] * count
            for direction in ("input", "output")
            for kind, nothing, count in _KINDS
        }

    def read(self, direction: str, kind: str, address: object) -> Scalar:
        return _of(self.values[direction, kind], address)

    def write(self, kind: str, address: object, value: Scalar) -> None:
        _of(self.values["output", kind], address)
        self.values["output", kind][int(address)] = value  # type: ignore[call-overload]

    def take_input(self, name: str, values: Values) -> None:
        """Store an input by its RTDE name; names that are no register are ignored."""
        direction, _, rest = name.partition("_")
        if rest in _BIT_WORDS:
            first, word = _BIT_WORDS[rest], int(values[0])
            self.values["input", "bit"][first : first + 32] = [word >> n & 1 for n in range(32)]
        kind, _, address = rest.partition("_register_")
        if (direction, kind) in self.values and address.isdigit():
            self.values[direction, kind][int(address)] = values[0]


def _of(values: list[Scalar], address: object) -> Scalar:
    if not isinstance(address, int) or not 0 <= address < len(values):
        raise ScriptError(f"no register {address!r:.60}")
    return values[address]


class Watchdog:
    """Ends the program when its input has not been written for 1 / frequency."""

    def __init__(self, name: str, frequency_hz: float, now_ns: int) -> None:
        self.name = name
        self._limit_ns = round(1e9 / frequency_hz)
        self._last_ns = now_ns

    def kick(self, now_ns: int) -> None:
        self._last_ns = now_ns

    def expired(self, now_ns: int) -> bool:
        return now_ns - self._last_ns > self._limit_ns


class Controller:
    """One controller; ``step`` is one of its cycles."""

    def __init__(self, settings: EmulatorSettings, motion: RobotMotion, now_ns: int) -> None:
        self.period_s = settings.controller.period_ns * 1e-9
        self.motion = motion
        self.registers = Registers()
        self.ports = Ports()
        self.payload_kg = 0.0
        self.payload_cog_m: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.robot_mode = RobotMode.RUNNING
        self.safety_mode = SafetyMode.NORMAL
        self.runtime_state = RuntimeState.STOPPED
        self.remote_control = True
        self._has_remote_control = settings.controller.has_remote_control
        self.emergency_button = False
        self.cycles = 0
        self.script_errors = 0
        self.messages: deque[str] = deque(maxlen=_KEPT_MESSAGES)
        self._unlock_ns = round(settings.unlock_delay_s * 1e9)
        self._stopped_ns = now_ns
        self._now_ns = now_ns
        self._program: Program | None = None
        self._watchdog: Watchdog | None = None
        self._compilation = Compilation(BUILTINS)
        self._true_wrench: tuple[float, ...] = (0.0,) * 6
        self._zero_wrench: tuple[float, ...] = (0.0,) * 6

    def step(self, now_ns: int, inputs: dict[str, Values], wait: bool = True) -> None:
        """One cycle: take the inputs, renew the arm's state, run the program. ``wait`` for a
        compilation."""
        self._now_ns = now_ns
        self.cycles += 1
        for name, values in inputs.items():
            self.registers.take_input(name, values)
        self.ports.take_inputs(inputs)
        self.motion.turn_slider(self.ports.speed_fraction)
        trouble = self.motion.update(now_ns)
        powered = self.robot_mode is RobotMode.RUNNING and self.safety_mode is SafetyMode.NORMAL
        if powered and trouble:
            self.log(trouble)
        if powered and (trouble or self.motion.tripped):
            self.protective_stop()
        self._watch(inputs)
        self._work(wait)
        self.motion.brake_if_unowned()

    def _work(self, wait: bool) -> None:
        if compiled := self._compilation.take(wait):
            self._start(compiled)
        if self.runtime_state is RuntimeState.PLAYING:
            self._run()

    def skip(self, cycles: int) -> None:
        """Cycles that nobody had the time to run."""
        self.cycles += cycles

    def _watch(self, inputs: dict[str, Values]) -> None:
        if self._watchdog is None:
            return
        if self._watchdog.name in inputs:
            self._watchdog.kick(self._now_ns)
        elif self._watchdog.expired(self._now_ns):
            self.stop_program(f"watchdog on {self._watchdog.name}")

    def _run(self) -> None:
        if self._program is None:
            return
        try:
            if not self._program.step():
                self.stop_program("program ended")
        except ScriptError as error:
            self.script_errors += 1
            self.stop_program(f"script error: {error}")

    def script_error(self, error: ScriptError) -> None:
        """Of a program that does not run."""
        self.script_errors += 1
        self.log(f"script error: {error}")

    # program

    def load(self, text: str) -> None:
        """Replace the program; one that does not compile leaves the controller without any. A new
        one starts in one of the next cycles, once it is compiled."""
        if is_secondary(text):
            self.log("program refused: secondary programs are not emulated")
            return
        self.stop_program("replaced")
        if self.ready:
            self._compilation.begin(text)
        else:
            self.log("program refused: the robot is not ready")

    @property
    def ready(self) -> bool:
        """A program may start."""
        return self.robot_mode is RobotMode.RUNNING and self.safety_mode is SafetyMode.NORMAL

    def _start(self, compiled: Compiled | ScriptError) -> None:
        if isinstance(compiled, ScriptError):
            self.script_error(compiled)
        elif self.ready:
            self._program = Program(compiled, self)
            self.runtime_state = RuntimeState.PLAYING

    def stop_program(self, why: str) -> None:
        self._compilation.cancel()
        if self._program is not None:
            self.log(f"{self._program.name} stopped: {why}")
            self._program.close()
        self._program = None
        self._watchdog = None
        self.runtime_state = RuntimeState.STOPPED

    def set_watchdog(self, name: str, frequency_hz: float) -> None:
        self._watchdog = Watchdog(name, frequency_hz, self._now_ns)

    def log(self, message: str) -> None:
        self.messages.append(f"{self.cycles}: {message[:_MESSAGE_CHARS]}")

    def close(self) -> None:
        self.stop_program("the emulator ends")
        self._compilation.close()

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
        """False within the first seconds, as on the controller."""
        if self.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return True
        if self._now_ns - self._stopped_ns < self._unlock_ns:
            return False
        self.safety_mode = SafetyMode.NORMAL
        self.stop_program("protective stop unlocked")
        self.motion.release()
        return True

    def emergency_stop(self, pressed: bool) -> None:
        """The button; releasing it is not enough to run again, the arm must be powered on."""
        self.emergency_button = pressed
        if not pressed:
            return
        self.log("emergency stop")
        self.safety_mode = SafetyMode.ROBOT_EMERGENCY_STOP
        self.robot_mode = RobotMode.POWER_OFF
        self.motion.trip()
        self.stop_program("emergency stop")

    def check_remote_control(self) -> None:
        """Raises ValueError where no pendant can be turned to Local."""
        if not self._has_remote_control:
            raise ValueError(
                "a CB3 (PolyScope 3) has no remote and no local control: e-Series alone"
            )

    def set_remote_control(self, on: bool) -> None:
        """The pendant, turned to Remote or Local. That Local ends the program is assumed. Raises
        ValueError as ``check_remote_control``."""
        self.check_remote_control()
        if self.remote_control and not on:
            self.stop_program("local control")
        self.remote_control = on

    def power_off(self) -> None:
        self.motion.trip()
        self.stop_program("power off")
        self.robot_mode = RobotMode.POWER_OFF

    def pause_program(self) -> bool:
        """False where none plays, or where the arm is in a motion: that is not emulated."""
        if self.runtime_state is not RuntimeState.PLAYING or self.motion.moving:
            self.log("pause refused: no program plays, or the arm moves")
            return False
        self.runtime_state = RuntimeState.PAUSED
        return True

    def resume_program(self) -> bool:
        """False where none is paused, or the robot is not ready."""
        if self._program is None or self.safety_mode is not SafetyMode.NORMAL:
            return False
        self.runtime_state = RuntimeState.PLAYING
        return True

    def power_on(self) -> bool:
        if self.emergency_button:
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

    # what the program sets

    def set_payload(self, mass_kg: float, cog_m: tuple[float, ...]) -> None:
        self.payload_kg, self.payload_cog_m = mass_kg, cog_m
        self.motion.set_payload(mass_kg)

    def zero_wrench(self) -> None:
        self._zero_wrench = self._true_wrench

    def apply_wrench(self, wrench: tuple[float, ...]) -> None:
        """Force and torque on the tool, N and Nm."""
        self._true_wrench = wrench

    @property
    def wrench(self) -> tuple[float, ...]:
        """What the force sensor shows."""
        return tuple(a - b for a, b in zip(self._true_wrench, self._zero_wrench, strict=True))

    @property
    def raw_wrench(self) -> tuple[float, ...]:
        return self._true_wrench
