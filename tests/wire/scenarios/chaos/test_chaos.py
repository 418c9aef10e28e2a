"""Wires that delay, cut up, double and reset what passes: a lift ends in time, says why, and no
command is stronger than it may be."""

import asyncio
import os
import re
import signal
import subprocess
import sys
import time

import msgspec
import pytest

from grasp.phases import Phase
from scenarios.lift.config import LiftConfig
from scenarios.rigs.rig import calibration
from scenarios.studies.faults.declared import CANNOT_BE_TOLD
from scenarios.studies.faults.verdict import SLID_M
from scenarios.world.cell import Truth
from tests.wire.scenarios.chaos import one_lift
from tests.wire.scenarios.chaos.one_lift import Ended, config, stated_s
from tests.wire.scenarios.chaos.onlooker import STILL_MPS, Left, Look, left
from tests.wire.scenarios.chaos.plans import WIRES, Plan, Trouble, drawn
from tests.wire.scenarios.chaos.proxy import Commands, Order, Passed, Proxy, Route
from tests.wire.scenarios.chaos.waits import Wait, Waits

SLOW, ALL = 20, 200
PLANS = int(os.environ.get("CHAOS_PLANS", str(SLOW)))  # `make faults` asks for all of them
FROM = int(os.environ.get("CHAOS_FROM", "0"))
GONE_S = 10.0  # for the interpreter to end, on a busy machine too
MOST_N = 11.5  # of wires in wall time, as in docs/faults.md
QUIET, GRIPPER = 8, 2  # plans: hardly any trouble of the fingertips; of the gripper alone
KINDS = {"", "link_lost", "device_fault", "stale", "doubted", "safety_stop", "refused"}


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
    if lifting.returncode or "Traceback" in complaint:
        return f"{drawn(number)}: {lifting.returncode}: {complaint[-2000:]}"
    ended = msgspec.json.decode(said.splitlines()[-1], type=Ended)
    print(drawn(number), "|", ended.outcome, ended.kind, ended.message, f"{ended.seconds:.1f} s",
          f"{ended.peak_n:.1f} N |", ended.end, "|", ended.left, "|", ended.tightest, ended.passed,
          flush=True)  # fmt: skip
    found = problems(ended, settings)
    if time.monotonic() - ended.told_s > GONE_S:
        found.append(f"its process ended {time.monotonic() - ended.told_s:.1f} s later")
    return f"{drawn(number)}: {'; '.join(found)}" if found else ""


def problems(ended: Ended, settings: LiftConfig) -> list[str]:
    """What was not as it must be."""
    cap, left = calibration(settings).byte_at_most(settings.guard.force_limit_n), ended.left
    most_s = stated_s(settings)
    checks = {
        f"force byte {ended.passed.most_force} of {cap}": ended.passed.most_force > cap,
        f"{ended.peak_n:.1f} N": ended.peak_n > MOST_N,
        f"{ended.seconds:.1f} s": ended.seconds > most_s,
        f"waited too long: {', '.join(map(str, ended.overdue))}": bool(ended.overdue),
        f"the arm moves at {left.arm_mps:.4f} m/s after the end": left.arm_mps > STILL_MPS,
        f"fingers move at {left.fingers_mps:.4f} m/s after the end": left.fingers_mps > STILL_MPS,
        f"the object: {dropped(left)}; told {ended.message}; {ended.end}": bool(dropped(left))
        and not could_not_be_held(ended),
        f"{left.object}, in {left.looks} looks": not (left.looks or ended.outcome == "not opened"),
        f"kind {ended.kind}: {ended.message}": ended.kind not in KINDS,
        "no word": ended.outcome in ("fault", "not opened") and not ended.message,
        "ended by the time-out of the run": "did not end in time" in ended.message,
    }  # fmt: skip
    return [text for text, is_wrong in checks.items() if is_wrong]


def dropped(left: Left) -> str:
    """An object that the hand had in the air is let go there, or slides down and out."""
    if left.let_go_m:
        return f"let go at {left.let_go_m * 1e3:.0f} mm"
    if left.slid_m > SLID_M:
        return f"slid {left.slid_m * 1e3:.0f} mm in the air"
    return left.object if left.object in ("slips", "falls") else ""


