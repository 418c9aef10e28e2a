"""The emulated cell: one process, one world, three emulated devices on one loopback address.

    python -m scenarios.rigs.emulated_cell   reads {"config": ..., "seed": ...}, a line of stdin

prints one line of JSON with its endpoints when it is ready, and ends on SIGTERM, SIGINT, or when
its standard input closes: a cell ends with its parent. Everything advances to "now" on the
machine's monotonic clock, whoever asks first; nothing sleeps and adds.
"""

import json
import os
import random
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from drivers.robotiq.emulator.tcp import GripperEmulator, Trouble, WireFault
from drivers.takktile.emulator.server import BoardServer
from drivers.ur.emulator.robot import UrEmulator
from drivers.ur.emulator.settings import EmulatorSettings
from scenarios.rigs.cell_control import ControlServer
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.world_of_seed import cell_settings, make_cell
from scenarios.world.cell import Blow, SimulatedCell

STALL_NS = 50_000_000
ADDRESS_TRIES = 50
T = TypeVar("T")
OPEN_M = 0.02  # fingertip travel of a hand that has room for an object


class FaultOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One ``fault`` request: what goes wrong, when, and how much of it."""

    verb: Literal["fault"]
    name: str
    after_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 0.0  # from now on
    times: Annotated[int, Meta(ge=1)] = 1  # requests or reads that are hit
    skip: Annotated[int, Meta(ge=0)] = 0  # requests that are spared first
    seconds: Annotated[float, Meta(ge=0.0, le=60.0)] = 0.1  # of a delay or a freeze
    code: Annotated[int, Meta(ge=1, le=15)] = 0x0E  # gripper fault; its default needs a reset
    pressed: bool = True  # emergency button


Strike = Callable[[FaultOrder], object]


class CellFaults:
    """Everything that can go wrong in a cell, by name; struck at once or at a later time."""

    def __init__(self, cell: SimulatedCell, gripper: GripperEmulator, arm: UrEmulator) -> None:
        self._gripper = gripper
        self._table: dict[str, tuple[set[str], Strike]] = {
            "gripper_drop": ({"times", "skip"}, self._plan(Trouble.DROP)),
            "gripper_delay": ({"times", "skip", "seconds"}, self._plan(Trouble.DELAY)),
            "gripper_garble": ({"times", "skip"}, self._plan(Trouble.GARBLE)),
            "gripper_freeze": ({"seconds", "skip"}, self._plan(Trouble.FREEZE)),
            "gripper_disconnect": ({"times"}, self._disconnect),
            "gripper_fault": ({"code"}, lambda order: cell.gripper.inject_fault(order.code)),
            "unplug": (set(), lambda order: cell.board.unplug()),
            "replug": (set(), lambda order: cell.board.replug()),
            "usb_timeout": ({"times"}, lambda order: cell.board.time_out(order.times)),
        }
        self._arm_table: dict[str, tuple[set[str], Strike]] = {
            "protective_stop": (set(), lambda order: arm.controller.protective_stop()),
            "emergency_stop": (
                {"pressed"}, lambda order: arm.controller.emergency_stop(order.pressed)
            ),
            "arm_disconnect": (set(), lambda order: arm.drop_links()),
            "arm_freeze": ({"seconds"}, lambda order: arm.freeze(order.seconds)),
        }  # fmt: skip
        self._waiting: list[tuple[int, FaultOrder]] = []
        self._for_arm: deque[FaultOrder] = deque()

    def order(self, request: dict[str, Any], now_ns: int) -> None:
        """Take a request. Raises ValueError for an unknown name or an argument out of place."""
        order = msgspec.convert(request, FaultOrder)
        table = self._table | self._arm_table
        if order.name not in table:
            raise ValueError(f"unknown fault {order.name!r}: one of {', '.join(table)}")
        strange = request.keys() - table[order.name][0] - {"verb", "name", "after_s"}
        if strange:
            raise ValueError(f"fault {order.name!r} takes no {', '.join(sorted(strange))}")
        self._waiting.append((now_ns + round(order.after_s * 1e9), order))
        self.strike(now_ns)

    def strike(self, now_ns: int) -> None:
        """Let happen what is due; the caller holds the cell's lock."""
        due = [order for t_ns, order in self._waiting if t_ns <= now_ns]
        self._waiting = [waiting for waiting in self._waiting if waiting[0] > now_ns]
        for order in due:
            if order.name in self._arm_table:
                self._for_arm.append(order)
            else:
                self._table[order.name][1](order)

    def strike_arm(self) -> None:
        """What is due at the arm, whose controller and connections belong to its own thread."""
        while self._for_arm:
            order = self._for_arm.popleft()
            self._arm_table[order.name][1](order)

    def _plan(self, trouble: Trouble) -> Strike:
        return lambda order: self._gripper.faults.add(
            WireFault(trouble=trouble, times=order.times, skip=order.skip, seconds=order.seconds)
        )

    def _disconnect(self, order: FaultOrder) -> None:
        """Once is a plug pulled and put back; more cuts whoever connects again."""
        self._gripper.disconnect()
        if order.times > 1:
            self._gripper.faults.add(WireFault(trouble=Trouble.DISCONNECT, times=order.times - 1))


