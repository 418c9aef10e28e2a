"""The emulated cell: one process, one world, its emulated devices on one loopback address.

    python emulated_cell.py   reads a CellOrder, a line of JSON on stdin

It prints one line of JSON with its endpoints when it is ready, and ends on SIGTERM, SIGINT, or when
its standard input closes, so it ends with its parent. Every request first advances the world to the
present of the machine's monotonic clock.
"""

import json
import math
import os
import random
import secrets
import signal
import socketserver
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from functools import partial
from typing import Any, Literal, Self, TypeVar

import msgspec

from drivers.robotiq.emulator import GripperEmulator, RtuEmulator
from drivers.takktile.emulator.server import BoardServer
from drivers.ur.emulator.controller import EmulatorSettings
from drivers.ur.emulator.server import SWITCH_S, UrEmulator
from scenarios.rigs.cell_faults import CellFaults
from scenarios.rigs.cell_order import CellOrder
from scenarios.rigs.compilation import tell_of_compilation
from scenarios.rigs.simulated import any_cell, cell_settings
from scenarios.world.cell import PadPress, PadWeight, SimulatedCell
from scenarios.world.settings import Impact

STALL_NS = 50_000_000
ADDRESS_TRIES = 50
T = TypeVar("T")
Request = dict[str, Any]
Verb = Callable[[Request], Request | None]
HOME_MPS, HOME_MPS2 = 0.1, 0.5  # motion to the start pose, as by the teach pendant
ARM_FAULT_S = 1.0  # timeout for a fault of the arm to take effect; a frozen arm takes longer
OPEN_M = 0.02  # largest fingertip travel of a hand with room for an object
LONGEST = 65_536  # bytes of a request
END_POLL_S = 0.05  # longest that the control channel takes to end
SHOWN = 500  # characters of an error message


class CellOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Address and devices of a cell."""

    host: str | None = None  # none: a free loopback address, chosen by binding
    gripper_port: int = 0
    token: str = ""  # allows any host address; control requests must then contain it
    profile: Literal["cb3", "e-series"] = "cb3"
    rtu: bool = False  # the gripper also on a pseudo-terminal


class EmulatedCell:
    """One world with emulated devices on real protocols and a control channel."""

    def __init__(self, order: CellOrder, host: str, options: CellOptions) -> None:
        """Raises OSError when the address is taken, ValueError for one beyond loopback without a
        token."""
        self.host = host
        self._token = token = options.token
        self._lock = threading.RLock()
        self._stalls = 0
        self._worst_stall_ns = 0
        self._start_ns = self._last_ns = time.monotonic_ns()
        self.cell = any_cell(order.config, order.seed, self._last_ns)
        self._hand = self.cell if isinstance(self.cell, SimulatedCell) else None
        self._placed = self._hand is None  # a fixed surface is always in place
        self._verbs: dict[str, Verb] = {
            **({} if self._hand is None else self._grasp_verbs(self._hand, order)),
            "truth": self._truth, "motion": self._motion, "fault": self._fault,
        }  # fmt: skip
        self._home_m = start_m = order.config.arm_model.start_m
        self._home_requested = False
        arm = EmulatorSettings(host=host, start_m=start_m, token=token, profile=options.profile)
        lock, advance = self._lock, self.advance
        with ExitStack() as stack:
            use = stack.enter_context
            self.arm = use(UrEmulator(arm, self.cell.arm, lock, self._arm_cycle))
            self.gripper = self.serial = None
            if self._hand is not None:
                hand, port = self._hand.gripper, options.gripper_port
                self.gripper = use(GripperEmulator(hand, host, port, lock=lock, advance=advance))
                if options.rtu:
                    self.serial = use(RtuEmulator(hand, lock=lock, advance=advance))
            self.board = use(BoardServer(self.cell.board, lock, host, clock=self._advanced))
            self.faults = CellFaults(self.cell.board, self.arm, self.gripper)
            self.control = use(ControlServer(host, self.execute_request, token))
            self.close = stack.pop_all().close

    def advance(self, now_ns: int) -> None:
        """Advance the world to now_ns; an earlier time has no effect."""
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
        """Place the object once the hand is active, open and at rest."""
        if self._placed or self._hand is None:
            return
        hand = self._hand.gripper
        if hand.ready and not hand.moving and hand.travel_m.max() < OPEN_M:
            self._placed = True
            self._hand.place_object()

    def _arm_cycle(self, now_ns: int) -> None:
        self.advance(now_ns)
        with self._lock:
            self.faults.apply_due(now_ns)
        self.faults.apply_due_to_arm()
        self._go_home(now_ns)

    def _go_home(self, now_ns: int) -> None:
        """Start a requested motion to the start pose if nothing moves; runs in the arm's thread."""
        motion, requested = self.arm.controller.motion, self._home_requested
        self._home_requested = False
        if not requested or motion.moving or motion.tripped:
            return
        motion.reset_rotation()
        with self._lock:
            self.cell.arm.move_l(self._home_m, HOME_MPS, HOME_MPS2, now_ns)

    def _advanced(self) -> int:
        now_ns = time.monotonic_ns()
        self.advance(now_ns)
        return now_ns

    def endpoints(self) -> dict[str, Any]:
        """Addresses of all devices and of the control channel, for clients."""
        gripper: dict[str, Any] = {}
        if self.gripper is not None:
            host, port = self.gripper.address
            gripper = {"gripper": {"host": host, "port": port, "unit": 2}}
        if self.serial is not None:
            gripper["gripper_serial"] = {"port": self.serial.port, "unit": 9}
        return {
            "host": self.host,
            "start_ns": self._start_ns,
            **gripper,
            "tactile": {"url": self.board.url},
            "arm": {"host": self.host, "rtde": 30004, "dashboard": 29999, "script": 30003,
                    "faults": self.arm.fault_port},
            "control": {"host": self.host, "port": self.control.port},
            **({"token": self._token} if self._token else {}),
        }  # fmt: skip

    def execute_request(self, request: Request) -> Request:
        """Execute one request of the control channel; the reply to an unknown one is an error."""
        verb = str(request.pop("verb", ""))
        execute = self._verbs.get(verb)
        if execute is None:
            return {"error": f"unknown verb {verb!r}: one of {', '.join(self._verbs)}"}
        with self._lock:
            self.advance(time.monotonic_ns())
            reply = execute(request) or {}
        if verb == "fault" and not self.faults.wait_applied_to_arm(ARM_FAULT_S):
            reply["effect"] += "; applied in the arm's next cycle"
        return reply

    def _truth(self, request: Request) -> Request:
        truth = msgspec.to_builtins(self.cell.truth())
        hand = {} if self._hand is None else {"travel_m": self._hand.gripper.travel_m.tolist()}
        return {"truth": truth, **hand, "placed": self._placed, "stalls": self._stalls,
                "worst_stall_ms": self._worst_stall_ns * 1e-6}  # fmt: skip

    def _motion(self, request: Request) -> Request:
        """True speeds of the arm and of the fastest finger, m/s."""
        fingers = () if self._hand is None else self._hand.gripper.velocity_mps
        arm_mps = math.hypot(*self.cell.arm.at(self._last_ns).velocity_mps)
        fingers_mps = float(max((abs(v) for v in fingers), default=0.0))
        return {"arm_mps": arm_mps, "fingers_mps": fingers_mps}

    def _fault(self, request: Request) -> Request:
        return {"effect": self.faults.order(request, time.monotonic_ns())}

    def _grasp_verbs(self, cell: SimulatedCell, order: CellOrder) -> dict[str, Verb]:
        def load(request: Request) -> None:
            other = msgspec.convert(request, CellOrder)
            if other.grasp is None:
                raise ValueError("this cell has a hand: the order needs grasp settings")
            cell.load(*cell_settings(other.grasp, other.seed))
            self._placed = False

        def take(request: Request) -> None:
            """Remove the object."""
            if order.grasp is not None:
                cell.load(*cell_settings(order.grasp, order.seed))
            self._placed = True

        return {
            "load": load,
            "place": lambda request: cell.place_object(),
            "take": take,
            "tap": lambda request: cell.tap(msgspec.convert(request, Impact)),
            "press": lambda request: cell.press(msgspec.convert(request, PadPress)),
            "lay": lambda request: cell.put_weight(msgspec.convert(request, PadWeight)),
            "home": self._home,
        }

    def _home(self, request: Request) -> Request:
        """Request the arm's motion to its start pose; returns the remaining distance."""
        now_ns, arm, motion = time.monotonic_ns(), self.cell.arm, self.arm.controller.motion
        here = arm.at(now_ns)
        away_m = math.dist(here.position_m, self._home_m)
        if arm.protective_stop:
            return {"error": "the arm is stopped by its safety system; 5 s after a protective "
                    f"stop, send 'unlock protective stop' to its dashboard, {self.host} port 29999",
                    }  # fmt: skip
        if arm.speed_scaling(now_ns) == 0.0:
            return {"error": "the arm's speed slider is at 0 %: first set it with 'fault "
                    "speed_slider fraction=1'"}  # fmt: skip
        moving = motion.moving or here.moving
        self._home_requested = (away_m > 0.0 or motion.turned_rad > 0.0) and not moving
        return {"away_m": away_m, "turned_rad": motion.turned_rad}


