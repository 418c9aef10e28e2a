"""Doubts as a pure unit: each setting takes effect where its name says, on both sides of it."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.interfaces import Detection, GripperState, TactileFrame
from grasp.commands import MoveArm
from grasp.doubt import Doubts, wrong_probabilities
from grasp.doubt_settings import DoubtSettings
from grasp.fingertip_doubt import FingertipDoubt
from grasp.gripper_doubt import LOOKS, GripperDoubt
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
    settings = {"dead_samples": 10, "dead_unloaded_samples": 40, "loaded_counts": value}
    n, _ = until_wrong([one_finger_alive(k) for k in range(9, 99)], **settings)
    assert n == 11
    n, _ = until_wrong(
        [one_finger_alive(k) for k in range(9, 99)], **{**settings, "loaded_counts": 51}
    )
    assert n == 41


@pytest.mark.parametrize("value", [2, 7])
@pytest.mark.parametrize("code", [0, 1023])
def test_rail_samples(value: int, code: int) -> None:
    n, said = until_wrong([rails(k, code) for k in range(30)], rail_samples=value)
    assert (n, said[:28]) == (value, "fingertips_at_rail: finger B")


@pytest.mark.parametrize(("live", "after"), [(6, 8), (1, 8), (0, 40)])
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


STUCK = 12  # of the hand's 18 taxels, four of each fingertip


def mostly_stuck(k: int) -> Codes:
    """The taxels that live change from one sample to the next."""
    raw = codes(k)
    raw[:, :4] = 420
    return raw


@pytest.mark.parametrize("patient", ["frozen_samples", "dead_unloaded_samples"])
def test_taxels_that_have_stood_still_for_long_are_no_witnesses(patient: str) -> None:
    """A third of the taxels must repeat three times as often to say as much."""
    samples = {"frozen_samples": 8, "dead_unloaded_samples": 8, patient: 99}
    doubt = FingertipDoubt(DoubtSettings(**samples, stuck_samples=25, loaded_counts=60))
    for k in range(30):
        assert doubt.see(frame(mostly_stuck(k)), Phase.LIFT) == ""
    heard = [doubt.see(frame(mostly_stuck(29)), Phase.LIFT)[:18] for _ in range(24)]
    assert heard == [""] * 23 + ["fingertips_frozen:"]


@pytest.mark.parametrize("value", [20, 60])
def test_stuck_samples(value: int) -> None:
    doubt = FingertipDoubt(DoubtSettings(stuck_samples=value))
    telling = []
    for k in range(value + 2):
        doubt.see(frame(mostly_stuck(k)), Phase.LIFT)
        telling.append(int(doubt.can_tell.sum()))
    assert telling == [18] * value + [18 - STUCK] * 2
    doubt.see(frame(codes(1)), Phase.LIFT)
    assert doubt.can_tell.all()


def said_of(dead: int, phase: Phase, code: int = 420, **settings: Any) -> str:
    """Of finger B with so many taxels that stand still for longer than ``stuck_samples``."""
    doubt = FingertipDoubt(DoubtSettings(stuck_samples=20, **settings))
    said = ""
    for k in range(25):
        said = doubt.see(frame(rails(k, code, taxels=dead)), phase)
    return said


@pytest.mark.parametrize("share, dead", [(0.5, 4), (0.34, 4), (0.33, 5), (1.0, 1), (0.84, 1)])
def test_living_share(share: float, dead: int) -> None:
    said = said_of(dead, Phase.LISTEN, living_share=share)
    assert said == f"fingertip_deaf: {dead} of finger B's 6 taxels stand still"
    assert said_of(dead - 1, Phase.LISTEN, living_share=share) == ""


def test_dead_taxels_are_looked_for_in_the_grip_before_the_arm_lifts() -> None:
    said = {phase for phase in Phase if said_of(5, phase)}
    assert said == {Phase.RELAX, Phase.LISTEN}


@pytest.mark.parametrize("code", [0, 1023])
def test_taxels_that_are_pressed_to_the_rail_are_not_dead(code: int) -> None:
    assert said_of(5, Phase.LISTEN, code=code) == ""


def test_taxels_at_the_rail_cannot_tell() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame(rails(0, 0, taxels=2)), Phase.LIFT)
    assert doubt.can_tell.sum(axis=1).tolist() == [6, 4, 6]


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


def test_after_a_gap_in_the_frames_codes_are_not_compared_with_those_from_before_it() -> None:
    jumped = frame(codes(1) + np.int16(100))
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame(codes(0)), Phase.LIFT)
    assert doubt.see(jumped, Phase.LIFT)[:16] == "fingertips_jump:"
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame(codes(0)), Phase.APPROACH)
    doubt.see(None, Phase.APPROACH)
    assert doubt.see(jumped, Phase.LIFT) == ""


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


def test_after_a_standstill_of_the_loop_no_device_is_blamed_for_the_time_that_nobody_saw() -> None:
    doubts, s = Doubts(DoubtSettings()), DoubtSettings()
    there = (0.3, 0.2, 0.6)
    unheard = [gripper(t, detections=MOVING, fresh=False) for t in (0, 10**10, 10**10 + TICK)]
    rising = [arm(t, moving=True) for t in (0, 10**10, 10**10 + TICK)]
    sees = [frame(codes(k)) for k in range(3)]
    assert doubts.of(Phase.LIFT, sees[0], unheard[0], rising[0]) == ""
    doubts.sent((MoveArm(there, 0.1, 0.5),), rising[0])
    slept = doubts.of(Phase.LIFT, sees[1], unheard[1], rising[1], late_ns=10**10 - TICK)
    assert slept == "loop_stood_still: for 9.990 s nobody was in control"
    assert doubts.of(Phase.FAULT, sees[2], unheard[2], rising[2]) == ""
    later_ns = 10**10 + round(max(s.echo_s, s.arm_start_s, s.arm_frozen_s) * 1e9) + 10**9
    for t_ns in range(later_ns, later_ns + LOOKS * TICK, TICK):
        hand = gripper(t_ns, detections=MOVING, fresh=False)
        blamed = doubts.of(Phase.FAULT, sees[0], hand, arm(t_ns, moving=True))
    assert "arm_frozen" in blamed and "gripper_silent" in blamed


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
               np.array([-0.1, 0.0, 0.0]), np.array([None] * 3), np.array(["0.1"] * 3),
               np.array([0.1j] * 3)],
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
        looks = [round(i * s / LOOKS * 1e9) for i in range(1, LOOKS + 1)]
        return doubted([gripper(0), *(gripper(ns, fresh=False) for ns in looks)], echo_s=value)

    assert (after(value - 1e-6), after(value + 1e-6)) == ("", "gripper_silent")


def test_hand_is_not_silent_because_the_loop_is_slow() -> None:
    """Few looks, each a long step after the last, say nothing of a hand that needs two of them."""
    slow = [gripper(i * 120_000_000, fresh=i == 0) for i in range(6)]
    assert doubted(slow[:5]) == ""
    assert doubted(slow) == "gripper_silent"


def test_silence_and_stillness_last_longer_than_they_may_and_not_just_as_long() -> None:
    half = [gripper(round(i * 1e8), fresh=i == 0) for i in range(6)]
    assert doubted(half, echo_s=0.5) == ""
    assert doubted([moving(0.0, 55), moving(0.5, 55)], finger_start_s=0.5) == "gripper_stands"


def test_after_a_standstill_of_the_loop_looks_without_an_answer_are_counted_anew() -> None:
    doubt = GripperDoubt(DoubtSettings(echo_s=0.1))
    assert doubt.see(gripper(0)) == ""
    doubt.begin_anew(gripper(10**10))
    looks = [doubt.see(gripper(10**10 + i * 200_000_000, fresh=False)) for i in range(1, 6)]
    assert [look.partition(":")[0] for look in looks] == ["", "", "", "", "gripper_silent"]


def flickering(every: int, asked_anew: int = 1000) -> list[str]:
    """What is said of a hand that says by turns that it moves and that it stands."""
    doubt = GripperDoubt(DoubtSettings())
    told = []
    for tick in range(120):
        asked = 60 + tick // asked_anew % 2
        moves = bool(tick // every % 2)
        says = Detection.MOVING if moves else Detection.AT_TARGET
        at = (60 + tick % 2,) * 3
        seen = gripper(tick * TICK, at, (says,) * 3, requested=(asked,) * 3)
        told.append(doubt.see(seen).partition(":")[0])
    return told


@pytest.mark.parametrize("every", [2, 5, 10])
def test_hand_that_says_again_and_again_that_it_moves_and_stands_is_doubted(every: int) -> None:
    assert "gripper_flickers" in flickering(every)


@pytest.mark.parametrize(("command_every", "doubted"), [(1000, True), (8, False)])
def test_hand_whose_status_speaks_of_its_command_and_then_of_none_is_doubted(
    command_every: int, doubted: bool
) -> None:
    doubt, told = GripperDoubt(DoubtSettings()), []
    for tick in range(120):
        if tick % command_every == 0:
            doubt.told()
        told.append(doubt.see(gripper(tick * TICK, fresh=bool(tick // 4 % 2))))
    assert any(text.startswith("gripper_flickers") for text in told) is doubted


def test_hand_that_begins_and_ends_some_motions_or_is_told_anew_is_believed() -> None:
    assert set(flickering(13)) == {""}
    assert set(flickering(5, asked_anew=20)) == {""}


def test_hand_that_is_seen_moving_at_first_has_the_time_of_a_start() -> None:
    first = moving(100.0, 55)
    assert doubted([first]) == ""
    assert doubted([first, moving(100.19, 55)], finger_start_s=0.2) == ""
    assert doubted([first, moving(100.2, 55)], finger_start_s=0.2) == "gripper_stands"


def test_each_answer_begins_the_time_and_the_looks_anew() -> None:
    answers = (0, 4, 9)  # four looks between them at most
    looks = [gripper(i * 120_000_000, fresh=i in answers) for i in range(15)]
    assert doubted(looks[:14]) == ""
    assert doubted(looks) == "gripper_silent"
    often = [gripper(i * 10_000_000, fresh=i < 100) for i in range(110)]
    assert doubted(often, echo_s=0.2) == ""


def test_finger_that_begins_to_move_from_rest_has_the_time_of_a_start() -> None:
    resting = [gripper(0), gripper(TICK)]
    starting = [moving(0.02, 55), moving(0.15, 55)]
    assert doubted([*resting, *starting], stands_s=0.1, finger_start_s=0.3) == ""


def test_first_status_without_an_answer_is_none_of_the_looks() -> None:
    looks = [gripper(10**10 + i * 120_000_000, fresh=False) for i in range(6)]
    assert doubted(looks[:5]) == ""
    assert doubted(looks) == "gripper_silent"


@pytest.mark.parametrize(
    ("fault", "active", "said"),
    [(14, False, ""), (14, True, "gripper_silent"), (0, True, "gripper_silent")],
)
def test_a_hand_that_says_that_it_refuses_is_not_called_silent(
    fault: int, active: bool, said: str
) -> None:
    looks = [gripper(i * 120_000_000, fresh=i == 0, fault=fault) for i in range(6)]
    assert doubted([msgspec.structs.replace(look, active=active) for look in looks]) == said


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


def pressing(t_s: float, current_ma: int) -> GripperState:
    state = moving(t_s, 55)
    a = msgspec.structs.replace(state.fingers[0], current_ma=current_ma)
    return msgspec.structs.replace(state, fingers=(a, *state.fingers[1:]))


@pytest.mark.parametrize("value", [150, 400])
def test_pressing_ma(value: int) -> None:
    def stands(current_ma: int) -> str:
        return doubted([pressing(0.0, current_ma), pressing(1.0, current_ma)], pressing_ma=value)

    assert (stands(value - 1), stands(value)) == ("gripper_stands", "")


@pytest.mark.parametrize("value", [0.5, 1.5])
def test_pressing_s(value: float) -> None:
    """A finger at its force creeps after what gives way."""

    def after(s: float) -> str:
        return doubted([pressing(0.0, 310), pressing(s, 310)], pressing_s=value)

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


TOUCHING = (Detection.CONTACT_CLOSING, Detection.AT_TARGET, Detection.AT_TARGET)


def touching(t_s: float, position: int, fresh: bool = True) -> GripperState:
    asked = (90, 55, 55)
    return gripper(round(t_s * 1e9), (position, 55, 55), TOUCHING, fresh, requested=asked)


@pytest.mark.parametrize("value", [2, 6])
@pytest.mark.parametrize("way", [1, -1])
def test_contact_counts(value: int, way: int) -> None:
    def after(counts: int) -> str:
        steps = [touching(0.1 * k, 55 + way * k) for k in range(counts + 1)]
        return doubted(steps, contact_counts=value)

    assert (after(value), after(value + 1)) == ("", "gripper_impossible")


def test_finger_in_contact_may_move_after_another_request() -> None:
    states = [touching(0.0, 55), touching(0.1, 56, fresh=False), touching(0.2, 75)]
    assert doubted(states, contact_counts=2) == ""


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


def test_leap_is_one_however_long_the_run_has_lasted() -> None:
    at_ns = 10**12
    assert doubted([gripper(at_ns), gripper(at_ns + TICK, (200, 55, 55))]) == "gripper_impossible"


@pytest.mark.parametrize("position", [-1, 256])
def test_positions_that_no_motor_has_are_impossible(position: int) -> None:
    assert doubted([gripper(positions=(55, position, 55))]) == "gripper_impossible"
    there = min(max(position, 0), 255)
    assert doubted([gripper(positions=(55, there, 55))]) == ""


def test_a_hand_that_is_not_active_obeys_nothing_and_one_with_a_fault_has_its_own_text() -> None:
    lost = msgspec.structs.replace(gripper(), active=False)
    assert doubted([lost]) == "gripper_inactive"
    assert doubted([msgspec.structs.replace(lost, fault=14)]) == ""