class EmulatedCell:
    """One world behind three real wires and a control channel."""

    def __init__(self, config: GraspRigConfig, seed: int, host: str, gripper_port: int = 0) -> None:
        """Raises OSError when the address is taken."""
        self.host = host
        self._lock = threading.RLock()
        self._placed = False
        self._stalls = 0
        self._worst_stall_ns = 0
        self._start_ns = self._last_ns = time.monotonic_ns()
        self.cell = make_cell(config, seed, self._last_ns)
        self._stack = ExitStack()
        with ExitStack() as stack:
            self.arm = stack.enter_context(
                UrEmulator(
                    EmulatorSettings(host=host, start_m=config.arm_model.start_m),
                    self.cell.arm, self._lock, self._arm_cycle,
                )
            )  # fmt: skip
            self.gripper = stack.enter_context(
                GripperEmulator(
                    self.cell.gripper, host, gripper_port, lock=self._lock, advance=self.advance
                )
            )
            self.board = stack.enter_context(
                BoardServer(self.cell.board, self._lock, host, clock=self._advanced)
            )
            self.faults = CellFaults(self.cell, self.gripper, self.arm)
            self.control = stack.enter_context(ControlServer(host, self.obey))
            self._stack = stack.pop_all()

    def close(self) -> None:
        self._stack.close()

    def advance(self, now_ns: int) -> None:
        """Bring the world to now_ns; a time that has passed already changes nothing."""
        with self._lock:
            late_ns = now_ns - self._last_ns
            if late_ns > STALL_NS:
                self._stalls += 1
                self._worst_stall_ns = max(self._worst_stall_ns, late_ns)
            if late_ns > 0:
                self._last_ns = now_ns
                self.cell.advance(now_ns)
                self._place()

    def _place(self) -> None:
        """Put the object between the fingers once the hand is active, as a person would."""
        hand = self.cell.gripper
        is_open = hand.ready and not hand.moving and hand.travel_m.max() < OPEN_M
        if is_open and not self._placed:
            self._placed = True
            self.cell.place_object()

    def _arm_cycle(self, now_ns: int) -> None:
        self.advance(now_ns)
        with self._lock:
            self.faults.strike(now_ns)
        self.faults.strike_arm()

    def _advanced(self) -> int:
        now_ns = time.monotonic_ns()
        self.advance(now_ns)
        return now_ns

    def run(self, ended: Callable[[], bool]) -> None:
        """Serve until told to end. The arm's cycles are the loop, the rest has threads."""
        self.arm.run(ended)

    def endpoints(self) -> dict[str, Any]:
        """Where clients find everything."""
        host, port = self.gripper.address
        return {
            "host": self.host,
            "start_ns": self._start_ns,
            "gripper": {"host": host, "port": port, "unit": 2},
            "tactile": {"url": self.board.url},
            "arm": {
                "host": self.host,
                "rtde": 30004,
                "dashboard": 29999,
                "script": 30003,
                "faults": self.arm.fault_port,
            },
            "control": {"host": self.host, "port": self.control.port},
        }

    def obey(self, request: dict[str, Any]) -> dict[str, Any]:
        """One request of the control channel; an unknown one is answered with an error."""
        verb = request.get("verb")
        with self._lock:
            self.advance(time.monotonic_ns())
            if verb == "place":
                self.cell.place_object()
                return {}
            if verb == "truth":
                truth = msgspec.to_builtins(self.cell.truth())
                return {"truth": truth, "placed": self._placed, "stalls": self._stalls,
                        "worst_stall_ms": self._worst_stall_ns * 1e-6}  # fmt: skip
            if verb == "load":
                config = msgspec.convert(request["config"], GraspRigConfig)
                self.cell.load(*cell_settings(config, int(request["seed"])))
                self._placed = False
                return {}
            if verb == "tap":
                blow = {key: value for key, value in request.items() if key != "verb"}
                self.cell.tap(msgspec.convert(blow, Blow))
                return {}
            if verb == "fault":
                self.faults.order(request, time.monotonic_ns())
                return {}
        return {"error": f"unknown verb {verb!r}: one of load, place, tap, truth, fault"}


