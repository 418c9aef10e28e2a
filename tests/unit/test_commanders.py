"""Rules for everything that commands hand or arm, played with random events: the controller, what
it leaves to the gripper's thread, the reflex, and the hand of the lab commands."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from drivers.errors import DeviceFault, Refused
from drivers.interfaces import Counts3, Detection, GripperState
from grasp.control.commands import (
    CloseToLimit,
    Command,
    GripperCommand,
    HoldFingers,
    MoveArm,
    MoveFingers,
    OpenFingers,
)
from grasp.control.contact_estimator import Stiffness
from grasp.control.guard import ForceGuard, GuardSettings
from grasp.control.slip_response import RESPONSES
from grasp.control.states import SAFE_STATES, State
from grasp.control.step import GraspStep
from grasp.policy_reflex import AT_REST, PolicyCommand
from grasp.run.clock import VirtualClock
from scenarios.lab.hand import Hand
from tests.unit.grasp.builders import LOST, STOP, gripper
from tests.unit.grasp.controller_driver import HEIGHT, Driver
from tests.unit.scenarios.conftest import config
from tests.unit.scenarios.library.reflex_scene import ASIDE, DOWN, GRIP, HOLDS, UP, Scene, move

LIMIT_N = 10.0
OPENING = (State.SHAPE, State.OPEN)  # the hand is empty, or the object stands


class Act(NamedTuple):
    """What was sent in one step. ``at``: the hand then. ``may_open``: no object is in the hand, or
    its release was asked for."""

    hand: tuple[GripperCommand, ...]
    arm_moves: bool
    at: Counts3
    may_open: bool
    safe: bool


def opens(command: GripperCommand, at: Counts3) -> bool:
    if isinstance(command, MoveFingers):
        return any(to < now for to, now in zip(command.targets_counts, at, strict=True))
    return isinstance(command, OpenFingers)


@pytest.fixture(scope="class", params=range(12))
def acts(request: pytest.FixtureRequest) -> list[Act]:
    """One play of the commander whose tests these are."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        acts = list(request.cls().play(request.param, monkeypatch))
    assert any(act.hand for act in acts), "a commander that commands nothing proves nothing"
    return acts


class CommanderRules(ABC):
    """Inherited by the tests of each commander."""

    @abstractmethod
    def play(self, seed: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Act]:
        """Random events, and what the commander sends in each step."""

    def test_no_command_has_more_force_than_the_limit(self, acts: list[Act]) -> None:
        for command in (command for act in acts for command in act.hand):
            if isinstance(command, MoveFingers):
                assert command.force_n <= LIMIT_N
            elif isinstance(command, CloseToLimit):
                assert command.force_limit_n <= LIMIT_N

    def test_the_hand_opens_only_where_it_may(self, acts: list[Act]) -> None:
        for act in acts:
            assert act.may_open or not any(opens(command, act.at) for command in act.hand)

    def test_no_safe_state_moves_the_arm(self, acts: list[Act]) -> None:
        assert not any(act.arm_moves for act in acts if act.safe)


def anything(rng: np.random.Generator) -> Any:
    """A command of a careless or broken caller."""
    wild = (float("nan"), float("inf"), -1.0, 0.0, 60.0, 8.0)
    a, b, c = (int(n) for n in rng.integers(-20, 280, 3))
    force_n, speed_mps = (float(wild[i]) for i in rng.integers(0, len(wild), 2))
    near = tuple(int(n) for n in rng.integers(40, 80, 3))
    choices = (
        MoveFingers((a, b, c), speed_mps, force_n), MoveFingers(near, 0.02, 60.0), HoldFingers(),
        None, "close", CloseToLimit(force_n, (True,) * 3, (a, b, c), speed_mps),
    )  # fmt: skip
    return choices[rng.integers(len(choices))]


class TestController(CommanderRules):
    def play(self, seed: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Act]:
        rng, response = np.random.default_rng(seed), tuple(RESPONSES)[seed % len(RESPONSES)]
        d = Driver(
            hold_s=0.2,
            grip_force_n=60.0,
            firm=seed % 4 == 3,
            slip_response=response,
        )
        guard = ForceGuard(GuardSettings(), 2.0, Stiffness(1.9))
        step = GraspStep(SimpleNamespace(), d.controller, guard)  # type: ignore[arg-type]
        for _ in range(600):
            at, events = d.hand(), self.events(rng)
            d.height_m = self.height_m(d)
            slip = 0.9 if rng.random() < 0.2 else 0.0
            decision = d.step(slip, **{"gripper": at, **events})
            admitted = [step.admit(command, at) for command in decision.commands]
            yield self.act(step, at, decision.state, admitted)

    def height_m(self, d: Driver) -> float:
        up = {State.LIFT: d.height_m + 0.004, State.HOLD: HEIGHT, State.RETREAT: d.height_m + 0.05}
        down = {State.DESCEND: d.height_m - 0.004, State.FEEL: d.height_m - 0.001}
        return min(HEIGHT, max(0.0, {**up, **down}.get(d.controller.state, d.height_m)))

    def events(self, rng: np.random.Generator) -> dict[str, Any]:
        """At most one event a step, and rarely one that ends the run."""
        events: tuple[dict[str, Any], ...] = (
            {"estimated_n": (0.0, 0.0, 0.0)}, {"estimated_n": (14.0, 7.0, 7.0)},
            {"overloaded": True}, {"pending": True}, {"set_down": True},
        )  # fmt: skip
        if rng.random() < 0.003:
            return ({"errors": LOST}, {"stop": STOP}, {"gripper_lost": True})[rng.integers(3)]
        return events[rng.integers(len(events))] if rng.random() < 0.05 else {}

    def act(
        self, step: GraspStep[Any], at: GripperState, state: State, admitted: list[Command]
    ) -> Act:
        hand = tuple(command for command in admitted if isinstance(command, GripperCommand))
        arm_moves = any(isinstance(command, MoveArm) for command in admitted)
        return Act(hand, arm_moves, at.positions, state in OPENING, state in SAFE_STATES)


