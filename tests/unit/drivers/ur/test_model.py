"""Arm model: closed-form trapezoids, commands at controller cycles, stops at any time."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.ur.model import ArmModel
from drivers.ur.settings import ArmModelSettings

MS = 1_000_000
CYCLE_NS = 8 * MS
START = (0.5, 0.1, 0.3)

coordinates = st.floats(-0.4, 0.4)
targets = st.tuples(coordinates, coordinates, coordinates)
speeds = st.floats(0.005, 1.0)
accelerations = st.floats(0.05, 5.0)
instants = st.integers(0, 3_000 * MS)


def arm(command_latency_s: float = 0.0) -> ArmModel:
    return ArmModel(ArmModelSettings(), 0, command_latency_s)


def above(height_m: float) -> tuple[float, float, float]:
    return START[0], START[1], START[2] + height_m


def trapezoid(distance: float, v: float, a: float, t: float) -> float:
    """Distance after t of a trapezoidal speed profile."""
    if v * v / a > distance:
        v = math.sqrt(a * distance)
    ramp, end = v / a, distance / v + v / a
    t = min(max(t, 0.0), end)
    if t < ramp:
        return 0.5 * a * t * t
    if t < end - ramp:
        return v * (t - 0.5 * ramp)
    return distance - 0.5 * a * (end - t) ** 2


def settle(model: ArmModel) -> tuple[float, float, float]:
    return model.at(10**13).position_m


@given(targets, speeds, accelerations, instants)
def test_a_move_from_rest_is_the_textbook_trapezoid_and_ends_exactly_at_its_target(
    target, speed, acceleration, t_ns
):
    model = arm()
    assert model.move_l(target, speed, acceleration, 0)
    travelled = math.dist(model.at(t_ns).position_m, START)
    expected = trapezoid(math.dist(START, target), speed, acceleration, t_ns * 1e-9)
    assert travelled == pytest.approx(expected, abs=1e-8)
    assert settle(model) == target
    assert model.at(10**13).velocity_mps == (0.0, 0.0, 0.0)


@given(targets, speeds, accelerations, instants, accelerations)
def test_stopping_distance_is_v_squared_over_2a_along_the_line(
    target, speed, acceleration, stop_ns, deceleration
):
    model = arm()
    model.move_l(target, speed, acceleration, 0)
    effect_ns = -(-stop_ns // CYCLE_NS) * CYCLE_NS
    at_m, v = model.at(effect_ns).position_m, math.hypot(*model.at(effect_ns).velocity_mps)
    model.stop_l(deceleration, stop_ns)
    rest_m = settle(model)
    assert math.dist(at_m, rest_m) == pytest.approx(v * v / (2 * deceleration), abs=1e-8)
    assert math.dist(START, at_m) + math.dist(at_m, rest_m) == pytest.approx(
        math.dist(START, rest_m), abs=1e-8
    )


commands = st.lists(
    st.tuples(
        st.sampled_from(["move", "up", "stop", "trip"]),
        st.integers(0, 400 * MS),  # since the previous command
        targets,
        speeds,
        accelerations,
    ),
    min_size=1,
    max_size=8,
)


def execute(model: ArmModel, commands) -> tuple[list[int], float, float]:
    """Execute the commands; returns their times, the highest speed and acceleration commanded."""
    now_ns, times, v, a = 0, [0], 0.0, 0.0
    for verb, pause_ns, target, speed, acceleration in commands:
        now_ns += pause_ns
        times.append(now_ns)
        v, a = max(v, speed), max(a, acceleration)
        if verb == "stop":
            model.stop_l(acceleration, now_ns)
        elif verb == "trip":
            a = max(a, 8.0)
            model.trip(now_ns)
            model.release()
        else:
            place = target if verb == "move" else above(abs(target[2]))
            model.move_l(place, speed, acceleration, now_ns)
    return times, v, a


@given(commands, instants, st.integers(1, 5 * MS))
def test_position_and_velocity_are_continuous_under_any_commands(commands, t_ns, dt_ns):
    model = arm()
    _, v, a = execute(model, commands)
    dt = dt_ns * 1e-9
    before, after = model.at(t_ns).position_m, model.at(t_ns + dt_ns).position_m
    assert math.dist(before, after) <= v * dt + 1e-8
    assert math.hypot(*model.at(t_ns).velocity_mps) <= v + 1e-8
    change = math.dist(model.at(t_ns).velocity_mps, model.at(t_ns + dt_ns).velocity_mps)
    assert change <= a * dt + 1e-7


def test_a_command_takes_effect_at_the_first_cycle_after_its_latency():
    model = arm(0.002)
    model.move_l(above(0.1), 0.1, 0.5, 7 * MS)
    assert model.at(16 * MS).position_m == START
    assert model.at(17 * MS).position_m[2] > START[2]


def test_a_protective_stop_brakes_hard_and_refuses_moves_until_released():
    model = arm()
    model.move_l(above(0.2), 0.2, 1.0, 0)
    model.trip(400 * MS)
    stopped = settle(model)
    assert stopped[2] - model.at(400 * MS).position_m[2] == pytest.approx(0.2**2 / (2 * 8.0))
    assert not model.move_l(above(0.2), 0.2, 1.0, 600 * MS)
    assert settle(model) == stopped
    assert model.read(600 * MS).protective_stop
    model.release()
    assert model.move_l(above(0.2), 0.2, 1.0, 700 * MS)
    assert settle(model) == above(0.2)


# drives


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.2, 5), instants, instants)
def test_the_tool_angle_is_the_integral_of_its_spin(first, second, acceleration, change_ns, t_ns):
    model = arm()
    model.speed_l((0.0, 0.0, 0.0), first, acceleration, 0)
    model.speed_l((0.0, 0.0, 0.0), second, acceleration, change_ns)
    dt_ns = MS
    turned = model.at(t_ns + dt_ns).angle_rad - model.at(t_ns).angle_rad
    mean = 0.5 * (model.at(t_ns).spin_radps + model.at(t_ns + dt_ns).spin_radps)
    assert turned == pytest.approx(mean * 1e-3, abs=acceleration * 1e-6)
    change = abs(model.at(t_ns + dt_ns).spin_radps - model.at(t_ns).spin_radps)
    assert change <= acceleration * 1e-3 + 1e-7
    assert model.at(t_ns).position_m == START


@pytest.mark.parametrize("verb", ["stop", "move"])
def test_a_stop_and_a_move_end_a_drive_and_its_spin(verb):
    model = arm()
    model.speed_l((0.05, 0.0, 0.0), 1.0, 1.0, 0)
    if verb == "stop":
        model.stop_l(1.0, 2_000 * MS)
    else:
        model.move_l(START, 0.1, 1.0, 2_000 * MS)
    settle(model)
    assert model.at(60_000 * MS).spin_radps == 0.0
    sample = model.read(60_000 * MS)
    assert not sample.moving
    assert sample.angle_rad == pytest.approx(2.0, abs=0.01)  # 0.5 s up, 1.5 s, 1 s down
