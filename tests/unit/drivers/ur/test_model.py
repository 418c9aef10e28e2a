"""The arm model: closed-form trapezoids, commands at controller cycles, stops at any instant."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.ur.model import ArmModel, ArmModelSettings

MS = 1_000_000
CYCLE_NS = 8 * MS
START = (0.5, 0.1, 0.3)
PROMPT = ArmModelSettings(command_latency_s=0.0)

coordinates = st.floats(-0.4, 0.4)
targets = st.tuples(coordinates, coordinates, coordinates)
speeds = st.floats(0.005, 1.0)
accelerations = st.floats(0.05, 5.0)
instants = st.integers(0, 3_000 * MS)


def arm(settings: ArmModelSettings = PROMPT) -> ArmModel:
    return ArmModel(settings, 0)


def above(height_m: float) -> tuple[float, float, float]:
    return START[0], START[1], START[2] + height_m


def trapezoid(distance: float, v: float, a: float, t: float) -> float:
    """Distance after t, by the textbook."""
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
    return model.position(10**13)


@given(targets, speeds, accelerations, instants)
def test_a_move_from_rest_is_the_textbook_trapezoid_and_ends_exactly_at_its_target(
    target, speed, acceleration, t_ns
):
    model = arm()
    assert model.move_l(target, speed, acceleration, 0)
    travelled = math.dist(model.position(t_ns), START)
    expected = trapezoid(math.dist(START, target), speed, acceleration, t_ns * 1e-9)
    assert travelled == pytest.approx(expected, abs=1e-8)
    assert settle(model) == target
    assert model.velocity(10**13) == (0.0, 0.0, 0.0)


@given(targets, speeds, accelerations, instants, accelerations)
def test_a_stop_at_any_instant_takes_v_squared_over_2a_along_the_line(
    target, speed, acceleration, stop_ns, deceleration
):
    model = arm()
    model.move_l(target, speed, acceleration, 0)
    effect_ns = -(-stop_ns // CYCLE_NS) * CYCLE_NS
    at_m, v = model.position(effect_ns), math.hypot(*model.velocity(effect_ns))
    model.stop_l(deceleration, stop_ns)
    rest_m = settle(model)
    assert math.dist(at_m, rest_m) == pytest.approx(v * v / (2 * deceleration), abs=1e-8)
    assert math.dist(START, at_m) + math.dist(at_m, rest_m) == pytest.approx(
        math.dist(START, rest_m), abs=1e-8
    )


commands = st.lists(
    st.tuples(
        st.sampled_from(["move", "up", "stop", "trip"]),
        st.integers(0, 400 * MS),  # since the command before
        targets,
        speeds,
        accelerations,
    ),
    min_size=1,
    max_size=8,
)


def obey(model: ArmModel, commands) -> tuple[list[int], float, float]:
    """Carry out the commands; their times, the highest speed and acceleration asked for."""
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
def test_position_and_velocity_never_jump_whatever_is_commanded(commands, t_ns, dt_ns):
    model = arm()
    _, v, a = obey(model, commands)
    dt = dt_ns * 1e-9
    before, after = model.position(t_ns), model.position(t_ns + dt_ns)
    assert math.dist(before, after) <= v * dt + 1e-8
    assert math.hypot(*model.velocity(t_ns)) <= v + 1e-8
    change = math.dist(model.velocity(t_ns), model.velocity(t_ns + dt_ns))
    assert change <= a * dt + 1e-7


@given(commands, instants)
def test_height_and_rise_are_the_last_of_position_and_velocity(commands, t_ns):
    model = arm()
    obey(model, commands)
    assert model.upright(t_ns) == (model.position(t_ns)[2], model.velocity(t_ns)[2])


@given(commands)
def test_a_command_leaves_the_past_and_the_present_cycle_as_they_were(commands):
    model = arm()
    times, _, _ = obey(model, commands[:-1])
    now_ns = times[-1] + commands[-1][1]
    instants = [now_ns - 9 * MS, now_ns, -(-now_ns // CYCLE_NS) * CYCLE_NS]
    before = [(model.position(t), model.velocity(t)) for t in instants[:2]]
    cycle_m = model.position(instants[2])
    obey_last = [(commands[-1][0], now_ns, *commands[-1][2:])]
    obey(model, obey_last)
    assert [(model.position(t), model.velocity(t)) for t in instants[:2]] == before or (
        now_ns % CYCLE_NS == 0  # takes effect now: the velocity of this instant is rounded anew
    )
    assert math.dist(model.position(instants[2]), cycle_m) < 1e-8


def test_a_command_takes_effect_at_the_first_cycle_after_its_latency():
    model = arm(ArmModelSettings(command_latency_s=0.002))
    model.move_l(above(0.1), 0.1, 0.5, 7 * MS)
    assert model.position(16 * MS) == START
    assert model.position(17 * MS)[2] > START[2]


def test_two_commands_within_one_cycle_do_not_make_the_tool_jump():
    model = arm()
    model.move_l(above(0.2), 0.2, 1.0, 0)
    before = model.position(401 * MS)
    model.stop_l(1.0, 401 * MS)
    model.move_l((0.5, 0.2, 0.3), 0.2, 1.0, 402 * MS)
    assert model.position(401 * MS) == before
    assert model.velocity(407 * MS)[2] == pytest.approx(0.2)


def test_a_move_on_along_the_line_keeps_the_speed():
    model = arm()
    model.move_l(above(0.1), 0.1, 0.5, 0)
    model.move_l(above(0.2), 0.1, 0.5, 400 * MS)
    lowest = min(model.velocity(t * MS)[2] for t in range(400, 1900))
    assert lowest == pytest.approx(0.1)
    assert settle(model) == above(0.2)


def test_a_faster_move_on_to_a_near_target_peaks_where_the_way_allows():
    model = arm()
    model.move_l(above(0.2), 0.1, 0.5, 0)
    way = above(0.2)[2] - model.position(400 * MS)[2]
    model.move_l(above(0.2), 1.0, 0.5, 400 * MS)
    speeds = [model.velocity(t * 100_000)[2] for t in range(4000, 16000)]
    assert max(speeds) == pytest.approx(math.sqrt(0.5 * way + 0.1**2 / 2), abs=1e-4)
    assert np.abs(np.diff(speeds)).max() < 0.5 * 1.01e-4
    heights = [model.position(t * 100_000)[2] for t in range(4000, 16000)]
    assert np.abs(np.diff(heights)).max() < max(speeds) * 1.01e-4
    assert settle(model) == above(0.2)


def test_a_slower_move_on_along_the_line_brakes_to_its_speed_only():
    model = arm()
    model.move_l(above(0.2), 0.2, 1.0, 0)
    model.move_l(above(0.2), 0.05, 1.0, 400 * MS)
    assert model.velocity(800 * MS)[2] == pytest.approx(0.05)
    assert settle(model) == above(0.2)


def test_a_move_aside_stops_on_the_present_line_first():
    model = arm()
    model.move_l(above(0.2), 0.1, 0.5, 0)
    corner = model.position(400 * MS)[2] + 0.1**2 / (2 * 0.5)
    model.move_l((0.6, 0.1, 0.3), 0.1, 0.5, 400 * MS)
    assert model.position(600 * MS) == pytest.approx((0.5, 0.1, corner), abs=1e-9)
    assert math.hypot(*model.velocity(600 * MS)) == pytest.approx(0.0, abs=1e-9)
    assert settle(model) == (0.6, 0.1, 0.3)


def test_a_target_too_near_to_stop_at_is_passed_and_returned_to():
    model = arm()
    model.move_l(above(0.2), 0.2, 1.0, 0)
    now = model.position(400 * MS)[2]
    near = (0.5, 0.1, now + 0.005)
    model.move_l(near, 0.2, 1.0, 400 * MS)
    assert max(model.position(t * MS)[2] for t in range(400, 900)) == pytest.approx(
        now + 0.02, abs=1e-6
    )
    assert settle(model) == near


def test_a_protective_stop_brakes_hard_and_refuses_moves_until_released():
    model = arm()
    model.move_l(above(0.2), 0.2, 1.0, 0)
    model.trip(400 * MS)
    stopped = settle(model)
    assert stopped[2] - model.position(400 * MS)[2] == pytest.approx(0.2**2 / (2 * 8.0))
    assert not model.move_l(above(0.2), 0.2, 1.0, 600 * MS)
    assert settle(model) == stopped
    assert model.read(600 * MS).protective_stop
    model.release()
    assert model.move_l(above(0.2), 0.2, 1.0, 700 * MS)
    assert settle(model) == above(0.2)


def test_a_reading_is_the_sample_of_the_last_cycle():
    model = arm()
    model.move_l(above(0.2), 0.2, 1.0, 0)
    sample = model.read(103 * MS)
    assert sample.t_ns == 96 * MS
    assert sample.position_m == model.position(96 * MS)
    assert sample.velocity_mps == model.velocity(96 * MS)
    assert sample.moving


def test_a_move_is_moving_from_its_first_cycle_to_its_last():
    model = arm()
    assert not model.read(0).moving
    model.move_l(above(0.1), 0.1, 0.5, 1 * MS)
    assert not model.read(7 * MS).moving
    assert model.read(8 * MS).moving  # although its speed is still zero
    assert not model.read(1300 * MS).moving


def test_a_move_to_where_the_tool_stands_is_no_motion():
    model = arm()
    assert model.move_l(START, 0.1, 0.5, 0)
    assert not model.read(8 * MS).moving
    assert settle(model) == START


def test_many_commands_do_not_make_the_chain_grow_without_end():
    model = arm()
    for i in range(500):
        model.move_l(above(0.1 + 0.0001 * i), 0.05, 0.5, i * 10 * MS)
    assert settle(model) == above(0.1 + 0.0001 * 499)
    assert model.position(499 * 10 * MS)[2] > model.position(498 * 10 * MS)[2] - 1e-12


# drives


def test_a_drive_takes_up_its_velocity_at_the_acceleration_and_keeps_it():
    model = arm()
    assert model.speed_l((0.03, -0.04, 0.0), 0.0, 0.5, 0)
    assert math.hypot(*model.velocity(50 * MS)) == pytest.approx(0.025)
    assert model.velocity(100 * MS) == pytest.approx((0.03, -0.04, 0.0))
    assert model.velocity(9_000 * MS) == pytest.approx((0.03, -0.04, 0.0))
    way_m = math.dist(model.position(100 * MS), START)
    assert way_m == pytest.approx(0.05 * 0.1 / 2)


def test_a_drive_goes_round_a_corner_without_standing():
    model = arm()
    model.speed_l((0.05, 0.0, 0.0), 0.0, 0.5, 0)
    model.speed_l((0.0, 0.05, 0.0), 0.0, 0.5, 500 * MS)
    effect_ns = 504 * MS
    speeds = [math.hypot(*model.velocity(effect_ns + k * MS)) for k in range(200)]
    assert min(speeds) == pytest.approx(0.05 / math.sqrt(2), rel=0.01)
    assert model.velocity(effect_ns + 200 * MS) == pytest.approx((0.0, 0.05, 0.0))


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.2, 5), instants, instants)
def test_the_tool_turns_as_its_spin_says(first, second, acceleration, change_ns, t_ns):
    model = arm()
    model.speed_l((0.0, 0.0, 0.0), first, acceleration, 0)
    model.speed_l((0.0, 0.0, 0.0), second, acceleration, change_ns)
    dt_ns = MS
    turned = model.angle(t_ns + dt_ns) - model.angle(t_ns)
    mean = 0.5 * (model.spin(t_ns) + model.spin(t_ns + dt_ns))
    assert turned == pytest.approx(mean * 1e-3, abs=acceleration * 1e-6)
    change = abs(model.spin(t_ns + dt_ns) - model.spin(t_ns))
    assert change <= acceleration * 1e-3 + 1e-7
    assert model.position(t_ns) == START


@pytest.mark.parametrize("verb", ["stop", "move"])
def test_a_stop_and_a_move_end_a_drive_and_its_spin(verb):
    model = arm()
    model.speed_l((0.05, 0.0, 0.0), 1.0, 1.0, 0)
    if verb == "stop":
        model.stop_l(1.0, 2_000 * MS)
    else:
        model.move_l(START, 0.1, 1.0, 2_000 * MS)
    settle(model)
    assert model.spin(60_000 * MS) == 0.0
    sample = model.read(60_000 * MS)
    assert not sample.moving
    assert sample.angle_rad == pytest.approx(2.0, abs=0.01)  # 0.5 s up, 1.5 s on, 1 s down


def test_no_drive_in_a_protective_stop():
    model = arm()
    model.speed_l((0.05, 0.0, 0.0), 1.0, 1.0, 0)
    model.trip(1_000 * MS)
    assert not model.speed_l((0.05, 0.0, 0.0), 1.0, 1.0, 1_010 * MS)
    sample = model.read(9_000 * MS)
    assert not sample.moving
    assert sample.spin_radps == 0.0


def test_before_its_first_instant_the_tool_stood_as_it_did_then():
    model = ArmModel(PROMPT, 100 * MS)
    model.speed_l((0.0, 0.0, 0.1), 1.0, 1.0, 100 * MS)
    assert (model.angle(50 * MS), model.spin(50 * MS)) == (0.0, 0.0)
    assert model.position(50 * MS) == START


def let_stand(model: ArmModel, from_ms: int, to_ms: int) -> None:
    """The world goes on, and nobody reads."""
    for t_ms in range(from_ms, to_ms, 5):
        model.go_on((t_ms + 5) * MS)
        model.seen((t_ms + 5) * MS)


def test_a_motion_that_nobody_reads_is_braked_as_a_drivers_worker_does_it():
    model = arm()
    model.brake_unread(0.16)
    model.move_l(above(0.4), 0.1, 1.0, 0)
    model.read(500 * MS)
    let_stand(model, 500, 1500)
    assert model.velocity(660 * MS)[2] == pytest.approx(0.1)
    assert model.velocity(800 * MS) == (0.0, 0.0, 0.0)
    braked_m = model.position(800 * MS)[2] - model.position(660 * MS)[2]
    assert braked_m == pytest.approx(0.1**2 / 2.0, abs=0.1 * 0.008)
    assert settle(model) == model.position(800 * MS)


def test_a_world_that_comes_further_in_one_step_sees_it_braked_at_the_same_time():
    stepwise, at_once = arm(), arm()
    for model in (stepwise, at_once):
        model.brake_unread(0.16)
        model.speed_l((0.0, 0.0, 0.05), 0.0, 1.0, 0)
        model.read(500 * MS)
    let_stand(stepwise, 500, 1500)
    at_once.go_on(1500 * MS)
    assert settle(at_once) == settle(stepwise)


def test_a_motion_that_is_read_goes_on_and_so_does_one_of_a_model_that_was_told_nothing():
    for told, read in ((True, True), (False, False)):
        model = arm()
        if told:
            model.brake_unread(0.16)
        model.move_l(above(0.1), 0.1, 1.0, 0)
        for t_ms in range(0, 1500, 150):
            let_stand(model, t_ms, t_ms + 150)
            if read:
                model.read((t_ms + 150) * MS)
        assert settle(model) == above(0.1)


def test_an_arm_that_brakes_already_is_not_braked_otherwise_for_being_unread():
    model = arm()
    model.brake_unread(0.16)
    model.move_l(above(0.4), 0.25, 0.2, 0)
    model.read(1300 * MS)
    model.trip(1450 * MS)
    alone, told = arm(), settle(model)
    alone.move_l(above(0.4), 0.25, 0.2, 0)
    alone.trip(1450 * MS)
    let_stand(model, 1450, 2500)
    assert settle(model) == told == settle(alone)
