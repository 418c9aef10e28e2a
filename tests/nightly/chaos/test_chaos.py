"""Lifts over connections that delay, split, repeat and reset data: each ends in time, states its
cause, drops no object that could be held, and sends no command above the force limit.

`make test-chaos PLANS=200` makes more of them; FROM is the first plan's number.
"""

import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from drivers.errors import GraspError
from grasp.run.loop import ControlLoop
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.lift.scoring import SUCCESSES
from scenarios.rigs import emulated
from scenarios.rigs.emulated import READY_S, CellProcess, at_endpoints, cell_process
from scenarios.rigs.rig import ACTIVATION_TIMEOUT_S
from tests.nightly.cell_observer import LATER_S, MOMENT_S, Aftermath, CellObserver
from tests.nightly.chaos import proxy
from tests.nightly.chaos.proxy import (
    WIRES,
    Commands,
    Disturbance,
    Order,
    Passed,
    Plan,
    Route,
    sample_plan,
)
from tests.nightly.lift_verdict import ObservedLift, problems
from tests.wire.lab import QUICK

PLANS, FROM = int(os.environ.get("PLANS", "20")), int(os.environ.get("FROM", "0"))
SLACK_S = 2.0
FRAME_BYTES = 30  # of a request to the hand, or its reply
ARM_PORTS = (29999, 30003, 30004)
# the deadline must not end a run: a phase may last 30 s
SETTINGS = load_config("can", "emulated", None, None, (*QUICK, "loop.deadline_s=60")).for_lift()


class Chaos:
    """Starts the proxy process when the cell's addresses are known, and an observer that continues
    after the devices are closed."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._child: subprocess.Popen[str] | None = None
        self.left = Aftermath()

    def between(self, settings: Any, endpoints: dict[str, Any]) -> Any:
        """Replacement for ``at_endpoints`` with the proxy's addresses."""
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

    @contextmanager
    def observed(self, *args: Any) -> Iterator[CellProcess]:
        with cell_process(*args) as cell:
            at = cell.endpoints["control"]
            observer = CellObserver(at["host"], at["port"])
            try:
                yield cell
            finally:
                self.left = observer.end()

    def end(self) -> Passed:
        if self._child is None:
            return Passed()
        output, _ = self._child.communicate(timeout=10)
        return msgspec.json.decode(output, type=Passed)


def stated_s() -> float:
    """The longest run by its time-outs, to open, run, stop and close, s."""
    ur, loop = SETTINGS.ur, SETTINGS.loop
    opening_s = READY_S + ACTIVATION_TIMEOUT_S + 3 * ur.step_timeout_s + ur.start_timeout_s
    closing_s = ur.brake_timeout_s + ur.step_timeout_s
    return opening_s + loop.deadline_s + ControlLoop.stop_s + closing_s + SLACK_S


def takes_the_hand(disturbance: Disturbance) -> bool:
    """Whether it cuts the gripper's connection, damages frames, or delays replies too long."""
    pieces = math.ceil(FRAME_BYTES / disturbance.slice_bytes) if disturbance.slice_bytes else 1
    broken = disturbance.reset_share > 0.0 or disturbance.twice_share > 0.0
    late = 2.0 * pieces * disturbance.latency_s >= SETTINGS.modbus.timeout_s
    return disturbance.wire == "gripper" and (broken or late)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(FROM, FROM + PLANS))
def test_lift_over_disturbed_connections_ends_in_time_with_a_cause(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ = SETTINGS.memory_s  # loads the detector, before time is taken
    plan, finished, message = sample_plan(number), None, ""
    chaos = Chaos(plan)
    monkeypatch.setattr(emulated, "at_endpoints", chaos.between)
    monkeypatch.setattr(emulated, "cell_process", chaos.observed)
    start_s = time.monotonic()
    try:
        finished = lift.run(SETTINGS, 0, None)
    except GraspError as error:
        message = error.message
    seconds = time.monotonic() - start_s - LATER_S - MOMENT_S
    passed, faulty = chaos.end(), frozenset(WIRES[t.wire] for t in plan.disturbances)
    hand_lost = any(map(takes_the_hand, plan.disturbances))
    ended = ObservedLift(
        faulty, hand_lost, chaos.left, message=message, force_byte=passed.most_force
    )
    ended = ended if finished is None else ended.of(finished)
    assert problems(ended, SETTINGS) == [], (plan, ended)
    assert seconds <= stated_s(), (plan, ended)
    assert passed.writes or ended.outcome not in SUCCESSES, plan


def test_force_bytes_are_decoded_from_split_frames() -> None:
    image = bytes([9, 0, 0, 60, 255, 150, 0, 0, 20, 0, 0, 0, 0, 0, 0, 0])
    pdu = bytes([16, 0, 0, 0, 8, 16]) + image
    frame = bytes([0, 1, 0, 0, 0, len(pdu) + 1, 2]) + pdu
    passed = Passed()
    commands = Commands(passed)
    for byte in frame + bytes([0, 2, 0, 0, 0, 9, 2, 16, 0, 2, 0, 1, 2, 0, 199]):  # rFRA alone
        commands.take(bytes([byte]))
    assert (passed.writes, passed.most_force) == (2, 199)
