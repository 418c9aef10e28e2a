"""The control loop with fake devices, step and clock: commands, their order and their times."""

import signal
from typing import Any

import pytest

from drivers.errors import LinkLost, Refused
from grasp.control.commands import (
    BeginRest,
    CloseToLimit,
    Command,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
    StopArm,
)
from grasp.control.fault import Fault
from grasp.control.states import State
from grasp.run import signals
from grasp.run.loop import Issued
from tests.unit.grasp.builders import STOP
from tests.unit.grasp.loop_bench import MS, Bench

MOVE = MoveFingers((1, 2, 3), 0.05, 7.0)
CLOSE = CloseToLimit(9.0, (True, False, True), (4, 5, 6), 0.03)
RISE = MoveArm((0.1, 0.2, 0.3), 0.04, 0.6)


def test_each_command_reaches_its_device_with_its_arguments_in_order() -> None:
    bench = Bench()
    bench.decides = [
        (MOVE, CLOSE, OpenFingers(0.11), HoldFingers(), RISE, StopArm(3.0), BeginRest())
    ]
    bench.loop.tick()
    assert bench.verbs() == []
    bench.loop.tick()
    assert bench.verbs() == [
        ("move_to", (1, 2, 3), 0.05, 7.0),
        ("close_to_limit", 9.0, (True, False, True), (4, 5, 6), 0.03),
        ("open", 0.11), ("hold",), ("arm", (0.1, 0.2, 0.3), 0.04, 0.6), ("stop", 3.0), ("rest",),
    ]  # fmt: skip
    inputs = bench.ticks[1].issued
    assert bench.ticks[0].issued == ()
    step_ns = 10**9 + 10 * MS
    assert inputs[0] == Issued(step_ns, step_ns + 2 * MS, MOVE, MOVE, "applied move_to")  # type: ignore[arg-type]
    assert [one.applied for one in inputs] == [
        "applied move_to", "applied close_to_limit", "applied open", "applied hold",
        None, None, None,
    ]  # fmt: skip
    assert bench.loop.timing.gripper_commands_ns == [(step_ns, step_ns + 2 * MS)] * 4
    bench.loop.tick()
    assert bench.ticks[2].issued == ()


def test_gripper_is_polled_right_after_a_command() -> None:
    bench = Bench()
    bench.decides = [(MOVE,)]
    bench.loop.tick()
    bench.loop.tick()
    sent = bench.calls.index(("move_to", 10**9 + 12 * MS, (1, 2, 3), 0.05, 7.0))
    assert bench.calls[sent + 1] == ("gripper poll", 10**9 + 12 * MS, 10**9 + 12 * MS)


@pytest.mark.parametrize(("delay_s", "polled"), [(0.001, 1), (0.001000001, 2)])
@pytest.mark.parametrize("command", [RISE, StopArm(1.0)])
def test_arm_is_polled_before_a_command_unless_its_state_is_new(
    delay_s: float, polled: int, command: Command
) -> None:
    bench = Bench(decision_delay_s=delay_s)
    bench.decides = [(command,)]
    bench.loop.tick()
    bench.loop.tick()
    assert len(bench.when("arm poll")) == polled + 1
    assert len(bench.when("arm") + bench.when("stop")) == 1


@pytest.mark.parametrize(
    ("verb", "command", "device"),
    [("move_to", MOVE, "gripper"), ("arm", RISE, "arm"), ("stop", StopArm(1.0), "arm"),
     ("rest", BeginRest(), "fingertips")],
)  # fmt: skip
def test_refusal_is_passed_to_the_next_step_once_and_stored_by_device(
    verb: str, command: Command, device: str
) -> None:
    bench = Bench()
    bench.raises[verb] = refused = Refused("not now", "wait")
    bench.decides = [(command,)]
    for _ in range(3):
        bench.loop.tick()
    said, fault = f"{refused.kind}: not now", Fault.of(device, refused)
    assert [inputs.errors for inputs in bench.inputs] == [(), (fault,), ()]
    assert bench.ticks[1].issued[0].refused == said
    assert bench.ticks[1].issued[0].applied is None
    assert bench.loop.errors == {device: fault}


def test_gripper_is_lost_until_it_responds_again() -> None:
    bench = Bench()
    for error in (None, LinkLost("gone", "look"), Refused("hot", "wait"), None):
        bench.raises = {} if error is None else {"gripper poll": error}
        bench.loop.tick()
    assert [inputs.gripper_lost for inputs in bench.inputs] == [False, True, True, False]


def test_step_gets_pending_commands_lateness_and_last_duration() -> None:
    bench = Bench(decision_delay_s=0.015)
    bench.decides = [(MOVE,)]
    bench.loop.tick()
    bench.loop.tick()
    bench.loop.tick()
    assert [inputs.pending for inputs in bench.inputs] == [False, True, False]
    assert [inputs.t_ns for inputs in bench.inputs] == [10**9 + n * 10 * MS for n in (1, 2, 3)]
    decide = bench.step.decide

    def slowly(inputs: Any) -> Any:
        bench.clock.sleep_until_ns(bench.clock.now_ns + 27 * MS)
        return decide(inputs)

    bench.step.decide = slowly
    bench.loop.tick()
    bench.step.decide = decide
    bench.loop.tick()
    late = bench.inputs[-1]
    assert (late.took_ns, late.late_ns) == (27 * MS, 17 * MS)
    assert bench.loop.timing.missed_periods == 1
    bench.loop.tick()
    assert (bench.inputs[-1].took_ns, bench.inputs[-1].late_ns) == (0, 0)


