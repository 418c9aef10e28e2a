"""Wires that delay, cut up, double and reset what passes: a lift ends in time, says why, and no
command is stronger than it may be."""

import asyncio
import os
import signal
import subprocess
import sys

import msgspec
import pytest

from scenarios.rigs.rig import calibration
from tests.wire.scenarios.chaos import one_lift
from tests.wire.scenarios.chaos.one_lift import Ended, config, stated_s
from tests.wire.scenarios.chaos.plans import WIRES, Plan, Trouble, drawn
from tests.wire.scenarios.chaos.proxy import Commands, Order, Passed, Proxy, Route

SLOW, ALL = 20, 200
PLANS = int(os.environ.get("CHAOS_PLANS", str(SLOW)))  # `make faults` asks for all of them
FROM = int(os.environ.get("CHAOS_FROM", "0"))
MOST_N = 11.5  # of wires in wall time, as in docs/faults.md
KINDS = {"", "link_lost", "device_fault", "stale", "doubted", "safety_stop", "refused"}


def wrong(number: int) -> str:
    """What of a plan's lift was not as it must be; prints what came of it."""
    settings = config()
    most_s = stated_s(settings)
    lifting = subprocess.Popen(
        [sys.executable, "-P", "-m", one_lift.__name__, str(number)], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        said, complaint = lifting.communicate(timeout=2 * most_s)
    except subprocess.TimeoutExpired:
        os.killpg(lifting.pid, signal.SIGKILL)  # with its cell and its proxy
        _, complaint = lifting.communicate()
        return f"{drawn(number)}: did not end: {complaint[-2000:]}"
    if lifting.returncode or "Traceback" in complaint:
        return f"{drawn(number)}: {lifting.returncode}: {complaint[-2000:]}"
    ended = msgspec.json.decode(said.splitlines()[-1], type=Ended)
    print(drawn(number), "|", ended.outcome, ended.kind, ended.message, f"{ended.seconds:.1f} s",
          f"{ended.peak_n:.1f} N", ended.passed, flush=True)  # fmt: skip
    cap = calibration(settings).byte_at_most(settings.guard.force_limit_n)
    checks = {
        f"force byte {ended.passed.most_force} of {cap}": ended.passed.most_force > cap,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"{ended.seconds:.1f} s": ended.seconds > most_s,
        f"kind {ended.kind}: {ended.message}": ended.kind not in KINDS,
        "no word": ended.outcome in ("fault", "not opened") and not ended.message,
        "ended by the time-out of the run": "did not end in time" in ended.message,
    }  # fmt: skip
    found = [text for text, is_wrong in checks.items() if is_wrong]
    return f"{drawn(number)}: {'; '.join(found)}" if found else ""


@pytest.mark.slow
@pytest.mark.timeout(36_000)
def test_lifts_through_wires_that_spoil_what_passes_end_in_time_and_say_why() -> None:
    found = [text for number in range(FROM, FROM + PLANS) if (text := wrong(number))]
    assert not found, "\n".join(found)


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
