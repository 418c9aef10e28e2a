"""Fault injection between a driver and its device's model: changes bytes, registers and samples as
the driver sees them, independent of controller, guard and loop.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import SlipDetector
from drivers.errors import LinkLost
from drivers.interfaces import FINGERS, Vector3
from drivers.robotiq.driver import RegisterTransport
from drivers.takktile.model.board import BoardModel
from drivers.takktile.receiver import Transfer, UsbBoard
from drivers.ur.driver import ArmSample
from drivers.ur.model import ArmModel
from grasp.control.guard import GuardSettings
from grasp.run.clock import Clock
from tests.nightly.faults.cases import AXES, RECOVERS_NS, TAXELS, Description, Fault
from tests.nightly.faults.registers import COMMAND_FIELDS, FIELDS, IMAGES, verb, wrong

Codes = NDArray[np.int16]
_FOR_EVER = 1 << 62
BLINK_NS = 80_000_000  # down time, and up time, of a blinking link
FLICKER_NS = 40_000_000  # between two changes of a flickering value
WATCHDOG_NS = 100_000_000  # time-out of the arm controller's watchdog, which stops the program
HEARTBEAT_NS = 200_000_000  # time without a client's message after which the arm is stopped
PROGRAM_END_MPS2 = 1.2  # assumed: equal to the acceleration of moves
AGAIN_NS = 100_000_000  # from one write of another client to the next
PAD_CODES = {"finger A": slice(0, 6), "finger B": slice(6, 12), "finger C": slice(12, 18),
             "temperatures": slice(0, 18)}  # fmt: skip
PAD_CODES |= {taxel: slice(i, i + 1) for i, taxel in enumerate(TAXELS)}
RAIL, SHIFT = 1023, 150  # codes
STICKS_N = 15.5  # reading of a fingertip that sticks high, at the default counts per newton
# codes a second, of one taxel or shared by those of a finger, like a growing pressure
DRIFT_PS = 60.0
COUNTS_PER_N = GuardSettings().counts_per_newton
WIDTH = 6  # bits below a code in its word


class InjectedFault(msgspec.Struct):
    """A fault since its injection."""

    fault: Fault
    since_ns: int
    recovers: bool
    times: int = 0  # commands that it suppressed so far
    took_ns: int = -1  # the last of them

    def on(self, now_ns: int) -> bool:
        """Whether a fault of a state, link or detector is active at this time."""
        end_ns = self.since_ns + RECOVERS_NS if self.recovers else _FOR_EVER
        return self.since_ns <= now_ns < end_ns

    def flickers(self, now_ns: int) -> bool:
        """Whether a flickering value is wrong at this time."""
        return (now_ns - self.since_ns) // FLICKER_NS % 2 == 0

    def gone(self, now_ns: int) -> bool:
        """Whether a link is down at this time."""
        if not self.on(now_ns):
            return False
        blink = (now_ns - self.since_ns) // BLINK_NS % 2 == 0
        return self.fault.kind == "cut" or blink

    def takes(self, what: str, now_ns: int) -> bool:
        """Whether it suppresses this command; a fault that recovers suppresses only one."""
        if self.fault.what != what or now_ns < self.since_ns or (self.recovers and self.times):
            return False
        self.times += 1
        self.took_ns = now_ns
        return True


class Wire:
    """The faults of one device; ``injected`` is what has injected so far."""

    def __init__(self) -> None:
        self.injected: list[InjectedFault] = []
        self.commands: list[str] = []  # commands, in their order

    def links(self) -> list[InjectedFault]:
        return [s for s in self.injected if s.fault.part == "link"]

    def gone(self, now_ns: int) -> bool:
        return any(s.gone(now_ns) for s in self.links())

    def active_state_faults(self, now_ns: int) -> list[InjectedFault]:
        return [s for s in self.injected if s.fault.part == "state" and s.on(now_ns)]

    def taken(self, what: str, now_ns: int) -> bool:
        """Whether a fault takes this command."""
        self.commands.append(what)
        return any(s.fault.part == "command" and s.takes(what, now_ns) for s in self.injected)


class HandWire(Wire):
    """Registers of the gripper, both ways."""

    def __init__(self) -> None:
        super().__init__()
        self._inner: Any = None
        self._kept: dict[int, int] = {}
        self._here: tuple[int, ...] = (0, 0, 0)  # last reported positions, counts
        self._image: tuple[int, ...] = (0,) * 8  # last commanded registers

    def around(self, transport: RegisterTransport) -> RegisterTransport:
        self._inner = transport
        return self

    def write(self, first: int, registers: Sequence[int], now_ns: int) -> None:
        self._reach(now_ns)
        words = tuple(registers)
        self._image = (*self._image[:first], *words, *self._image[first + len(words) :])
        if not self.taken(verb(first, words, self._here), now_ns):
            self._inner.write(first, words, now_ns)

    def read(self, first: int, count: int, now_ns: int) -> Sequence[int]:
        self._reach(now_ns)
        words = tuple(self._inner.read(first, count, now_ns))
        for active in self.active_state_faults(now_ns):
            words = self._altered(active, words, now_ns)
        if first == 0 and len(words) == 8:
            self._here = tuple(FIELDS[name].of(words) for name in ("gPOA", "gPOB", "gPOC"))
        return words

    def tick(self, now_ns: int) -> None:
        """Write as another client, once or repeatedly, bypassing the link."""
        for s in self.injected:
            again = not s.times or (not s.recovers and now_ns >= s.took_ns + AGAIN_NS)
            if s.fault.part == "registers" and again:
                s.times, s.took_ns = s.times + 1, now_ns
                self._inner.write(*self._written(s.fault), now_ns)

    def _written(self, fault: Fault) -> tuple[int, tuple[int, ...]]:
        what = fault.kind.partition(" ")[0]
        if fault.what not in COMMAND_FIELDS:
            return 0, IMAGES[what]
        field = COMMAND_FIELDS[fault.what]
        words = field.set(self._image, 0 if what == "cleared" else field.most)
        return field.word, words[field.word : field.word + 1]

    def _reach(self, now_ns: int) -> None:
        if self.gone(now_ns):
            raise LinkLost(
                "the gripper does not answer", "check its power, cable and address; then try again"
            )

    def _altered(
        self, active: InjectedFault, words: tuple[int, ...], now_ns: int
    ) -> tuple[int, ...]:
        field, kind = FIELDS[active.fault.what], active.fault.kind
        if kind == "frozen":
            value = self._kept.setdefault(id(active), field.of(words))
        elif kind == "missing" or (kind == "flickers" and active.flickers(now_ns)):
            value = 0
        elif kind == "flickers":
            value = field.of(words)
        else:
            value = wrong(active.fault.what, kind, field.of(words))
        return field.set(words, value)


NOTHING: dict[str, Any] = {
    "t_ns": 0, "position_m": (0.0, 0.0, 0.0), "velocity_mps": (0.0, 0.0, 0.0), "moving": False,
    "protective_stop": False, "angle_rad": 0.0, "spin_radps": 0.0, "speed_fraction": 0.0,
}  # fmt: skip
JUMPS = {"t_ns": 1_000_000_000, "position_m": 0.05, "velocity_mps": 0.2, "angle_rad": 0.5,
         "spin_radps": 0.5, "speed_fraction": -0.6}  # fmt: skip
BEYOND = {"t_ns": -(1 << 40), "position_m": 99.0, "velocity_mps": 50.0, "angle_rad": 100.0,
          "spin_radps": 100.0, "speed_fraction": 100.0}  # fmt: skip


def with_number(value: Any, axis: str, number: float, add: bool = False) -> Any:
    """The value with this number, or with it added; of a vector only one axis."""
    if not axis:
        return value + number if add else number
    i = AXES.index(axis)
    return (*value[:i], value[i] + number if add else number, *value[i + 1 :])


class ArmWire(Wire):
    """The arm's controller as its driver sees it, with the watchdogs of a real one."""

    def __init__(self) -> None:
        super().__init__()
        self._model: Any = None
        self._kept: dict[int, Any] = {}
        self._expired: set[int] = set()
        self.clock: Clock | None = None

    def around(self, model: ArmModel) -> "ArmWire":
        self._model = model
        return self

    def move_l(
        self, target_m: Vector3, speed_mps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        return self._command("move", "move_l", (target_m, speed_mps, acceleration_mps2), now_ns)

    def speed_l(
        self, velocity_mps: Vector3, spin_radps: float, acceleration_mps2: float, now_ns: int
    ) -> bool:
        return self._command(
            "move", "speed_l", (velocity_mps, spin_radps, acceleration_mps2), now_ns
        )

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        self._command("stop", "stop_l", (deceleration_mps2,), now_ns)

    def set_payload(self, mass_kg: float) -> None:
        self._model.set_payload(mass_kg)

    def read(self, now_ns: int) -> ArmSample:
        self._reach(now_ns)
        sample: ArmSample = self._model.read(now_ns)
        for active in self.active_state_faults(now_ns):
            sample = self._altered(active, sample, now_ns)
        return sample

    def watch(self, now_ns: int) -> None:
        """Let the watchdog of a cut link stop the program."""
        for cut in self.links():
            bites = cut.gone(now_ns) and cut.fault.kind == "cut"
            if bites and now_ns - cut.since_ns >= WATCHDOG_NS and id(cut) not in self._expired:
                self._expired.add(id(cut))
                self.stop_program(now_ns)

    def stop_program(self, now_ns: int) -> None:
        """Stop the program, as without a client."""
        self._model.stop_l(PROGRAM_END_MPS2, now_ns)

    def _reach(self, now_ns: int) -> None:
        self.watch(now_ns)
        if self.gone(now_ns):
            raise LinkLost(
                "link to the arm lost: the arm controller sends no data any more",
                "check its power and network; then start the run again",
            )

    def _command(self, what: str, name: str, words: tuple[Any, ...], now_ns: int) -> bool:
        """Pass a command. The driver's time is that of its last sample, which is old after a pause
        of the loop, so the command starts at the current time."""
        if self.clock is not None:
            now_ns = max(now_ns, self.clock.now_ns)
        self._reach(now_ns)
        return self.taken(what, now_ns) or getattr(self._model, name)(*words, now_ns) is not False

    def _altered(self, active: InjectedFault, sample: ArmSample, now_ns: int) -> ArmSample:
        (name, _, axis), kind = active.fault.what.partition(" "), active.fault.kind
        true = getattr(sample, name)
        if kind == "frozen":
            value = self._kept.setdefault(id(active), true)
        elif kind == "missing":
            value = NOTHING[name]
        elif kind == "flickers":
            value = true is not active.flickers(now_ns)
        elif kind == "not a number":
            value = with_number(true, axis, float("nan"))
        elif kind == "out of range":
            value = with_number(true, axis, BEYOND[name])
        else:
            said = isinstance(true, bool)
            value = not true if said else with_number(true, axis, JUMPS[name], add=True)
        return msgspec.structs.replace(sample, **{name: value})


def coded(frame: bytes) -> Codes:
    """(cells, 2) words of pressure and temperature."""
    return np.frombuffer(frame, ">u2").astype(np.int16).reshape(-1, 2)


class PadWire(Wire):
    """Transfers of the tactile board. Link faults are injected at the board, which can be unplugged
    or delay a read."""

    def __init__(self) -> None:
        super().__init__()
        self._usb: Any = None
        self._kept: dict[int, Codes] = {}
        self._board: Any = None
        self._rest: Codes | None = None  # codes of the first transfer, which nothing loads
        self._noise = np.random.default_rng(0)
        self.description: Description | None = None

    def around(self, usb: UsbBoard) -> "PadWire":
        self._usb = usb
        return self

    def of(self, board: BoardModel) -> None:
        """The board behind the link."""
        self._board = board

    @property
    def serial(self) -> str:
        return str(self._usb.serial)

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        return bytes(self._usb.control(request, value, index, length, now_ns))

    def clear_halt(self) -> None:
        self._usb.clear_halt()

    def close(self) -> None:
        self._usb.close()

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        transfer: Transfer | None = self._usb.bulk_read(size, now_ns)
        if transfer is None:
            return None
        words = None
        if self._rest is None and 2 * coded(transfer.data).size == len(transfer.data):
            self._rest = _codes(coded(transfer.data)[:, 0])
        if self.description is not None:
            words = self._as_described(coded(transfer.data), self.description)
        for active in self.active_state_faults(now_ns):
            words = coded(transfer.data) if words is None else words
            if 2 * words.size == len(transfer.data):  # no other fault has shortened it
                words = self._altered(active, words, now_ns)
        if words is None:
            return transfer
        return Transfer(words.astype(">u2").tobytes(), transfer.done_ns)

    def _as_described(self, words: Codes, wrong: Description) -> Codes:
        """The words of fingertips in another order that read another share of a force."""
        out, codes = words.copy(), _codes(words[:, 0])
        rest = codes if self._rest is None else self._rest
        read = np.rint(rest + wrong.gain * (codes - rest)).reshape(FINGERS, -1)[list(wrong.order)]
        out[:, 0] = _words(read.ravel())
        return out

    def tick(self, now_ns: int) -> None:
        """Inject faults of the link at the board."""
        for s in self.links():
            if s.fault.kind == "cut" and s.gone(now_ns) and self._board.plugged:
                self._board.unplug()
            elif s.fault.kind == "cut" and not s.on(now_ns) and not self._board.plugged:
                self._board.replug()
            elif s.fault.kind == "blinking" and s.gone(now_ns):
                into_ns = (now_ns - s.since_ns) % BLINK_NS
                self._board.silence(now_ns + BLINK_NS - into_ns)

    def _altered(self, active: InjectedFault, words: Codes, now_ns: int) -> Codes:
        """The words with faulty values of pressure (column 0) or temperature (column 1)."""
        kind, cells = active.fault.kind, PAD_CODES[active.fault.what]
        column = int(active.fault.what == "temperatures")
        out = words.copy()
        if kind == "missing":
            return np.delete(out, range(len(out))[cells], axis=0)
        true = out[cells, column]
        if kind == "frozen":
            true = self._kept.setdefault(id(active), true.copy())
        else:
            codes = _codes(true)
            if kind == "sticks high" and self._rest is not None:
                noise = np.rint(self._noise.normal(0.0, 0.65, len(codes))).astype(np.int32)
                codes = self._rest[cells] - round(STICKS_N * COUNTS_PER_N / len(codes)) + noise
            elif kind == "drifts":
                codes = codes - round(DRIFT_PS / len(codes) * (now_ns - active.since_ns) * 1e-9)
            else:
                codes = np.full_like(codes, RAIL) if kind == "out of range" else codes - SHIFT
            true = _words(codes)
        out[cells, column] = true
        return out


def _codes(words: Codes) -> NDArray[np.int32]:
    return (words.astype(np.uint16) >> WIDTH).astype(np.int32)


def _words(codes: NDArray[Any]) -> Codes:
    return (np.clip(codes, 0, RAIL).astype(np.uint16) << WIDTH).view(np.int16)


class FailingDetector(Wire):
    """A detector with injected faults."""

    def __init__(self, inner: SlipDetector, clock: Clock) -> None:
        super().__init__()
        self._inner = inner
        self._clock = clock
        self.name, self.threshold, self.memory = inner.name, inner.threshold, inner.memory

    def reset(self) -> None:
        self._inner.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        answer = self._inner.update(counts)
        for s in self.injected:
            if s.on(self._clock.now_ns):
                answer = self._failed(s.fault.kind, answer)
        return answer

    def _failed(self, kind: str, answer: NDArray[np.float64]) -> NDArray[np.float64]:
        if kind == "raises":
            raise MemoryError("no memory for a window")
        if kind == "late":
            self._clock.sleep_until_ns(self._clock.now_ns + 120_000_000)
        wrong_answers = {
            "not a number": np.full_like(answer, np.nan),
            "detects nothing": np.zeros_like(answer), "detects slip": np.ones_like(answer),
        }  # fmt: skip
        return wrong_answers.get(kind, answer)