def could_not_be_held(ended: Ended) -> bool:
    """Only a closing could have held it, the hand could not be told, and the last line says so."""
    spoilt = any(trouble.wire == "gripper" for trouble in drawn(ended.number).troubles)
    return spoilt and re.search(CANNOT_BE_TOLD, ended.end) is not None


@pytest.mark.slow
@pytest.mark.timeout(36_000)
def test_lifts_through_wires_that_spoil_what_passes_end_in_time_and_say_why() -> None:
    found = [text for number in range(FROM, FROM + PLANS) if (text := wrong(number))]
    assert not found, "\n".join(found)


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


def seen(height_m: float, touched: bool, slip_m: float = 0.0, **more: float) -> Look:
    force_n = (2.0, 1.0, 1.0) if touched else (0.0, 0.0, 0.0)
    truth = Truth(
        t_ns=0, height_m=height_m, speed_mps=0.0, slip_distance_m=slip_m,
        slip_speed_mps=more.get("slip_mps", 0.0), normal_n=force_n, shear_n=(0.0, 0.0, 0.0),
        peak_n=force_n, slip_onset_s=None, force_rise_s=None, flank_slope=0.0,
    )  # fmt: skip
    return Look(truth, more.get("arm_mps", 0.0), more.get("fingers_mps", 0.0))


HELD = [seen(0.0, True), seen(0.03, True), seen(0.06, True, 0.002), seen(0.06, True, 0.002)]
LET_GO = [*HELD, seen(0.05, False), seen(0.0, False)]


def test_what_became_of_the_object_is_told_by_the_cell_alone() -> None:
    held = left(HELD, 3)
    assert (held.object, held.let_go_m, dropped(held)) == ("held in the air", 0.0, "")
    assert held.slid_m == pytest.approx(0.002) and held.lifted_m == 0.06
    let_go = left(LET_GO, 4)
    assert (let_go.object, dropped(let_go)) == ("on the table", "let go at 60 mm")
    set_down = left([*HELD, seen(0.0, True), seen(0.0, False)], 5)
    assert (set_down.object, dropped(set_down)) == ("on the table", "")
    assert "slid 30 mm" in dropped(left([*HELD, seen(0.03, True, 0.03)], 4))
    slides = left([*HELD, seen(0.059, True, 0.003, slip_mps=0.02)], 4)
    assert dropped(slides) == "slips"


def ended(**changed: object) -> Ended:
    """A lift through the plan that spoils the fingertips' wire, and ended as it must."""
    plain = Ended(
        QUIET, "fault", "stale", "stale: no fresh fingertip sample", "the arm stands; closed", 9.0,
        10.1, left(HELD, 3), [], Wait("after wait_placed", 0.2, 0.0), 0.0, Passed(),
    )  # fmt: skip
    return msgspec.structs.replace(plain, **changed)


def test_what_must_not_be_after_a_lift_is_found() -> None:
    settings = config()
    assert problems(ended(), settings) == []
    moves = left([*HELD, seen(0.06, True, 0.002, arm_mps=0.01)], 4)
    assert problems(ended(left=moves), settings) == ["the arm moves at 0.0100 m/s after the end"]
    closes = left([*HELD, seen(0.06, True, 0.002, fingers_mps=0.02)], 4)
    assert "fingers move at 0.0200" in problems(ended(left=closes), settings)[0]
    assert "let go at 60 mm" in problems(ended(left=left(LET_GO, 4)), settings)[0]
    assert "never there" in problems(ended(left=Left()), settings)[0]
    late = [Wait("ThreadedGripper.stop", 8.0, 5.0)]
    assert "ThreadedGripper.stop: 8.0 s" in problems(ended(overdue=late), settings)[0]


def test_an_object_may_fall_only_where_the_hand_could_not_be_told_and_the_last_line_says_so() -> (
    None
):
    settings, lost = config(), left(LET_GO, 4)
    said = "the arm stands; the hand cannot be told anything and holds by itself: it is closed"
    assert problems(ended(number=GRIPPER, left=lost, end=said), settings) == []
    assert problems(ended(number=GRIPPER, left=lost), settings)  # not said
    assert problems(ended(left=lost, end=said), settings)  # another wire


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
