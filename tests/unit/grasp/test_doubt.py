"""Doubts as a pure unit: each setting takes effect where its name says, on both sides of it."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.interfaces import ArmState, Detection, GripperState, TactileFrame
from drivers.ur.model import ArmModel, ArmModelSettings
from grasp.arm_doubt import ArmDoubt
from grasp.commands import MoveArm, StopArm
from grasp.doubt import Doubts, FingertipDoubt, GripperDoubt, wrong_probabilities
from grasp.doubt_settings import DoubtSettings
from grasp.phases import CONTACT_PHASES, SAFE_PHASES, Phase
from tests.unit.grasp.builders import arm, gripper

MS = 1_000_000
TICK = 10 * MS
Codes = NDArray[np.int16]


# Fingertips


def codes(k: int) -> Codes:
    """Living fingertips: no two samples in a row are alike in any taxel."""
    return (400 + (k + np.arange(18)) % 3).reshape(3, 6).astype(np.int16)


def frame(raw: Codes, missed: int = 0) -> TactileFrame:
    return TactileFrame(0, 0, 0, raw - np.int16(450), raw, raw, raw, missed)


def until_wrong(samples: Any, **settings: Any) -> tuple[int, str]:
    """How many samples it takes, and what is said then."""
    doubt = FingertipDoubt(DoubtSettings(**settings))
    for k in range(5):
        assert doubt.see(frame(codes(k)), Phase.LIFT) == ""
    for n, raw in enumerate(samples, 1):
        if said := doubt.see(frame(raw), Phase.LIFT):
            return n, said
    return 0, ""


def one_finger_alive(k: int) -> Codes:
    return np.stack([codes(0)[0], *codes(k)[1:]])


def rails(k: int, code: int, taxels: int = 6) -> Codes:
    raw = codes(k)
    raw[1, :taxels] = code
    return raw


@pytest.mark.parametrize("value", [5, 20])
def test_frozen_samples(value: int) -> None:
    n, said = until_wrong([codes(9)] * 100, frozen_samples=value, dead_samples=200)
    assert (n, said[:18]) == (value + 1, "fingertips_frozen:")


@pytest.mark.parametrize("value", [20, 60])
@pytest.mark.parametrize(
    ("key", "other", "loaded"),
    [("dead_samples", "dead_unloaded_samples", 20),
     ("dead_unloaded_samples", "dead_samples", 500)],
)  # fmt: skip
def test_dead_samples(value: int, key: str, other: str, loaded: int) -> None:
    """Codes that repeat stand 48 to 50 counts from their rest."""
    settings = {key: value, other: 5, "loaded_counts": loaded}
    n, said = until_wrong([one_finger_alive(k) for k in range(9, 99)], **settings)
    assert (n, said[:24]) == (value + 1, "fingertip_dead: finger A")


@pytest.mark.parametrize("value", [20, 48])
def test_loaded_counts(value: int) -> None:
    """Patience with a fingertip whose taxels are at 48 to 50 counts."""
    settings = {"dead_samples": 5, "dead_unloaded_samples": 40, "loaded_counts": value}
    n, _ = until_wrong([one_finger_alive(k) for k in range(9, 99)], **settings)
    assert n == 6
    n, _ = until_wrong(
        [one_finger_alive(k) for k in range(9, 99)], **{**settings, "loaded_counts": 51}
    )
    assert n == 41


@pytest.mark.parametrize("value", [2, 7])
@pytest.mark.parametrize("code", [0, 1023])
def test_rail_samples(value: int, code: int) -> None:
    n, said = until_wrong([rails(k, code) for k in range(30)], rail_samples=value)
    assert (n, said[:28]) == (value, "fingertips_at_rail: finger B")


@pytest.mark.parametrize(("live", "after"), [(6, 8), (3, 8), (2, 16), (1, 16), (0, 40)])
@pytest.mark.parametrize("others", [0, 1023, 450])
def test_patience_with_a_fingertip_follows_the_taxels_that_could_tell(
    live: int, after: int, others: int
) -> None:
    """The others are at a rail, or unloaded, at their rest of 450."""
    settings = {"dead_samples": 8, "dead_unloaded_samples": 40, "rail_samples": 100}

    def still(k: int) -> Codes:
        raw = codes(k)
        raw[0] = [300] * live + [others] * (6 - live)
        return raw

    assert until_wrong([still(k) for k in range(9, 99)], **settings)[0] == after + 1


def test_some_taxels_of_a_fingertip_at_the_rail_are_a_firm_grip() -> None:
    assert until_wrong([rails(k, 0, taxels=5) for k in range(300)]) == (0, "")


def test_codes_of_a_fingertip_at_the_rail_are_no_force() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame(codes(0)), Phase.LIFT)
    assert doubt.believable
    doubt.see(frame(rails(1, 0)), Phase.LIFT)
    assert not doubt.believable


@pytest.mark.parametrize("value", [20, 60])
def test_jump_counts(value: int) -> None:
    def jumps(by: int) -> str:
        return until_wrong([codes(4) + np.int16(by)], jump_counts=value)[1][:16]

    assert jumps(value) == jumps(-value) == "fingertips_jump:"
    assert jumps(value - 1) == jumps(1 - value) == ""


def test_taxels_that_change_in_both_directions_are_a_blow() -> None:
    both = codes(4) + np.where(np.arange(18).reshape(3, 6) < 9, 200, -200).astype(np.int16)
    assert until_wrong([both]) == (0, "")


def test_a_jump_is_seen_although_one_taxel_is_at_the_rail_and_not_if_most_are() -> None:
    for railed, said in ((1, "fingertips_jump:"), (10, "")):
        before, after = codes(0), codes(0) + np.int16(100)
        before.flat[:railed] = after.flat[:railed] = 0
        doubt = FingertipDoubt(DoubtSettings(rail_samples=9))
        doubt.see(frame(before), Phase.LIFT)
        assert doubt.see(frame(after), Phase.LIFT)[:16] == said


def test_missed_samples_repeat_a_frame_and_prove_nothing() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    for missed in range(100):
        assert doubt.see(frame(codes(0), missed), Phase.LIFT) == ""


def test_no_frame_is_a_fault_where_something_is_held_and_none_before() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    assert {p for p in Phase if doubt.see(None, p)} == CONTACT_PHASES
    assert not CONTACT_PHASES & {Phase.IDLE, Phase.APPROACH, Phase.REST, Phase.RELEASE}


# Detector and loop


def of(phase: Phase, settings: DoubtSettings, **told: int) -> str:
    return Doubts(settings).of(phase, frame(codes(0)), gripper(), arm(), **told)


@pytest.mark.parametrize("value", [0.05, 0.4])
def test_detector_s(value: float) -> None:
    settings = DoubtSettings(detector_s=value)
    assert of(Phase.LIFT, settings, took_ns=round((value - 1e-6) * 1e9)) == ""
    late = of(Phase.LIFT, settings, took_ns=round((value + 1e-6) * 1e9))
    assert late.startswith("detector_late: ")


@pytest.mark.parametrize("value", [0.05, 0.4])
def test_standstill_s(value: float) -> None:
    settings = DoubtSettings(standstill_s=value)
    assert of(Phase.APPROACH, settings, late_ns=round((value - 1e-6) * 1e9)) == ""
    late = of(Phase.APPROACH, settings, late_ns=round((value + 1e-6) * 1e9))
    assert late.startswith("loop_stood_still: ")
    assert of(Phase.IDLE, settings, late_ns=10**10) == ""  # a run begins when it begins


@pytest.mark.parametrize("phase", sorted(SAFE_PHASES))
def test_devices_are_doubted_in_a_safe_state_too(phase: Phase) -> None:
    assert of(phase, DoubtSettings(), late_ns=10**10).startswith("loop_stood_still: ")


def test_all_that_is_wrong_is_told() -> None:
    doubts = Doubts(DoubtSettings())
    lost = msgspec.structs.replace(gripper(), active=False)
    nan = msgspec.structs.replace(arm(), position_m=(math.nan,) * 3)
    said = doubts.of(Phase.LIFT, None, lost, nan)
    names = [part.partition(":")[0] for part in said.split("; ")]
    assert names == ["arm_position_nan", "gripper_inactive", "fingertips_absent"]


@pytest.mark.parametrize(
    "answer", [np.array([0.0, np.nan, 0.0]), np.array([np.inf] * 3), np.zeros(4), 0.5, None,
               np.array([-0.1, 0.0, 0.0])],
)  # fmt: skip
def test_an_answer_that_is_no_probability_a_finger_is_refused(answer: object) -> None:
    assert wrong_probabilities(answer).startswith("detector_failed: ")


def test_probabilities_are_accepted_up_to_their_ends() -> None:
    assert wrong_probabilities(np.array([0.0, 0.5, 1.0])) == ""


# Gripper


def doubted(states: list[GripperState], **settings: Any) -> str:
    doubt = GripperDoubt(DoubtSettings(**settings))
    said = [doubt.see(state) for state in states]
    assert not any(said[:-1])
    return said[-1].partition(":")[0]


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_echo_s(value: float) -> None:
    def after(s: float) -> str:
        return doubted([gripper(0), gripper(round(s * 1e9), fresh=False)], echo_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_silent")


MOVING = (Detection.MOVING, Detection.AT_TARGET, Detection.AT_TARGET)


def moving(t_s: float, position: int, asked: int = 90) -> GripperState:
    at_ns = round(t_s * 1e9)
    return gripper(at_ns, (position, 55, 55), MOVING, requested=(asked, 55, 55))


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_finger_start_s(value: float) -> None:
    def after(s: float, position: int = 55) -> str:
        return doubted([moving(0.0, 55), moving(s, position)], finger_start_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_stands")
    assert after(value + 1e-6, position=56) == ""


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_stands_s(value: float) -> None:
    def after(s: float, asked: int = 90) -> str:
        states = [moving(0.0, 55), moving(0.01, 56), moving(0.01 + s, 56, asked)]
        return doubted(states, stands_s=value, finger_start_s=10.0)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_stands")


def test_finger_that_is_told_otherwise_on_its_way_has_the_time_of_a_start_again() -> None:
    turning = msgspec.structs.replace(moving(0.02, 57, 40), fresh=False)
    states = [moving(0.0, 55), moving(0.01, 56), turning, moving(0.2, 57, 40)]
    assert doubted(states, stands_s=0.1, finger_start_s=0.3) == ""
    assert doubted([*states, moving(0.33, 57, 40)], stands_s=0.1, finger_start_s=0.3)


def beside(asked: int, by: int, **settings: Any) -> str:
    """A finger that says 'at target' beside what it was asked for."""
    state = gripper(positions=(asked, 55, 55))
    a = msgspec.structs.replace(state.fingers[0], position_counts=asked + by)
    state = msgspec.structs.replace(state, fingers=(a, *state.fingers[1:]))
    return doubted([state], **settings)


@pytest.mark.parametrize("value", [3, 12])
def test_target_counts(value: int) -> None:
    assert beside(100, value, target_counts=value) == ""
    assert beside(100, value + 1, target_counts=value) == "gripper_impossible"
    assert beside(100, -value - 1, target_counts=value) == "gripper_impossible"


@pytest.mark.parametrize("value", [10, 40])
def test_soft_low_counts(value: int) -> None:
    assert beside(value - 1, 50, soft_low_counts=value) == ""
    assert beside(value, 50, soft_low_counts=value) == "gripper_impossible"


@pytest.mark.parametrize("value", [180, 220])
def test_soft_high_counts(value: int) -> None:
    assert beside(value + 1, -50, soft_high_counts=value) == ""
    assert beside(value, -50, soft_high_counts=value) == "gripper_impossible"


@pytest.mark.parametrize("value", [200.0, 1000.0])
def test_finger_counts_ps(value: float) -> None:
    def leap(counts: int) -> str:
        states = [gripper(0), gripper(TICK, (55 + counts, 55, 55))]
        return doubted(states, finger_counts_ps=value, target_counts=5)

    most = 5 + round(value * 0.01)
    assert (leap(most), leap(most + 1)) == ("", "gripper_impossible")


@pytest.mark.parametrize("position", [-1, 256])
def test_positions_that_no_motor_has_are_impossible(position: int) -> None:
    assert doubted([gripper(positions=(55, position, 55))]) == "gripper_impossible"


def test_a_hand_that_is_not_active_obeys_nothing_and_one_with_a_fault_has_its_own_text() -> None:
    lost = msgspec.structs.replace(gripper(), active=False)
    assert doubted([lost]) == "gripper_inactive"
    assert doubted([msgspec.structs.replace(lost, fault=14)]) == ""


# Arm


def at(t_s: float, height_m: float, aside_m: float = 0.0, speed_mps: float = 0.0) -> ArmState:
    x, y, z = arm(0).position_m
    state = arm(round(t_s * 1e9))
    return msgspec.structs.replace(
        state, position_m=(x + aside_m, y, z + height_m), velocity_mps=(0.0, 0.0, speed_mps)
    )


def told_up(*states: ArmState, by_m: float = 0.2, **settings: Any) -> str:
    """Name of the last doubt; the arm stands at 0 s, and is told to rise then."""
    doubt = ArmDoubt(DoubtSettings(**settings))
    assert doubt.see(at(0.0, 0.0), False) == ""
    x, y, z = arm(0).position_m
    doubt.told(MoveArm((x, y, z + by_m), 0.1, 0.5), at(0.0, 0.0))
    said = [doubt.see(state, False) for state in states]
    assert not any(said[:-1])
    return said[-1].partition(":")[0]


SPARE_S = 2 * math.sqrt(2 * 0.0002 / 0.5)  # to turn round within what counts as no motion


@pytest.mark.parametrize("value", [0.1, 0.5])
def test_arm_start_s(value: float) -> None:
    def after(s: float) -> str:
        return told_up(at(s + SPARE_S, 0.0001), arm_start_s=value)

    assert (after(value - 1e-4), after(value + 1e-4)) == ("", "arm_frozen")


@pytest.mark.parametrize("value", [0.05, 0.3])
def test_arm_frozen_s(value: float) -> None:
    def after(s: float) -> str:
        return told_up(at(0.1, 0.005), at(0.1 + s, 0.005), arm_frozen_s=value)

    assert (after(value - 1e-4), after(value + 1e-4)) == ("", "arm_frozen")


@pytest.mark.parametrize("value", [0.001, 0.005])
def test_arm_moved_m(value: float) -> None:
    spare_s = 2 * math.sqrt(2 * value / 0.5)

    def after(m: float) -> str:
        return told_up(at(0.26 + spare_s, m), arm_moved_m=value, arm_jump_m=0.1)

    assert (after(value - 1e-5), after(value + 1e-5)) == ("arm_frozen", "")


@pytest.mark.parametrize("value", [0.001, 0.005])
def test_arm_there_m(value: float) -> None:
    def standing(away_m: float) -> str:
        states = (at(0.1, 0.01 - away_m), at(0.5, 0.01 - away_m))
        return told_up(*states, by_m=0.01, arm_there_m=value)

    assert (standing(value - 1e-5), standing(value + 1e-5)) == ("", "arm_frozen")


@pytest.mark.parametrize("value", [0.002, 0.02])
@pytest.mark.parametrize("way", ["back", "aside"])
def test_arm_astray_m(value: float, way: str) -> None:
    def gone(m: float) -> str:
        state = at(0.1, -m) if way == "back" else at(0.1, 0.01, aside_m=m)
        return told_up(state, arm_astray_m=value)

    assert (gone(value - 1e-5), gone(value + 1e-5)) == ("", "arm_wrong_way")


def test_an_arm_that_nobody_told_to_move_is_astray_when_it_moves() -> None:
    doubt = ArmDoubt(DoubtSettings())
    assert doubt.see(at(0.0, 0.0), False) == ""
    assert doubt.see(at(0.1, 0.004), False).startswith("arm_wrong_way: ")


def test_an_arm_that_must_brake_first_is_not_astray() -> None:
    doubt = ArmDoubt(DoubtSettings())
    doubt.see(at(0.0, 0.0), False)
    x, y, z = arm(0).position_m
    doubt.told(MoveArm((x, y, z + 0.2), 0.1, 0.5), at(0.0, 0.0))
    rising = at(1.0, 0.1, speed_mps=0.1)
    assert doubt.see(rising, False) == ""
    doubt.told(MoveArm((x, y, z), 0.1, 0.5), rising)
    assert doubt.see(at(1.2, 0.11), False) == ""
    assert doubt.see(at(1.3, 0.15), False).startswith("arm_wrong_way: ")


def falling(height_m: float = 0.1) -> ArmDoubt:
    """It was told to go down on its way up, has braked, and comes down."""
    doubt = ArmDoubt(DoubtSettings())
    doubt.see(at(0.0, 0.0), False)
    x, y, z = arm(0).position_m
    doubt.told(MoveArm((x, y, z + 0.2), 0.1, 0.5), at(0.0, 0.0))
    rising = at(1.0, height_m, speed_mps=0.1)
    assert doubt.see(rising, False) == ""
    doubt.told(MoveArm((x, y, z), 0.1, 0.5), rising)
    assert doubt.see(at(1.2, height_m + 0.01), False) == ""
    assert doubt.see(at(1.3, height_m + 0.005), False) == ""
    return doubt


def test_an_arm_that_has_turned_round_is_given_nothing_for_braking_any_more() -> None:
    assert falling().see(at(1.31, 0.1055), False) == ""
    assert falling().see(at(1.35, 0.108), False).startswith("arm_wrong_way: ")
    assert falling().see(at(1.35, 0.100, aside_m=0.003), False).startswith("arm_wrong_way: ")
    assert falling().see(at(1.34, 0.105), False) == ""
    assert falling().see(at(1.37, 0.105), False).startswith("arm_frozen: ")


def test_an_arm_that_turns_round_may_keep_its_place_for_as_long_as_that_takes() -> None:
    def turning(s: float) -> str:
        doubt = ArmDoubt(DoubtSettings(arm_frozen_s=0.06))
        doubt.see(at(0.0, 0.0), False)
        x, y, z = arm(0).position_m
        doubt.told(MoveArm((x, y, z + 0.2), 0.1, 0.5), at(0.0, 0.0))
        rising = at(1.0, 0.1, speed_mps=0.1)
        doubt.see(rising, False)
        doubt.told(MoveArm((x, y, z), 0.1, 0.5), rising)
        assert doubt.see(at(1.2, 0.11), False) == ""
        return doubt.see(at(1.2 + s, 0.11), False)

    assert turning(0.06 + SPARE_S - 1e-3) == ""
    assert turning(0.06 + SPARE_S + 1e-3).startswith("arm_frozen: ")


@pytest.mark.parametrize("ramp_mps2", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("speed_mps", [0.005, 0.03, 0.1, 0.4])
@pytest.mark.parametrize("delay_ms", [0, 280])
@pytest.mark.parametrize("phase_ms", [0, 3, 7])
def test_an_arm_that_is_turned_round_on_its_way_is_never_doubted(
    speed_mps: float, ramp_mps2: float, delay_ms: int, phase_ms: int
) -> None:
    x, y, z = arm(0).position_m
    model = ArmModel(ArmModelSettings(start_m=(x, y, z)), 0)
    doubt = ArmDoubt(DoubtSettings())
    told = {(0, 0): z + 0.5, (2000, 2000 + delay_ms): z}  # when told, when it is on its way
    for now_ms in range(phase_ms, 8000, 10):
        now_ns = now_ms * MS
        sample = model.read(now_ns)
        seen = msgspec.structs.replace(
            arm(sample.t_ns), position_m=sample.position_m, velocity_mps=sample.velocity_mps
        )
        pending = any(due < now_ms <= sent for due, sent in told)
        assert doubt.see(seen, pending) == "", now_ms
        for (due, sent), height_m in told.items():
            command = MoveArm((x, y, height_m), speed_mps, ramp_mps2)
            if due == now_ms - phase_ms:
                doubt.told(command, seen)
            if sent == now_ms - phase_ms:
                model.move_l(command.position_m, speed_mps, ramp_mps2, now_ns)


def test_an_arm_goes_on_as_before_while_what_it_is_told_is_on_its_way() -> None:
    def rising_on(by_m: float, aside_m: float = 0.0) -> str:
        doubt = ArmDoubt(DoubtSettings())
        doubt.see(at(0.0, 0.0), False)
        x, y, z = arm(0).position_m
        doubt.told(MoveArm((x, y, z + 0.2), 0.1, 0.5), at(0.0, 0.0))
        rising = at(1.0, 0.05, speed_mps=0.1)
        doubt.see(rising, False)
        doubt.told(MoveArm((x, y, z), 0.1, 0.5), rising)
        assert doubt.see(at(1.5, 0.1, speed_mps=0.1), True) == ""
        assert doubt.see(at(2.0, 0.14, speed_mps=0.1), True) == ""
        return doubt.see(at(2.3, 0.14 + by_m, aside_m), False)

    assert rising_on(0.03) == ""  # it brakes
    assert rising_on(0.04).startswith("arm_wrong_way: ")
    assert rising_on(0.01, 0.04).startswith("arm_wrong_way: ")


@pytest.mark.parametrize("value", [0.5, 2.0])
def test_arm_fastest_mps(value: float) -> None:
    def after(s: float) -> str:
        return told_up(at(s, 0.11), arm_fastest_mps=value, arm_jump_m=0.01)

    assert (after(0.1 / value + 1e-4), after(0.1 / value - 1e-4)) == ("", "arm_jump")


@pytest.mark.parametrize("value", [0.005, 0.05])
def test_arm_jump_m(value: float) -> None:
    def leap(m: float) -> str:
        return told_up(at(0.0, m), arm_jump_m=value)

    assert (leap(value - 1e-5), leap(value + 1e-5)) == ("", "arm_jump")


def test_an_arm_that_was_told_to_stop_may_stand_anywhere() -> None:
    doubt = ArmDoubt(DoubtSettings())
    doubt.see(at(0.0, 0.0), False)
    x, y, z = arm(0).position_m
    doubt.told(MoveArm((x, y, z + 0.2), 0.1, 0.5), at(0.0, 0.0))
    doubt.see(at(0.5, 0.05), False)
    doubt.told(StopArm(1.0), at(0.5, 0.05))
    assert doubt.see(at(5.0, 0.05), False) == ""


def test_a_command_on_its_way_does_not_move_the_arm_yet() -> None:
    doubt = ArmDoubt(DoubtSettings())
    doubt.see(at(0.0, 0.0), False)
    x, y, z = arm(0).position_m
    doubt.told(MoveArm((x, y, z + 0.2), 0.1, 0.5), at(0.0, 0.0))
    assert doubt.see(at(0.5, 0.0), True) == ""
    assert doubt.see(at(0.6, 0.0), False) == ""
    assert doubt.see(at(0.9, 0.0), False).startswith("arm_frozen: ")
