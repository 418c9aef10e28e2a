"""The speed slider: a move keeps its way and takes longer, whenever it is turned."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.ur.model import SLIDER_S, ArmModel, ArmModelSettings

MS = 1_000_000
START = (0.5, 0.1, 0.3)
ABOVE = (0.5, 0.1, 0.5)
SPEED, RAMP = 0.1, 0.5
STEP = 0.008 / SLIDER_S  # of the pace, in a cycle

turns = st.lists(
    st.tuples(st.integers(0, 4_000), st.floats(0.1, 1.0)), max_size=6
)  # when, ms, and to where


def arm() -> ArmModel:
    return ArmModel(ArmModelSettings(), 0, command_latency_s=0.0)


def rising(model: ArmModel, at_ms: int = 0) -> ArmModel:
    assert model.move_l(ABOVE, SPEED, RAMP, at_ms * MS)
    return model


def turned(model: ArmModel, commands: list[tuple[int, float]]) -> ArmModel:
    for t_ms, fraction in sorted(commands):
        model.turn_slider(fraction, t_ms * MS)
    return model


def test_arm_stands_while_the_slider_is_at_nought_and_then_goes_on() -> None:
    model = turned(rising(arm()), [(500, 0.0)])
    assert not model.moving(2_000 * MS)
    assert model.velocity(2_000 * MS) == (0.0, 0.0, 0.0)
    assert model.position(2_000 * MS) == model.position(9_000 * MS)
    assert START[2] < model.position(9_000 * MS)[2] < ABOVE[2]
    model.turn_slider(1.0, 9_000 * MS)
    assert model.moving(9_100 * MS)
    assert model.position(20_000 * MS) == ABOVE


@given(turns)
def test_whenever_it_is_turned_the_arm_neither_jumps_nor_turns_back_and_arrives(commands):
    model = rising(arm())
    waiting = sorted(commands)
    z, speed = START[2], 0.0
    for t_ms in range(4, 6_000, 4):
        while waiting and waiting[0][0] <= t_ms:  # before the cycle that it changes is read
            at_ms, fraction = waiting.pop(0)
            model.turn_slider(fraction, at_ms * MS)
        before, was = z, speed
        z, speed = model.position(t_ms * MS)[2], model.velocity(t_ms * MS)[2]
        assert -1e-9 <= z - before <= SPEED * 0.004 + 1e-9
        assert abs(speed - was) <= RAMP * 0.004 + STEP * SPEED + 1e-9
    assert model.position(10**12) == ABOVE


@given(st.integers(0, 2_000), st.floats(0.0, 1.0))
def test_stop_brakes_as_hard_as_it_is_told_whatever_the_slider(t_ms, fraction):
    model = rising(arm())
    model.turn_slider(fraction, t_ms * MS)
    effect_ns = -(-(t_ms + 300) // 8) * 8 * MS
    at_m, speed = model.position(effect_ns)[2], model.velocity(effect_ns)[2]
    model.stop_l(1.0, (t_ms + 300) * MS)
    gone_m = model.position(10**12)[2] - at_m
    assert gone_m == pytest.approx(speed**2 / 2.0, abs=1e-8)
