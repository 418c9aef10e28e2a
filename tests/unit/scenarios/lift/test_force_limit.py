"""No sequence of events sends the gripper a force byte above the limit.

The bytes are checked where they reach the device: each register image that the driver writes is
decoded here independently of the driver's code.
"""

from collections.abc import Sequence
from typing import Any

import hypothesis.strategies as st
import msgspec
import numpy as np
import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from detector.decision import DecisionRule
from drivers.errors import ConfigError, LinkLost
from drivers.robotiq.driver import RegisterTransport
from grasp.control.commands import (
    CloseToLimit,
    GripperCommand,
    HoldFingers,
    MoveFingers,
    OpenFingers,
)
from grasp.control.controller import GraspController
from grasp.control.slip_monitor import SlipMonitor
from grasp.control.states import State
from grasp.control.step import GraspStep
from grasp.run.loop import ControlLoop
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.rig import Rig
from scenarios.rigs.simulated import LinkWrappers, simulated
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import grip_plan, make_guard, run_trial
from tests.unit.scenarios import checkpoint
from tests.unit.scenarios.conftest import by_default, changed

FORCE_BYTES = (5, 8, 11)
LIMIT_N = 10.0


def paper_force_n(byte: int) -> float:
    """10 N at byte 0 to 60 N at byte 255, linear (calibration `paper`)."""
    return 10.0 + 50.0 * byte / 255


class Wire:
    """Collects every register image that reaches the gripper."""

    def __init__(self, transport: RegisterTransport) -> None:
        self._inner = transport
        self.images: list[bytes] = []
        self.cut = False

    def write(self, first: int, registers: Sequence[int], now_ns: int) -> None:
        if self.cut:
            raise LinkLost("cut", "connect it")
        # registers before the first keep their values
        before = self.images[-1][: 2 * first] if self.images else bytes(2 * first)
        self.images.append(before + b"".join(r.to_bytes(2, "big") for r in registers))
        self._inner.write(first, registers, now_ns)

    def read(self, first: int, count: int, now_ns: int) -> Sequence[int]:
        if self.cut:
            raise LinkLost("cut", "connect it")
        return self._inner.read(first, count, now_ns)

    def highest_force_n(self) -> float:
        return max((paper_force_n(image[i]) for image in self.images for i in FORCE_BYTES
                    if i < len(image)), default=0.0)  # fmt: skip


def watched(config: GraspRigConfig, seed: int) -> tuple[Rig, Wire]:
    """The simulated rig and its gripper's wire."""
    wires: list[Wire] = []

    def wrap(transport: RegisterTransport) -> Wire:
        wires.append(Wire(transport))
        return wires[0]

    return simulated(config, seed, paced=False, wrappers=LinkWrappers(gripper=wrap)), wires[0]


class FixedDetector:
    """Returns the probability ``p`` for every finger."""

    def __init__(self) -> None:
        self.p = 0.0

    def reset(self) -> None: ...

    def update(self, counts: Any) -> Any:
        return np.full(3, self.p)


def greedy(config: TrialConfig, commanded_n: float) -> GraspController:
    """A controller that commands this force regardless of the limit."""
    plan = msgspec.structs.replace(grip_plan(config), force_limit_n=commanded_n)
    monitor = SlipMonitor(DecisionRule(config.rule, 3), config.slip)
    return GraspController(config.controller, plan, monitor)


def stressed(commanded_n: float, mode: str, bound: bool) -> TrialConfig:
    first_grasp, mode = ("touch", "every_finger") if mode == "touch" else ("counts", mode)
    stated = ["object.contact_stiffness_npm=2500"] if bound else []
    base = changed(by_default("hand.activation_s=0.5", *stated), "guard", limit_mode=mode)
    return changed(base, "controller", grip_force_n=commanded_n, first_grasp=first_grasp)


_started: dict[tuple[str, bool], checkpoint.Parts] = {}


def started(config: TrialConfig, to_lift: bool) -> checkpoint.Parts:
    """Rig, loop, controller, detector and wire, before the first step or at the start of the
    lift."""
    key = config.digest(), to_lift
    if key not in _started:
        rig, wire = watched(config, 0)
        detector, controller = FixedDetector(), greedy(config, config.controller.grip_force_n)
        step = GraspStep(detector, controller, make_guard(config))
        loop = ControlLoop(rig.devices, rig.clock, step, config.loop)
        for _ in range(900 * to_lift):
            if loop.tick() and controller.state is State.LIFT:
                break
        assert (controller.state is State.LIFT) == to_lift
        _started[key] = (rig, loop, controller, detector, wire)
    return _started[key]


