"""The reflex holds what a policy would drop, within the force limit; `grasp/Lift-v0` follows the
API of gymnasium."""

import sys
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import gymnasium
import msgspec
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

import grasp
from drivers.errors import ConfigError, Refused, UsageError
from drivers.interfaces import PERIOD_NS, Detection
from grasp.control.commands import CloseToLimit, HoldFingers, MoveFingers
from grasp.control.states import State
from grasp.policy_reflex import AT_REST, PolicyCommand
from scenarios.campaign.config import load_config
from scenarios.library.lift_environment import LiftEnvironment

OPEN = MoveFingers((0, 0, 0), 0.022, 10.0)
UP = (0.0, 0.0, 0.1)


@pytest.fixture
def held() -> LiftEnvironment:
    """A can that the reflex holds 5 cm above the table; steps of the reflex move nothing."""
    env = LiftEnvironment("can")
    obs, info = env.reset(seed=0)
    while info["height_m"] < 0.05:
        lifts = float(info["admitted"].held)
        obs, _, _, _, info = env.step(np.array([*closing(obs), lifts], np.float32))
    return env


def test_environment_follows_gymnasium() -> None:
    check_env(gymnasium.make("grasp.gym:grasp/Lift-v0").unwrapped)


def test_missing_gymnasium_is_one_line_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "grasp.gym", raising=False)
    with pytest.raises(
        ImportError, match=r"^gymnasium is missing: make install-gym, or .*\[gym\]'$"
    ):
        __import__("grasp.gym")


def closing(obs: dict[str, Any]) -> NDArray[np.float64]:
    """Action of the fingers that ends in a weak grip of the can."""
    return np.clip((55 - obs["fingers"]) / 5, -1.0, 1.0)


@pytest.mark.parametrize(("lift_at", "open_at"), [(200, 600), (100, 600), (200, 400)])
def test_reflex_holds_what_a_careless_policy_loses(lift_at: int, open_at: int) -> None:
    ends = []
    for reflex in (False, True):
        env = LiftEnvironment("can", reflex=reflex)
        obs, info = env.reset(seed=1)
        for step in range(600):
            fingers = -np.ones(3) if step > open_at else closing(obs)
            obs, _, _, _, info = env.step(np.array([*fingers, step > lift_at], np.float32))
        ends.append((info["held"], info["peak_force_n"] < 11.0))
    assert ends == [(False, True), (True, True)]


@pytest.mark.parametrize("name", ["jar", "orange"])
def test_closed_fingers_that_come_down_on_an_object_press_within_the_limit(name: str) -> None:
    for reflex, within in ((False, False), (True, True)):
        env = LiftEnvironment(name, reflex=reflex)
        env.reset(seed=0)
        for step in range(900):
            fingers = -1.0 if step < 90 else 1.0
            arm = 1.0 if step < 90 else 0.0 if step < 300 else -1.0
            *_, info = env.step(np.array([fingers, fingers, fingers, arm], np.float32))
        assert info["peak_force_n"] > 0.0 and (info["peak_force_n"] < 11.0) == within


def test_after_a_fault_the_hand_closes_and_the_arm_stops_until_a_reset(
    held: LiftEnvironment,
) -> None:
    reflex, states = held.reflex, held.states()
    late_ns = states[0].t_ns + 1_000_000_000
    up = PolicyCommand(hand=OPEN, arm_velocity_mps=UP)
    fault = reflex.step(*states, up, t_ns=late_ns)
    assert fault.state is State.FAULT and "gripper status too old" in fault.faults[0].line
    assert isinstance(fault.hand, CloseToLimit) and fault.hand.force_limit_n == 10.0
    again = reflex.step(*states, up, t_ns=late_ns)
    assert again.faults == fault.faults and again.arm_velocity_mps == AT_REST
    assert again.hand is None
    reflex.reset()
    assert reflex.step(*states, up, t_ns=states[0].t_ns).faults == ()


def test_fingers_that_are_to_move_but_stand_still_do_not_hide_slip(held: LiftEnvironment) -> None:
    frame, gripper, arm = held.states()
    replace = msgspec.structs.replace
    fingers = [replace(f, detection=Detection.MOVING) for f in gripper.fingers]
    moving = replace(gripper, fingers=tuple(fingers))
    hold = PolicyCommand(hand=HoldFingers())
    for k in range(3):
        admitted = held.reflex.step(frame, moving, arm, hold, t_ns=frame.t_ns + k * PERIOD_NS)
        assert admitted.held and not admitted.slip.masked