class _Handler(socketserver.StreamRequestHandler):
    """JSON lines: a request is an object with a ``verb``, and with the cell's token if it has one;
    the reply is an object, with ``error`` if the request was refused."""

    disable_nagle_algorithm = True
    server: "ControlServer"

    def handle(self) -> None:
        with suppress(OSError):
            while line := self.rfile.readline(LONGEST):
                self.wfile.write(json.dumps(self._reply(line)).encode() + b"\n")

    def _reply(self, line: bytes) -> Request:
        try:
            request = msgspec.json.decode(line, type=Request)
            token = str(request.pop("token", ""))
            if not secrets.compare_digest(token.encode(), self.server.token.encode()):
                raise PermissionError("the request must contain the cell's token")
            return self.server.execute(request)
        except Exception as error:  # a client's mistake must not end the cell
            return {"error": f"{type(error).__name__}: {error}"[:SHOWN]}


class ControlServer(socketserver.ThreadingTCPServer):
    """Serves ``execute`` on a free port of the cell's address, one thread per client."""

    daemon_threads = True

    def __init__(self, host: str, execute: Callable[[Request], Request], token: str = "") -> None:
        super().__init__((host, 0), _Handler)
        self.execute, self.token = execute, token
        self.port: int = self.server_address[1]

    def __enter__(self) -> Self:
        serve = partial(self.serve_forever, END_POLL_S)
        threading.Thread(target=serve, name="cell-control", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore clients that disconnect."""


def bind_free_address(make: Callable[[str], T]) -> T:
    """Result of ``make`` at the first loopback address that it can bind."""
    for _ in range(ADDRESS_TRIES):
        parts = (random.randint(1, 254) for _ in range(3))
        with suppress(OSError):  # never 127.0.0.1: ur_rtde skips a check there
            return make("127." + ".".join(map(str, parts)))
    raise OSError(f"no free loopback address in {ADDRESS_TRIES} tries")


def serve(
    order: CellOrder, options: CellOptions, ended: threading.Event,
    opened: Callable[[EmulatedCell], None] = lambda cell: None,
) -> None:  # fmt: skip
    """Open a cell, print its endpoints, and serve until ``ended`` is set. ``opened`` is called with
    the cell before it serves and must not block."""
    sys.setswitchinterval(SWITCH_S)
    begin = "\r\x1b[2Kcell" if sys.stderr.isatty() else "cell"  # over the line of a display
    with tell_of_compilation(lambda text: print(f"{begin}: {text}", file=sys.stderr, flush=True)):
        any_cell(order.config, order.seed).compile()
    make = partial(EmulatedCell, order, options=options)
    with closing(bind_free_address(make) if options.host is None else make(options.host)) as cell:
        print(json.dumps({"ready": True, "pid": os.getpid(), **cell.endpoints()}), flush=True)
        opened(cell)
        cell.arm.run(ended.is_set)  # the arm's cycles are the main loop; the rest runs in threads


def end_on_signals() -> threading.Event:
    """Event that SIGTERM and SIGINT set."""
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    return ended


def read_order(ended: threading.Event) -> CellOrder:
    """Order in the first line of standard input. ``ended`` is set when the input closes, that is,
    when the parent ends. Raises BrokenPipeError if it has ended already."""
    line = sys.stdin.readline()
    if not line:
        raise BrokenPipeError
    order = msgspec.json.decode(line, type=CellOrder)

    def watch() -> None:
        sys.stdin.read()  # returns when the parent ends, for any reason
        ended.set()

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()
    return order


def main() -> None:
    ended = end_on_signals()
    try:
        serve(read_order(ended), CellOptions(), ended)
    except BrokenPipeError:  # the parent was interrupted, and has reported it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