class GraspUnderStress(RuleBasedStateMachine):
    """A lift on the simulated rig with random events; each rule is an event."""

    @initialize(
        commanded_n=st.sampled_from([10.0, 10.2, 60.0]),
        mode=st.sampled_from(["every_finger", "each_motor", "touch"]),
        bound=st.booleans(),
        to_lift=st.booleans(),
    )
    def start(self, commanded_n: float, mode: str, bound: bool, to_lift: bool) -> None:
        self.config = stressed(commanded_n, mode, bound)
        self.commanded_n = commanded_n
        parts = checkpoint.copied(started(self.config, to_lift))
        self.rig, self.loop, self.controller, self.detector, self.wire = parts

    @rule(ticks=st.integers(1, 40))
    def time_passes(self, ticks: int) -> None:
        for _ in range(ticks):
            self.loop.tick()

    @rule()
    def slip_begins(self) -> None:
        self.detector.p = 0.9
        for _ in range(self.config.rule.consecutive + 1):
            self.loop.tick()

    @precondition(lambda self: self.detector.p > 0.5)
    @rule()
    def slip_ends(self) -> None:
        self.detector.p = 0.0
        for _ in range(self.config.rule.release + 1):
            self.loop.tick()

    @rule(
        command=st.one_of(
            st.builds(
                CloseToLimit, st.floats(0, 100), st.tuples(*[st.booleans()] * 3),
                st.tuples(*[st.integers(0, 255)] * 3), st.floats(0.01, 0.2),
            ),
            st.builds(
                MoveFingers, st.tuples(*[st.integers(0, 255)] * 3), st.floats(0.01, 0.2),
                st.floats(0, 100),
            ),
            st.just(OpenFingers(0.1)),
            st.just(HoldFingers()),
        )
    )  # fmt: skip
    def controller_sends_anything(self, command: GripperCommand) -> None:
        self.loop.submit(command)
        self.loop.tick()

    @precondition(lambda self: not self.wire.cut)
    @rule(ticks=st.integers(1, 3))
    def link_fails_briefly(self, ticks: int) -> None:
        self.wire.cut = True
        for _ in range(ticks):
            self.loop.tick()
        self.wire.cut = False
        self.loop.tick()

    @rule(code=st.sampled_from([0x0B, 0x0E, 0x0F]))
    def gripper_faults(self, code: int) -> None:
        assert self.rig.cell is not None
        self.rig.cell.gripper.inject_fault(code)
        self.loop.tick()

    @precondition(lambda self: self.controller.finished)
    @rule()
    def a_new_run_begins(self) -> None:
        self.controller = greedy(self.config, self.commanded_n)
        self.loop = ControlLoop(
            self.rig.devices, self.rig.clock,
            GraspStep(self.detector, self.controller, make_guard(self.config)),
            self.config.loop,
        )  # fmt: skip
        self.loop.tick()

    @invariant()
    def no_force_byte_is_above_the_limit(self) -> None:
        if hasattr(self, "wire"):
            assert self.wire.highest_force_n() <= LIMIT_N


TestForceLimit = GraspUnderStress.TestCase
TestForceLimit.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)


def test_stress_test_finds_a_guard_without_a_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without the guard the same machine finds a byte above the limit."""
    monkeypatch.setattr("grasp.control.guard.ForceGuard.admit", lambda self, command, *_: command)
    machine = GraspUnderStress()
    machine.start(60.0, "every_finger", bound=False, to_lift=True)
    machine.slip_begins()
    machine.time_passes(5)
    with pytest.raises(AssertionError):
        machine.no_force_byte_is_above_the_limit()


def test_response_to_slip_by_the_default_detector_sends_no_byte_above_the_limit() -> None:
    made = by_default()
    rig, wire = watched(made, 0)
    trial = run_trial(made, rig, make_guard(made), lambda *_: None)
    assert State.COMPENSATE in [c.phase for c in trial.controller.machine.log]  # slip registered
    assert wire.highest_force_n() == LIMIT_N


def test_force_that_the_calibration_cannot_set_is_refused_before_anything_moves() -> None:
    with pytest.raises(ConfigError) as caught:
        make_guard(changed(by_default(), "controller", grip_force_n=9.99))
    assert caught.value.key == "grip_force_n"
