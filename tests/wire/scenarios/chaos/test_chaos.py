"""Wires that delay, cut up, double and reset what passes: a lift ends in time, says why, and no
command is stronger than it may be."""

import asyncio
import os
import signal
import subprocess
import sys
import time

import pytest

from grasp.phases import Phase
from tests.wire.scenarios.chaos import one_lift
from tests.wire.scenarios.chaos.one_lift import config, stated_s
from tests.wire.scenarios.chaos.plans import WIRES, Plan, Trouble, drawn
from tests.wire.scenarios.chaos.proxy import Commands, Order, Passed, Proxy, Route
from tests.wire.scenarios.chaos.verdict import judged
from tests.wire.scenarios.chaos.waits import BUSY, MOST_SPARED_S, NAMED_S, Wait, Waits

SLOW, ALL = 20, 200
PLANS = int(os.environ.get("CHAOS_PLANS", str(SLOW)))  # `make faults` asks for all of them
FROM = int(os.environ.get("CHAOS_FROM", "0"))
QUIET = 8  # a plan: hardly any trouble of the fingertips


def wrong(number: int, hang: str = "") -> str:
    """What of a plan's lift was not as it must be; prints what came of it."""
    settings = config()
    most_s = stated_s(settings)
    command = [sys.executable, "-P", "-m", one_lift.__name__, str(number), *filter(None, [hang])]
    lifting = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        said, complaint = lifting.communicate(timeout=2 * most_s)
    except subprocess.TimeoutExpired:
        os.killpg(lifting.pid, signal.SIGKILL)  # with its cell and its proxy
        _, complaint = lifting.communicate()
        return f"{drawn(number)}: did not end: {complaint[-2000:]}"
    ended, found = judged(number, lifting.returncode, said, complaint, time.monotonic(), settings)
    if ended is not None:
        print(drawn(number), "|", ended.outcome, ended.kind, ended.message,
              f"{ended.seconds:.1f} s", f"{ended.peak_n:.1f} N |", ended.arm, "|", ended.hand, "|",
              ended.left, "|", ended.tightest, ended.passed, flush=True)  # fmt: skip
    return found


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", range(FROM, FROM + PLANS))
def test_lift_through_wires_that_spoil_what_passes_ends_in_time_and_says_why(number: int) -> None:
    found = wrong(number)
    assert not found, found


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("hang", "found"), [("closing", "ThreadedGripper.stop: 8"), ("ticking", "ControlLoop.tick: 3")]
)
def test_a_hang_of_the_application_is_found_though_the_run_ends_in_time(
    hang: str, found: str
) -> None:
    said = wrong(QUIET, hang)
    assert f"waited too long: {found}" in said, said


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s

    def pass_s(self, seconds: float) -> None:
        self.now_s += seconds


def test_a_wait_is_measured_by_its_own_time_out_and_what_lies_between_by_none() -> None:
    clock = Clock()
    waits = Waits(clock)
    waits.around("long", 30.0, lambda: clock.pass_s(31.9))
    waits.around("short", 0.5, lambda: clock.pass_s(2.4))
    clock.pass_s(1.9)
    waits.sign()
    assert waits.overdue == []
    waits.around("short", 0.5, lambda: clock.pass_s(2.6))
    assert waits.overdue == [Wait("short", pytest.approx(2.6), 0.5)]
    clock.pass_s(2.5)
    waits.sign()
    assert [wait.name for wait in waits.overdue] == ["short", "after short"]


def test_computing_is_spared_on_a_busy_machine_up_to_a_bound_and_for_no_longer_than_its_own() -> (
    None
):
    clock, busy = Clock(), Clock()

    def after(passed_s: float, worked_s: float) -> list[str]:
        waits = Waits(clock, busy)
        clock.pass_s(passed_s)
        busy.pass_s(worked_s)
        waits.sign()
        return [wait.name for wait in waits.overdue]

    assert after(NAMED_S + 0.5 * BUSY - 0.1, 0.5) == []
    assert after(NAMED_S + 0.5 * BUSY + 0.1, 0.5) == ["after the beginning"]
    assert after(NAMED_S + MOST_SPARED_S + 0.1, 1.9) == ["after the beginning"]
    assert after(NAMED_S + 0.1, NAMED_S + 0.1) == ["computing after the beginning"]