@contextmanager
def open_cell(
    config: GraspRigConfig, seed: int, host: str | None, gripper_port: int
) -> Iterator[EmulatedCell]:
    """A cell on the address given, or on a free one of its own, chosen by binding."""
    cell = _bind(config, seed, host, gripper_port)
    try:
        yield cell
    finally:
        cell.close()


def _bind(config: GraspRigConfig, seed: int, host: str | None, gripper_port: int) -> EmulatedCell:
    if host is not None:
        return EmulatedCell(config, seed, host, gripper_port)
    return at_free_address(lambda address: EmulatedCell(config, seed, address, gripper_port))


def at_free_address(make: Callable[[str], T]) -> T:
    """What ``make`` gives at the first loopback address that it can bind."""
    for _ in range(ADDRESS_TRIES):
        parts = (random.randint(1, 254) for _ in range(3))
        address = "127." + ".".join(map(str, parts))  # never 127.0.0.1: ur_rtde skips a check there
        try:
            return make(address)
        except OSError:
            continue
    raise OSError(f"no free loopback address in {ADDRESS_TRIES} tries")


def serve(
    config: GraspRigConfig,
    seed: int,
    host: str | None,
    gripper_port: int,
    ended: threading.Event,
) -> None:
    """Open a cell, say where it is, and serve until ``ended`` is set."""
    make_cell(config, seed).compile()
    with open_cell(config, seed, host, gripper_port) as cell:
        print(json.dumps({"ready": True, "pid": os.getpid(), **cell.endpoints()}), flush=True)
        cell.run(ended.is_set)


def end_on_signals() -> threading.Event:
    """An event that SIGTERM and SIGINT set."""
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    return ended


def read_order(ended: threading.Event) -> dict[str, Any]:
    """The first line of standard input; ``ended`` is set when the input closes: the parent died."""
    order: dict[str, Any] = json.loads(sys.stdin.readline())

    def watch() -> None:
        sys.stdin.read()  # returns when the parent has closed its end, however it died
        ended.set()

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()
    return order


def main() -> None:
    ended = end_on_signals()
    order = read_order(ended)
    config = msgspec.convert(order["config"], GraspRigConfig)
    serve(config, order["seed"], order.get("host"), order.get("gripper_port", 0), ended)


if __name__ == "__main__":
    main()