def test_the_hand_closes_although_the_arm_refuses_its_command(held: LiftEnvironment) -> None:
    admitted = held.reflex.step(*held.states(), PolicyCommand(hand=HoldFingers()))
    closing = CloseToLimit(10.0, (True, True, True), (255, 255, 255), 0.022)
    admitted = msgspec.structs.replace(admitted, hand=closing, arm_velocity_mps=(0.0, 0.0, -9.0))
    arm, gripper = Mock(), Mock()
    arm.drive.side_effect = Refused("too fast", "slower")
    with pytest.raises(Refused):
        admitted.send(gripper, arm)
    assert gripper.method_calls


def test_time_that_goes_back_is_refused(held: LiftEnvironment) -> None:
    states, hold = held.states(), PolicyCommand(hand=HoldFingers())
    held.reflex.step(*states, hold)
    with pytest.raises(UsageError, match="time went back"):
        held.reflex.step(*states, hold, t_ns=states[0].t_ns - 1)


def test_force_and_speed_of_a_policy_are_limited_in_free_air() -> None:
    env = LiftEnvironment("can")
    env.reset(seed=0)
    _, gripper, arm = env.states()
    strong = PolicyCommand(hand=MoveFingers((60, 60, 60), 0.11, 60.0))
    counts = np.zeros((3, 6), np.int16)
    admitted = grasp.reflex(detector="energy").step(
        counts, gripper, arm, strong, t_ns=env.states()[0].t_ns
    )
    assert admitted.hand == MoveFingers((60, 60, 60), 0.022, 10.0)
    assert admitted.refused == ("force 60 N: the limit is 10 N",)
    weak = PolicyCommand(hand=MoveFingers((60, 60, 60), 0.022, 2.0))
    admitted = grasp.reflex(detector="energy").step(
        counts, gripper, arm, weak, t_ns=env.states()[0].t_ns
    )
    assert admitted.hand == MoveFingers((60, 60, 60), 0.022, 10.0)
    assert admitted.refused == ("force 2 N: the hand's least is 10 N",)
    with pytest.raises(UsageError, match="counts have no time"):
        grasp.reflex().step(counts, gripper, arm, strong)


def test_a_force_limit_that_the_hand_cannot_keep_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"settings: guard\.force_limit_n"):
        grasp.reflex(force_limit_n=1000.0)
    for by_force in ({"guard.limit_mode": "each_motor"}, {"controller.first_grasp": "counts"}):
        with pytest.raises(ConfigError, match="cannot close with less than 10 N"):
            grasp.reflex(force_limit_n=5.0, settings={**by_force, "controller.grip_force_n": 10.0})


@pytest.mark.parametrize("name", ["can", "ball", "box", "cardboard", "foam", "football"])
def test_environment_starts_just_short_of_an_object_of_any_width(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "thin.toml").write_text("[variation]\nwidth_error_m = -0.00385\n", encoding="utf-8")
    obs, _ = LiftEnvironment(name).reset(seed=0)
    counts = np.array(load_config(name, "simulated").object.grip_counts)
    assert np.abs(obs["fingers"] - np.maximum(6, counts - [30, 15, 15])).max() <= 2  # 6: open
    monkeypatch.setenv("GRASP_CONFIG", str(tmp_path / "thin.toml"))
    thin, info = LiftEnvironment(name).reset(seed=0)
    assert thin["fingers"][1] == obs["fingers"][1] + 5 and not info["touched"]


def test_a_hand_stronger_than_the_limit_closes_by_touch_and_lifts_within_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = '[gripper]\ncalibration = "manual"\n[hand]\nleast_force_n = 15.0\n'
    (tmp_path / "hand.toml").write_text(hand, encoding="utf-8")
    monkeypatch.setenv("GRASP_CONFIG", str(tmp_path / "hand.toml"))
    for name in ("can", "ball"):
        env = LiftEnvironment(name)
        _, info = env.reset(seed=0)
        for step in range(800):
            lifts = step > 300 and info["admitted"].held
            *_, info = env.step(np.array([1.0, 1.0, 1.0, lifts], np.float32))
            assert not info["admitted"].refused or lifts or step < 300
        assert info["held"] and info["peak_force_n"] < 11.0
