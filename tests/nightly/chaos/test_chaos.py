"""Lifts over wires that delay, cut up, double and reset what passes: each ends in time, says why,
drops nothing that could be held, and sends no stronger command than it may.

`make test-chaos PLANS=200` makes more of them; FROM is the first plan's number.
"""

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
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.rigs import emulated
from scenarios.rigs.cell_process import CellProcess, at_endpoints
from scenarios.world.truth import Truth
from tests.nightly.chaos import proxy
from tests.nightly.chaos.onlooker import LATER_S, MOMENT_S, Left, Look, Onlooker, left
from tests.nightly.chaos.proxy import Commands, Order, Passed, Plan, Route, Trouble, drawn
from tests.nightly.chaos.verdict import NOT_OPENED, Ended, problems, stated_s
from tests.wire.scenarios.cell.staged import QUICK

PLANS, FROM = int(os.environ.get("PLANS", "20")), int(os.environ.get("FROM", "0"))
ARM_PORTS = (29999, 30001, 30002, 30003, 30004)
# no run is to end by it: a phase may last 30 s
SETTINGS = load_config("can", "emulated", None, None, (*QUICK, "loop.deadline_s=60")).for_lift()


class Chaos:
    """The proxy's process, once the cell's addresses are known, and an onlooker who stays when
    the devices have been let go."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._child: subprocess.Popen[str] | None = None
        self._cell_process = emulated.cell_process
        self.left = Left()

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

    @contextmanager
    def observed(self, *args: Any) -> Iterator[CellProcess]:
        with self._cell_process(*args) as cell:
            at = cell.endpoints["control"]
            onlooker = Onlooker(at["host"], at["port"])
            try:
                yield cell
            finally:
                self.left = onlooker.end()

    def end(self) -> Passed:
        if self._child is None:
            return Passed()
        said, _ = self._child.communicate(timeout=10)
        return msgspec.json.decode(said, type=Passed)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(FROM, FROM + PLANS))
def test_lift_over_spoilt_wires_ends_in_time_and_says_why(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _ = SETTINGS.memory_s  # loads the detector, before time is taken
    plan = drawn(number)
    chaos = Chaos(plan)
    monkeypatch.setattr(emulated, "at_endpoints", chaos.between)
    monkeypatch.setattr(emulated, "cell_process", chaos.observed)
    outcome, message, arm, hand, peak_n = NOT_OPENED, "", "", "", 0.0
    start_s = time.monotonic()
    try:
        finished = lift.run(SETTINGS, 0, None)
        assert finished.result is not None
        outcome = finished.result.outcome
        peak_n = max((finished.result.peak_force_n or {"": 0.0}).values())
        if finished.failure is not None:
            message, end = finished.failure.message, finished.failure.end
            arm, hand = ("", "") if end is None else (end.arm, end.hand)
    except GraspError as error:
        message = error.message
    seconds = time.monotonic() - start_s - LATER_S - MOMENT_S
    ended = Ended(plan, outcome, message, arm, hand, seconds, max(peak_n, chaos.left.peak_n),
                  chaos.left, chaos.end())  # fmt: skip
    found = problems(ended, SETTINGS)
    assert not found, f"{'; '.join(found)}: {ended}"


def looked(height_m: float, touched: bool, slip_m: float = 0.0, arm_mps: float = 0.0) -> Look:
    force_n = (9.8, 5.0, 5.0) if touched else (0.0, 0.0, 0.0)
    truth = Truth(
        t_ns=0, height_m=height_m, speed_mps=0.0, slip_distance_m=slip_m, slip_speed_mps=0.0,
        normal_n=force_n, shear_n=(0.0, 0.0, 0.0), peak_n=force_n, slip_onset_s=None,
        force_rise_s=None, flank_slope=0.0,
    )  # fmt: skip
    return Look(truth, arm_mps, 0.0, 0.05 if touched else 0.0)


HELD = [looked(0.0, True), looked(0.03, True), *[looked(0.06, True, 0.002)] * 8]
LET_GO = [*HELD, looked(0.05, False), *[looked(0.0, False)] * 8]
CLOSED = "the hand is closed to the limit of 10 N, its force is not measured"
ALONE = (
    "the hand cannot be told anything and holds by itself: when last heard it was closed with the "
    "grip that it had, at (60, 55, 55) counts, 2.0 N measured at finger A"
)


def test_the_verdict_finds_what_must_not_be_and_nothing_else() -> None:
    def later(looks: list[Look]) -> Left:
        return left(looks, len(looks) - 8)

    tips, gripper = (Plan(0, (Trouble(w, 0.0, 600.0, 0.5),)) for w in ("tactile", "gripper"))
    fine = Ended(tips, "fault", "stale: no fresh fingertip sample", "the arm stands", CLOSED, 9.0,
                 10.1, later(HELD), Passed(writes=8))  # fmt: skip
    lost = msgspec.structs.replace(
        fine, plan=gripper, left=later(LET_GO), hand=ALONE, message="stale: gripper status"
    )
    assert problems(fine, SETTINGS) == problems(lost, SETTINGS) == []
    moving = [*HELD, looked(0.06, True, 0.002, arm_mps=0.01)]
    held: dict[str, Any] = {"outcome": "held", "message": "", "arm": "", "hand": ""}
    cases: tuple[tuple[Ended, dict[str, Any], str], ...] = (
        (fine, {"passed": Passed(writes=8, most_force=1)}, "force byte 1 of 0"),
        (fine, {"peak_n": 11.4}, "11.4 N"),
        (fine, {"seconds": stated_s(SETTINGS) + 0.1}, " s"),
        (fine, {"left": later(moving)}, "the arm moves at 0.0100 m/s"),
        (fine, {"left": later(LET_GO)}, "let go at 60 mm"),
        (lost, {"hand": CLOSED}, "let go at 60 mm"),
        (lost, {"plan": tips}, "let go at 60 mm"),
        (fine, {"left": left([*HELD, looked(0.03, True, 0.03)], 4)}, "slid 30 mm"),
        (fine, held, "then held in the air"),
        (fine, {"message": "the arm is silent"}, "nothing is wrong with the arm"),
        (fine, {"message": "phase rest lasted longer than 30 s"}, "time-out"),
        (fine, {"hand": "the hand is open"}, "the hand is not open"),
    )
    for made, changes, expected in cases:
        told = "; ".join(problems(msgspec.structs.replace(made, **changes), SETTINGS))
        assert expected in told, expected


def test_force_bytes_are_read_from_frames_however_they_are_cut() -> None:
    image = bytes([9, 0, 0, 60, 255, 150, 0, 0, 20, 0, 0, 0, 0, 0, 0, 0])
    pdu = bytes([16, 0, 0, 0, 8, 16]) + image
    frame = bytes([0, 1, 0, 0, 0, len(pdu) + 1, 2]) + pdu
    passed = Passed()
    commands = Commands(passed)
    for byte in frame + bytes([0, 2, 0, 0, 0, 9, 2, 16, 0, 2, 0, 1, 2, 0, 199]):  # rFRA alone
        commands.take(bytes([byte]))
    assert (passed.writes, passed.most_force) == (2, 199)
