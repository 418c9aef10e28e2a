"""Speed slider: a move keeps its path and takes longer, whenever the slider is moved."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.ur.model import SLIDER_S, ArmModel
from drivers.ur.settings import ArmModelSettings

MS = 1_000_000
START = (0.5, 0.1, 0.3)
ABOVE = (0.5, 0.1, 0.5)
SPEED, RAMP = 0.1, 0.5
STEP = 0.008 / SLIDER_S  # change of the scale in a cycle

slider_commands = st.lists(
    st.tuples(st.integers(0, 4_000), st.floats(0.1, 1.0)), max_size=6
)  # time in ms, and fraction


def arm() -> ArmModel:
    return ArmModel(ArmModelSettings(), 0, command_latency_s=0.0)


def rising(model: ArmModel, at_ms: int = 0) -> ArmModel:
    assert model.move_l(ABOVE, SPEED, RAMP, at_ms * MS)
    return model


def with_slider_commands(model: ArmModel, commands: list[tuple[int, float]]) -> ArmModel:
    for t_ms, fraction in sorted(commands):
        model.set_speed_slider(fraction, t_ms * MS)
    return model


def test_arm_is_at_rest_while_the_slider_is_at_zero_and_then_continues() -> None:
    model = with_slider_commands(rising(arm()), [(500, 0.0)])
    assert not model.at(2_000 * MS).moving
    assert model.at(2_000 * MS).velocity_mps == (0.0, 0.0, 0.0)
    assert model.at(2_000 * MS).position_m == model.at(9_000 * MS).position_m
    assert START[2] < model.at(9_000 * MS).position_m[2] < ABOVE[2]
    model.set_speed_slider(1.0, 9_000 * MS)
    assert model.at(9_100 * MS).moving
    assert model.at(20_000 * MS).position_m == ABOVE


@given(slider_commands)
def test_slider_changes_never_make_the_arm_jump_or_reverse_and_it_arrives(commands):
    model = rising(arm())
    waiting = sorted(commands)
    z, speed = START[2], 0.0
    for t_ms in range(4, 6_000, 4):
        while waiting and waiting[0][0] <= t_ms:  # before its cycle is read
            at_ms, fraction = waiting.pop(0)
            model.set_speed_slider(fraction, at_ms * MS)
        before, was = z, speed
        z, speed = model.at(t_ms * MS).position_m[2], model.at(t_ms * MS).velocity_mps[2]
        assert -1e-9 <= z - before <= SPEED * 0.004 + 1e-9
        assert abs(speed - was) <= RAMP * 0.004 + STEP * SPEED + 1e-9
    assert model.at(10**12).position_m == ABOVE


@given(st.integers(0, 2_000), st.floats(0.0, 1.0))
def test_stop_uses_the_commanded_deceleration_at_any_slider_position(t_ms, fraction):
    model = rising(arm())
    model.set_speed_slider(fraction, t_ms * MS)
    effect_ns = -(-(t_ms + 300) // 8) * 8 * MS
    at_m, speed = model.at(effect_ns).position_m[2], model.at(effect_ns).velocity_mps[2]
    model.stop_l(1.0, (t_ms + 300) * MS)
    braking_m = model.at(10**12).position_m[2] - at_m
    assert braking_m == pytest.approx(speed**2 / 2.0, abs=1e-8)
