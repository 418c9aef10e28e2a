"""A process that makes one lift on the emulated rig, with a proxy in every wire.

    python -m tests.nightly.chaos.one_lift NUMBER

Prints its result, one line of JSON.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from drivers.errors import GraspError
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs import emulated
from scenarios.rigs.cell_process import READY_S, CellProcess, at_endpoints
from scenarios.rigs.rig import ACTIVATION_TIMEOUT_S
from tests.nightly.chaos import proxy
from tests.nightly.chaos.onlooker import LATER_S, MOMENT_S, Left, Onlooker
from tests.nightly.chaos.plans import Plan, drawn
from tests.nightly.chaos.proxy import Order, Passed, Route
from tests.wire.scenarios.cell.staged import QUICK

ARM_PORTS = (29999, 30001, 30002, 30003, 30004)
SETTINGS = (*QUICK, "loop.deadline_s=60")  # no run is to end by it: a phase may last 30 s
NOT_OPENED = "not opened"
SLACK_S = 2.0


class Ended(msgspec.Struct, frozen=True):
    """Result of one lift."""

    number: int
    outcome: str
    kind: str
    message: str
    arm: str  # how it was left, by the last line
    hand: str
    seconds: float
    peak_n: float
    left: Left
    passed: Passed


def config() -> LiftConfig:
    return load_config("can", "emulated", None, None, SETTINGS).for_lift()


def stated_s(settings: LiftConfig) -> float:
    """The longest run by its time-outs, each once: to open, run, stop and close."""
    ur, loop = settings.ur, settings.loop
    opening_s = READY_S + ACTIVATION_TIMEOUT_S + 3 * ur.step_timeout_s + ur.start_timeout_s
    closing_s = ur.leave_timeout_s + ur.command_timeout_s
    return opening_s + loop.deadline_s + loop.stop_s + closing_s + SLACK_S


class Chaos:
    """The proxy's process, once the cell's addresses are known."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._child: subprocess.Popen[str] | None = None

    def between(self, settings: Any, endpoints: dict[str, Any]) -> Any:
        """As ``at_endpoints``, with the proxy's addresses."""
        host = f"127.{10 + self._plan.number % 200}.{1 + self._plan.number // 200}.77"
        arm, gripper = endpoints["arm"]["host"], endpoints["gripper"]
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
        assert self._child.stdin is not None and self._child.stdout is not None
        self._child.stdin.write(msgspec.json.encode(Order(self._plan, routes)).decode() + "\n")
        self._child.stdin.flush()
        ports = msgspec.json.decode(self._child.stdout.readline())
        changed = {
            "gripper": gripper | {"host": host, "port": ports[0]},
            "tactile": {"url": f"tcp://{host}:{ports[1]}"},
            "arm": endpoints["arm"] | {"host": host},
        }
        return at_endpoints(settings, endpoints | changed)

    def end(self) -> Passed:
        if self._child is None:
            return Passed()
        said, _ = self._child.communicate(timeout=10)
        return msgspec.json.decode(said, type=Passed)


def one_lift(number: int) -> Ended:
    settings, left = config(), [Left()]
    inner = emulated.cell_process

    @contextmanager
    def observed(*args: Any) -> Iterator[CellProcess]:
        """The cell, and an onlooker who stays when the devices have been let go."""
        with inner(*args) as cell:
            onlooker = Onlooker(
                cell.endpoints["control"]["host"], cell.endpoints["control"]["port"]
            )
            try:
                yield cell
            finally:
                left[0] = onlooker.end()

    _ = settings.memory_s  # loads the detector, before time is taken
    chaos = Chaos(drawn(number))
    emulated.at_endpoints = chaos.between  # type: ignore[assignment]
    emulated.cell_process = observed  # type: ignore[assignment]
    start_s = time.monotonic()
    outcome, kind, message, arm, hand, peak_n = NOT_OPENED, "", "", "", "", 0.0
    try:
        finished = lift.run(settings, 0, None)
        assert finished.result is not None
        outcome = finished.result.outcome
        peak_n = max((finished.result.peak_force_n or {"": 0.0}).values())
        if finished.failure is not None:
            kind, message = finished.failure.kind, finished.failure.message
            if (end := finished.failure.end) is not None:
                arm, hand = end.arm, end.hand
    except GraspError as error:
        kind, message = error.kind, error.message
    seconds = time.monotonic() - start_s - LATER_S - MOMENT_S
    return Ended(number, outcome, kind, message, arm, hand, seconds,
                 max(peak_n, left[0].peak_n), left[0], chaos.end())  # fmt: skip


if __name__ == "__main__":
    print(msgspec.json.encode(one_lift(int(sys.argv[1]))).decode(), flush=True)
