"""A process that makes one lift on the emulated rig, with a proxy in every wire.

    python -m tests.wire.scenarios.chaos.one_lift NUMBER [HANG]

Prints one line: what came of it. HANG, a name of ``HANGS``, makes the application itself hang.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from drivers.errors import GraspError
from drivers.robotiq.link.thread import ThreadedGripper
from grasp.loop import ControlLoop
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs import emulated
from scenarios.rigs.cell_process import READY_S, CellProcess, at_endpoints
from scenarios.rigs.rig import ACTIVATION_TIMEOUT_S
from tests.wire.scenarios.cell.staged import QUICK
from tests.wire.scenarios.chaos import proxy
from tests.wire.scenarios.chaos.onlooker import LATER_S, MOMENT_S, Left, Onlooker
from tests.wire.scenarios.chaos.plans import Plan, drawn
from tests.wire.scenarios.chaos.proxy import Order, Passed, Route
from tests.wire.scenarios.chaos.waits import NAMED_S, Wait, Waits, watched

ARM_PORTS = (29999, 30001, 30002, 30003, 30004)
SETTINGS = (*QUICK, "loop.deadline_s=60")  # no run is to end by it: a phase may last 30 s
STARTS_S = 30.0  # of the proxy, which is none of the application
NOT_OPENED = "not opened"
HANGS = ("closing", "ticking")  # beyond the 5 s and the 0.3 s that are stated
HANG_S = {"closing": 8.0, "ticking": 3.5}


class Ended(msgspec.Struct, frozen=True):
    """What came of it."""

    number: int
    outcome: str
    kind: str
    message: str
    arm: str  # how it was left, by the last line
    hand: str
    seconds: float
    peak_n: float
    left: Left
    overdue: list[Wait]
    tightest: Wait  # the one that came nearest to its time-out, or passed it by most
    told_s: float  # when this was told, by the clock that all processes share
    passed: Passed


def config() -> LiftConfig:
    return load_config("can", "emulated", None, None, SETTINGS).for_lift()


def stated_s(settings: LiftConfig) -> float:
    """As long as a run may last by its time-outs, each once: to open, to run, to stop, to close."""
    ur, loop = settings.ur, settings.loop
    opening_s = READY_S + ACTIVATION_TIMEOUT_S + 3 * ur.step_timeout_s + ur.start_timeout_s
    closing_s = ur.leave_timeout_s + ur.command_timeout_s
    return opening_s + loop.deadline_s + loop.stop_s + closing_s + NAMED_S


class Chaos:
    """The proxy's process, once the cell's addresses are known."""

    def __init__(self, plan: Plan, waits: Waits) -> None:
        self._plan = plan
        self._waits = waits
        self._child: subprocess.Popen[str] | None = None

    def between(self, settings: Any, endpoints: dict[str, Any]) -> Any:
        """As ``at_endpoints``, with the proxy's addresses."""
        host = f"127.{10 + self._plan.number % 200}.{1 + self._plan.number // 200}.77"
        arm = endpoints["arm"]["host"]
        gripper = endpoints["gripper"]
        tactile = endpoints["tactile"]["url"].removeprefix("tcp://").rpartition(":")
        routes = (
            Route("gripper", (host, 0), (gripper["host"], gripper["port"])),
            Route("tactile", (host, 0), (tactile[0], int(tactile[2]))),
            *(Route("arm", (host, port), (arm, port)) for port in ARM_PORTS),
        )
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", proxy.__name__], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        order = msgspec.json.encode(Order(self._plan, routes)).decode()
        said = self._waits.around("the proxy starts", STARTS_S, lambda: self._said(order + "\n"))
        ports = msgspec.json.decode(said)
        changed = {
            "gripper": gripper | {"host": host, "port": ports[0]},
            "tactile": {"url": f"tcp://{host}:{ports[1]}"},
            "arm": endpoints["arm"] | {"host": host},
        }
        return at_endpoints(settings, endpoints | changed)

    def _said(self, line: str) -> str:
        assert self._child is not None
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.write(line)
        self._child.stdin.flush()
        return self._child.stdout.readline()

    def end(self) -> Passed:
        if self._child is None:
            return Passed()
        said, _ = self._child.communicate(timeout=10)
        return msgspec.json.decode(said, type=Passed)


def hang(name: str) -> None:
    """Make the application hang once: while it closes, or in a tick."""
    owner: Any
    owner, verb = (ThreadedGripper, "stop") if name == "closing" else (ControlLoop, "tick")
    inner, left_s = getattr(owner, verb), [HANG_S[name]]

    def hanging(*args: Any, **more: Any) -> Any:
        if left_s:
            time.sleep(left_s.pop())
        return inner(*args, **more)

    setattr(owner, verb, hanging)


def one_lift(number: int, hangs: str = "") -> Ended:
    settings, left = config(), [Left()]
    inner = emulated.cell_process

    @contextmanager
    def looked_at(*args: Any) -> Iterator[CellProcess]:
        """The cell, and an onlooker who stays when the devices have been let go."""
        with inner(*args) as cell:
            control = cell.endpoints["control"]
            onlooker = Onlooker(control["host"], control["port"])
            try:
                yield cell
            finally:
                left[0] = waits.around("looking", LATER_S + MOMENT_S, onlooker.end)

    if hangs:
        hang(hangs)
    _ = settings.memory_s  # to load the detector is no waiting
    waits = Waits()
    chaos = Chaos(drawn(number), waits)
    watched(waits, settings)
    emulated.at_endpoints = chaos.between  # type: ignore[assignment]
    emulated.cell_process = looked_at  # type: ignore[assignment]
    start_s = time.monotonic()
    outcome, kind, message, arm, hand, peak_n = NOT_OPENED, "", "", "", "", 0.0
    try:
        finished = lift.run(settings, 0, None)
        assert finished.result is not None
        outcome = finished.result.outcome
        peak_n = max((finished.result.peak_force_n or {"": 0.0}).values())
        if finished.failure is not None:
            kind, message = finished.failure.kind, finished.failure.message
        if finished.failure is not None and finished.failure.end is not None:
            arm, hand = finished.failure.end.arm, finished.failure.end.hand
    except GraspError as error:
        kind, message = error.kind, error.message
    waits.sign()
    seconds = time.monotonic() - start_s - LATER_S - MOMENT_S
    peak_n = max(peak_n, left[0].peak_n)
    tightest = max(waits.longest.values(), key=lambda wait: wait.took_s - wait.stated_s)
    return Ended(
        number, outcome, kind, message, arm, hand, seconds, peak_n, left[0], waits.overdue,
        tightest, time.monotonic(), chaos.end(),
    )  # fmt: skip


if __name__ == "__main__":
    print(msgspec.json.encode(one_lift(int(sys.argv[1]), *sys.argv[2:])).decode(), flush=True)