def test_a_wait_within_another_is_measured_by_both() -> None:
    clock = Clock()
    waits = Waits(clock)

    def outer() -> None:
        for _ in range(4):
            waits.around("inner", 1.0, lambda: clock.pass_s(2.5))

    waits.around("outer", 5.0, outer)
    assert [wait.name for wait in waits.overdue] == ["outer"]


def test_a_phase_is_measured_by_the_time_that_it_may_last() -> None:
    clock = Clock()
    waits = Waits(clock)
    for _ in range(40):
        waits.phase(Phase.LIFT, 30.0)
        clock.pass_s(1.0)
    assert [wait.name for wait in waits.overdue] == ["phase lift"]


def test_plans_are_always_the_same_and_spoil_every_wire_in_every_way() -> None:
    plans = [drawn(number) for number in range(ALL)]
    assert [drawn(number) for number in range(ALL)] == plans
    troubles = [trouble for plan in plans for trouble in plan.troubles]
    assert {trouble.wire for trouble in troubles} == set(WIRES)
    for kind in Trouble.__struct_fields__[3:]:
        assert {t.wire for t in troubles if getattr(t, kind)} == set(WIRES)


def test_force_bytes_are_read_from_whole_frames_however_they_come() -> None:
    image = bytes([9, 0, 0, 60, 255, 150, 0, 0, 20, 0, 0, 0, 0, 0, 0, 0])
    pdu = bytes([16, 0, 0, 0, 8, 16]) + image
    frame = bytes([0, 1, 0, 0, 0, len(pdu) + 1, 2]) + pdu
    later = bytes([0, 2, 0, 0, 0, 9, 2, 16, 0, 2, 0, 1, 2, 0, 199])  # rFRA alone, by its register
    passed = Passed()
    commands = Commands(passed)
    for byte in frame + later:
        commands.take(bytes([byte]))
    assert (passed.writes, passed.most_force) == (2, 199)


async def echoed(trouble: Trouble, sent: bytes) -> tuple[bytes, float, Passed]:
    """What comes back from an echo behind the proxy, after how long."""

    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(1024):
            writer.write(data)
        writer.close()

    server = await asyncio.start_server(echo, "127.0.0.1", 0)
    to = server.sockets[0].getsockname()[:2]
    order = Order(Plan(0, (trouble,)), (Route("arm", ("127.0.0.1", 0), to),))
    proxy = Proxy(order)
    there = await proxy.serve(order.routes[0])
    reader, writer = await asyncio.open_connection(*there.sockets[0].getsockname()[:2])
    start_s = asyncio.get_running_loop().time()
    writer.write(sent)
    writer.write_eof()
    try:
        back = await reader.read(-1)
    except ConnectionResetError:
        back = b""
    passed_s = asyncio.get_running_loop().time() - start_s
    writer.close()
    for each in (there, server):
        each.close()
    return back, passed_s, proxy.passed


def test_the_proxy_does_what_its_plan_says() -> None:
    def through(wire: str = "arm", **values: float) -> tuple[bytes, float, Passed]:
        return asyncio.run(echoed(Trouble(wire, 0.0, 60.0, **values), b"abcdef"))  # type: ignore[arg-type]

    back, _, passed = through("gripper", reset_share=1.0)
    assert (back, passed.spoilt) == (b"abcdef", 0)
    back, passed_s, _ = through(latency_s=0.1)
    assert back == b"abcdef" and passed_s >= 0.2
    back, passed_s, _ = through(bytes_per_s=60.0)
    assert back == b"abcdef" and passed_s >= 0.2
    back, _, passed = through(slice_bytes=2)
    assert back == b"abcdef" and passed.pieces >= 6
    back, _, passed = through(twice_share=1.0)
    assert back.startswith(b"abcdefabcdef") and len(back) > 12
    back, _, passed = through(reset_share=1.0)
    assert (back, passed.resets) == (b"", 1)
