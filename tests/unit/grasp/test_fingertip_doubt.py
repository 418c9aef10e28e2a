"""Doubts of fingertips: each setting takes effect where its name says, on both sides of it."""

from typing import Any

import numpy as np
import pytest

from grasp.doubt_settings import DoubtSettings
from grasp.fingertip_doubt import FingertipDoubt
from grasp.states import CONTACT_STATES, State
from tests.unit.grasp.builders import Codes, codes, frame_of

MS = 1_000_000
TICK = 10 * MS


def until_wrong(samples: Any, **settings: Any) -> tuple[int, str]:
    """How many samples it takes, and what is said then."""
    doubt = FingertipDoubt(DoubtSettings(**settings))
    for k in range(5):
        assert doubt.see(frame_of(codes(k)), State.LIFT) == ""
    for n, raw in enumerate(samples, 1):
        if said := doubt.see(frame_of(raw), State.LIFT):
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
        assert doubt.see(frame_of(mostly_stuck(k)), State.LIFT) == ""
    heard = [doubt.see(frame_of(mostly_stuck(29)), State.LIFT)[:18] for _ in range(24)]
    assert heard == [""] * 23 + ["fingertips_frozen:"]


@pytest.mark.parametrize("value", [20, 60])
def test_stuck_samples(value: int) -> None:
    doubt = FingertipDoubt(DoubtSettings(stuck_samples=value))
    telling = []
    for k in range(value + 2):
        doubt.see(frame_of(mostly_stuck(k)), State.LIFT)
        telling.append(int(doubt.can_tell.sum()))
    assert telling == [18] * value + [18 - STUCK] * 2
    doubt.see(frame_of(codes(1)), State.LIFT)
    assert doubt.can_tell.all()


def said_of(dead: int, phase: State, code: int = 420, **settings: Any) -> str:
    """Of finger B with so many taxels that stand still for longer than ``stuck_samples``."""
    doubt = FingertipDoubt(DoubtSettings(stuck_samples=20, **settings))
    said = ""
    for k in range(25):
        said = doubt.see(frame_of(rails(k, code, taxels=dead)), phase)
    return said


@pytest.mark.parametrize("share, dead", [(0.5, 4), (0.34, 4), (0.33, 5), (1.0, 1), (0.84, 1)])
def test_living_share(share: float, dead: int) -> None:
    said = said_of(dead, State.BASELINE, living_share=share)
    assert said == f"fingertip_deaf: {dead} of finger B's 6 taxels stand still"
    assert said_of(dead - 1, State.BASELINE, living_share=share) == ""


def test_dead_taxels_are_looked_for_in_the_grip_before_the_arm_lifts() -> None:
    said = {phase for phase in State if said_of(5, phase)}
    assert said == {State.SETTLE, State.BASELINE}


@pytest.mark.parametrize("code", [0, 1023])
def test_taxels_that_are_pressed_to_the_rail_are_not_dead(code: int) -> None:
    assert said_of(5, State.BASELINE, code=code) == ""


def test_taxels_at_the_rail_cannot_tell() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame_of(rails(0, 0, taxels=2)), State.LIFT)
    assert doubt.can_tell.sum(axis=1).tolist() == [6, 4, 6]


def test_some_taxels_of_a_fingertip_at_the_rail_are_a_firm_grip() -> None:
    assert until_wrong([rails(k, 0, taxels=5) for k in range(300)]) == (0, "")


def test_codes_of_a_fingertip_at_the_rail_are_no_force() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame_of(codes(0)), State.LIFT)
    assert doubt.believable
    doubt.see(frame_of(rails(1, 0)), State.LIFT)
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
        doubt.see(frame_of(before), State.LIFT)
        assert doubt.see(frame_of(after), State.LIFT)[:16] == said


def test_missed_samples_repeat_a_frame_and_prove_nothing() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    for missed in range(100):
        assert doubt.see(frame_of(codes(0), missed), State.LIFT) == ""


def test_no_frame_is_a_fault_where_something_is_held_and_none_before() -> None:
    doubt = FingertipDoubt(DoubtSettings())
    assert {p for p in State if doubt.see(None, p)} == CONTACT_STATES
    assert not CONTACT_STATES & {State.START, State.SHAPE, State.TARE, State.OPEN}


def test_after_a_gap_in_the_frames_codes_are_not_compared_with_those_from_before_it() -> None:
    jumped = frame_of(codes(1) + np.int16(100))
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame_of(codes(0)), State.LIFT)
    assert doubt.see(jumped, State.LIFT)[:16] == "fingertips_jump:"
    doubt = FingertipDoubt(DoubtSettings())
    doubt.see(frame_of(codes(0)), State.SHAPE)
    doubt.see(None, State.SHAPE)
    assert doubt.see(jumped, State.LIFT) == ""