class TestFallbackOfTheGripperThread(TestController):
    def act(
        self, step: GraspStep[Any], at: GripperState, state: State, admitted: list[Command]
    ) -> Act:
        controller = step.controller
        left = step.fallback(() if controller.finished else controller.abort_commands(), at)
        return Act(() if left is None else (left,), False, at.positions, False, False)


class TestReflex(CommanderRules):
    def play(self, seed: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Act]:
        rng, scene = np.random.default_rng(seed), Scene(monkeypatch)
        scene.step(steps=HOLDS)
        for _ in range(250):
            self.change(rng, scene)
            bad = rng.random() < 0.2
            wanted = anything(rng) if bad else move(*map(int, rng.integers(45, 70, 3)))
            velocity = (UP, DOWN, ASIDE, AT_REST)[rng.integers(4)]
            held = scene.last.held
            admitted = scene.send(PolicyCommand(hand=wanted, arm_velocity_mps=velocity))
            hand = () if admitted.hand is None else (admitted.hand,)
            safe = admitted.state in SAFE_STATES
            may_open = not (held or safe)
            moves = admitted.arm_velocity_mps != AT_REST
            yield Act(hand, moves, scene.positions, may_open, safe)

    def change(self, rng: np.random.Generator, scene: Scene) -> None:
        scene.slip = float(rng.random() < 0.1)
        scene.fresh = bool(rng.random() > 0.1)
        if rng.random() < 0.05:
            scene.force_n = (GRIP, AT_REST, (12.0, 6.0, 6.0), (2.0, 0.0, 2.0))[rng.integers(4)]
        if rng.random() < 0.1:
            kinds = (Detection.AT_TARGET, Detection.MOVING, Detection.CONTACT_CLOSING)
            scene.detections = (kinds[rng.integers(3)], kinds[0], kinds[0])
        if rng.random() < 0.005:
            scene.positions = (120, 55, 55)  # a jump: implausible

    def test_a_bad_command_changes_nothing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        scene, rng = Scene(monkeypatch), np.random.default_rng(0)
        scene.step(steps=HOLDS)
        before = scene.step()
        for _ in range(200):
            wanted = PolicyCommand(hand=anything(rng), arm_velocity_mps=(0.0, float("nan"), 0.1))
            after = scene.send(wanted)
            assert (after.hand, after.arm_velocity_mps, after.held) == (None, AT_REST, True)
        assert after.state is before.state


class FakeHand:
    """A hand that reaches its targets at once, and stops a thumb on an object at 55 counts."""

    mode, least_force_n, m_per_count = 0, 2.0, 7.7e-4

    def __init__(self) -> None:
        self.sent: list[GripperCommand] = []
        self.state = gripper(positions=(6, 6, 6))

    def poll(self, now_ns: int) -> None: ...

    def move_to(self, targets: Counts3, speed_mps: float, force_n: float) -> None:
        self.sent.append(MoveFingers(targets, speed_mps, force_n))
        a, b, c = targets
        met = Detection.CONTACT_CLOSING if a > 55 else Detection.AT_TARGET
        rest = Detection.AT_TARGET
        self.state = gripper(0, (min(a, 55), b, c), (met, rest, rest), requested=targets)

    def hold(self) -> None:
        self.sent.append(HoldFingers())


class TestHandOfTheLabCommands(CommanderRules):
    def play(self, seed: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Act]:
        rng, fake = np.random.default_rng(seed), FakeHand()
        fingertips = SimpleNamespace(counts_sum=(0.0, 0.0, 0.0), poll=lambda now_ns: None)
        clock = VirtualClock(lambda t_ns: None, 10**9)
        hand = Hand(config(), fake, fingertips, clock, "grasp release")  # type: ignore[arg-type]
        for _ in range(12):
            forces_n = ((0.0, 0.0, 0.0), (2.0, 1.0, 1.0), (16.0, 8.0, 8.0))[rng.integers(3)]
            a, b, c = (-160.0 * n for n in forces_n)
            fingertips.counts_sum = (a, b, c)
            at, opening = fake.state.positions, bool(rng.random() < 0.3)
            targets = tuple(max(now, int(rng.integers(6, 90))) for now in at)
            try:
                hand.open(lambda text: None) if opening else hand.close(targets, lambda text: None)  # type: ignore[arg-type]
            except (Refused, DeviceFault):
                assert opening or not fake.sent or sum(forces_n)
            for command in fake.sent:
                yield Act((command,), False, at, opening, False)
            fake.sent.clear()

    def test_a_refused_closing_sends_nothing(self) -> None:
        fake, clock = FakeHand(), VirtualClock(lambda t_ns: None, 10**9)
        blind = Hand(config(), fake, None, clock, "grasp release")  # type: ignore[arg-type]
        with pytest.raises(Refused, match="only if the fingertips detect contact"):
            blind.close((6, 40, 40), lambda text: None)
        assert fake.sent == []
