"""A process that makes one lift on the emulated rig, with a proxy in every wire.

    python -m tests.wire.scenarios.chaos.one_lift NUMBER

Prints one line: what came of it.
"""

import subprocess
import sys
import time
from typing import Any

import msgspec

from drivers.errors import GraspError
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs import emulated
from scenarios.rigs.cell_process import READY_S, at_endpoints
from scenarios.rigs.rig import ACTIVATION_TIMEOUT_S
from tests.wire.scenarios.cell.staged import QUICK
from tests.wire.scenarios.chaos import proxy
from tests.wire.scenarios.chaos.plans import Plan, drawn
from tests.wire.scenarios.chaos.proxy import Order, Passed, Route

ARM_PORTS = (29999, 30001, 30002, 30003, 30004)
SETTINGS = (*QUICK, "loop.deadline_s=60")  # no run is to end by it: a phase may last 30 s
NAMED_S = 2.0  # that a stated time-out may be passed by


class Ended(msgspec.Struct, frozen=True):
    """What came of it."""

    number: int
    outcome: str
    kind: str
    message: str
    seconds: float
    peak_n: float
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

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
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
        ports = msgspec.json.decode(self._said(order + "\n"))
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


def one_lift(number: int) -> Ended:
    chaos, settings = Chaos(drawn(number)), config()
    emulated.at_endpoints = chaos.between  # type: ignore[assignment]
    start_s = time.monotonic()
    outcome, kind, message, peak_n = "not opened", "", "", 0.0
    try:
        finished = lift.run(settings, 0, None)
        assert finished.result is not None
        outcome = finished.result.outcome
        peak_n = max((finished.result.peak_force_n or {"": 0.0}).values())
        if finished.failure is not None:
            kind, message = finished.failure.kind, finished.failure.message
    except GraspError as error:
        kind, message = error.kind, error.message
    seconds = time.monotonic() - start_s
    return Ended(number, outcome, kind, message, seconds, peak_n, chaos.end())


if __name__ == "__main__":
    print(msgspec.json.encode(one_lift(int(sys.argv[1]))).decode())