def test_blocking_device_reads_count_as_lateness() -> None:
    bench = Bench()
    bench.loop.tick()
    bench.hand.poll = lambda _: bench.clock.sleep_until_ns(bench.clock.now_ns + 400 * MS)
    bench.loop.tick()
    assert (bench.inputs[-1].t_ns, bench.inputs[-1].late_ns) == (10**9 + 20 * MS, 400 * MS)


def test_run_ends_with_its_controller_or_at_its_deadline() -> None:
    bench = Bench()
    bench.controller.finished = True
    bench.loop.run(1.0)
    assert bench.inputs == []
    late = Bench(stop_s=0.2)
    late.loop.run(0.05)
    said = [inputs.stop and inputs.stop.code for inputs in late.inputs]
    assert said == [None] * 5 + ["run_timeout"] * 20
    slow_arm = Bench(stop_s=0.2)
    slow_arm.controller.arm_delay_ns = 30_000_000.0  # because of a slow arm
    slow_arm.loop.run(0.05)
    assert [inputs.stop is not None for inputs in slow_arm.inputs][:9] == [False] * 8 + [True]


@pytest.mark.parametrize(
    ("phase", "kept"), [(State.COMPENSATE, ["close_to_limit"]), (State.LIFT, [])]
)
def test_stop_drops_queued_commands_except_a_closing_for_slip(
    phase: State, kept: list[str]
) -> None:
    bench = Bench(decision_delay_s=0.005, stop_s=0.2)
    bench.decides = [(CLOSE, RISE, MOVE)]
    bench.loop.tick()
    bench.controller.state = phase
    bench.loop.stop(STOP)
    assert [name for name, *_ in bench.verbs()] == kept


def test_a_move_decided_before_a_safe_state_is_not_sent_in_it() -> None:
    bench = Bench(decision_delay_s=0.02)
    bench.decides = [(RISE,), (StopArm(2.0),)]
    bench.loop.tick()
    bench.controller.state = State.LOST
    for _ in range(5):
        bench.loop.tick()
    assert [name for name, *_ in bench.verbs()] == ["stop"]


def test_on_a_wall_clock_commands_are_sent_and_acknowledged_before_observers_run() -> None:
    bench = Bench(wall=True, decision_delay_s=0.001, observer_reserve_s=0.004)
    bench.hand.acknowledged = False
    bench.decides = [(MOVE,)]
    bench.loop.tick()
    assert bench.verbs() == [("move_to", (1, 2, 3), 0.05, 7.0)]
    assert bench.when("move_to") == [10**9 + 11 * MS]
    assert bench.clock.now_ns == 10**9 + 16 * MS
    assert len(bench.ticks[0].issued) == 1
    bench.loop.tick()
    assert bench.clock.now_ns == 10**9 + 20 * MS, "nothing was sent, nothing is waited for"


def test_submitted_command_is_due_at_once_and_admitted_by_the_step() -> None:
    bench = Bench()
    bench.step.admit = lambda command, state: HoldFingers()
    bench.loop.submit(MOVE)
    bench.loop.tick()
    assert bench.verbs() == [("hold",)]
    assert bench.when("hold") == [10**9]
    (issued,) = bench.ticks[0].issued
    assert (issued.requested, issued.admitted) == (MOVE, HoldFingers())
    assert issued.decided_ns == issued.sent_ns == 10**9


def test_each_step_sets_the_fallback_of_the_gripper_thread() -> None:
    bench = Bench(wall=True)
    bench.fallback = CLOSE
    bench.loop.tick()
    ((command, words),) = bench.fallbacks
    assert words == "close AC at 30 mm/s, at most 9 N"
    command(bench.hand)
    assert bench.verbs() == [("close_to_limit", 9.0, (True, False, True), (4, 5, 6), 0.03)]
    bench.fallback = None
    bench.loop.tick()
    assert bench.fallbacks[1:] == [(None, "")]


@pytest.mark.parametrize("end", ["stop", "fail", "abort"])
def test_after_a_run_the_gripper_thread_has_no_fallback(end: str) -> None:
    bench = Bench(wall=True, stop_s=0.2, abort_s=0.1)
    bench.loop.tick()
    getattr(bench.loop, end)(*([] if end == "abort" else [STOP]))
    assert bench.fallbacks[0][0] is not None
    assert bench.fallbacks[-1] == (None, "")


def test_a_signal_ends_a_run_between_two_ticks() -> None:
    bench = Bench()
    decide = bench.step.decide

    def signalled(inputs: Any) -> Any:
        if len(bench.inputs) == 3:
            signal.raise_signal(signal.SIGTERM)
        return decide(inputs)

    bench.step.decide = signalled
    with signals.taken(), pytest.raises(signals.Interruption):
        bench.loop.run(1.0)
    assert len(bench.inputs) == len(bench.ticks) == 4, "that tick was not cut in two"


def test_an_unconfirmed_safe_state_ends_after_the_stop_time() -> None:
    bench = Bench(stop_s=2.0)
    bench.loop.tick()
    began_ns = bench.clock.now_ns
    bench.loop.fail(STOP)
    assert bench.clock.now_ns - began_ns == 2 * 10**9
