"""Plausibility checks of the fingertips: each limit takes effect at its value."""

from typing import Any

import numpy as np
import pytest

from grasp.control.monitors.checks import CHECKS
from grasp.control.monitors.fingertips import (
    DEAD_SAMPLES,
    FROZEN_SAMPLES,
    RAIL_SAMPLES,
    STUCK_SAMPLES,
    FingertipHistory,
)
from grasp.control.monitors.settings import MonitorSettings
from grasp.control.states import State
from tests.unit.grasp.builders import Codes, codes, frame_of


class Hand:
    """A history of fingertips, and the checks that fail after each sample."""

    def __init__(self, **settings: Any) -> None:
        self.history = FingertipHistory(MonitorSettings(**settings))

    def update(self, raw: Codes | None, phase: State = State.LIFT, missed: int = 0) -> str:
        failures = self.history.update(None if raw is None else frame_of(raw, missed))
        found = {code: d for code, d in failures.items() if phase in CHECKS[code].states}
        return ", ".join(f"{n} {d.get('finger', '')}".strip() for n, d in found.items() if d)


def until_wrong(samples: Any, **settings: Any) -> tuple[int, str]:
    """Number of samples until a check fails, and its code; 0 and empty if none does."""
    hand = Hand(**settings)
    for k in range(5):
        assert hand.update(codes(k)) == ""
    for n, raw in enumerate(samples, 1):
        if failed := hand.update(raw):
            return n, failed
    return 0, ""


def one_finger_alive(k: int) -> Codes:
    return np.stack([codes(0)[0], *codes(k)[1:]])


def rails(k: int, code: int, taxels: int = 6) -> Codes:
    raw = codes(k)
    raw[1, :taxels] = code
    return raw


def test_a_loaded_hand_whose_codes_all_repeat_is_frozen() -> None:
    assert until_wrong([codes(9)] * 50) == (FROZEN_SAMPLES + 1, "fingertips_frozen")


def test_a_frozen_hand_states_how_many_samples_are_equal() -> None:
    history = FingertipHistory(MonitorSettings())
    found = [history.update(frame_of(codes(9), 0)) for _ in range(FROZEN_SAMPLES + 1)]
    assert found[-2:] == [{}, {"fingertips_frozen": {"samples": FROZEN_SAMPLES + 1}}]


def test_a_loaded_fingertip_whose_codes_all_repeat_is_dead() -> None:
    """Repeated codes are 48 to 50 counts from their rest."""
    n, codes = until_wrong([one_finger_alive(k) for k in range(9, 99)])
    assert (n, codes) == (DEAD_SAMPLES + 1, "fingertip_dead A")


def test_saturated_taxels_hide_neither_a_frozen_hand_nor_a_dead_fingertip() -> None:
    """Two taxels of finger B alternate between the ends, or stay at one of them."""
    frozen = [rails(9, (0, 1023)[k % 2], taxels=2) for k in range(50)]
    assert until_wrong(frozen) == (FROZEN_SAMPLES + 1, "fingertips_frozen")
    pressed = rails(9, 1023, taxels=2)[1]
    dead = [np.stack([codes(k)[0], pressed, codes(k)[2]]) for k in range(9, 99)]
    assert until_wrong(dead) == (DEAD_SAMPLES + 1, "fingertip_dead B")


def test_an_unloaded_fingertip_with_constant_codes_is_neither_frozen_nor_dead() -> None:
    rest = np.full((3, 6), 450, np.int16)
    hand = Hand()
    assert not any(hand.update(rest) for _ in range(300))
    assert [hand.update(rest - np.int16(35)) for _ in range(9)][-1] == "fingertips_frozen"


@pytest.mark.parametrize("code", [0, 1023])
def test_only_a_completely_saturated_fingertip_is_detected(code: int) -> None:
    found = until_wrong([rails(k, code) for k in range(30)])
    assert found == (RAIL_SAMPLES, "fingertips_at_rail B")
    assert until_wrong([rails(k, code, taxels=5) for k in range(300)]) == (0, "")


def partly_stuck(k: int, taxels: int = 2) -> Codes:
    """Codes with ``stuck`` constant taxels per fingertip; the others change with each sample."""
    raw = codes(k)
    raw[:, :taxels] = 420
    return raw


def test_stuck_taxels_are_ignored_by_the_jump_check() -> None:
    hand = Hand()
    assert not any(hand.update(partly_stuck(k)) for k in range(STUCK_SAMPLES + 5))
    jumped = partly_stuck(STUCK_SAMPLES + 5)
    jumped[:, 2:] -= 200  # the stuck ones stay
    assert hand.update(jumped) == "fingertips_jump"


def test_a_hand_with_stuck_taxels_whose_other_codes_repeat_is_frozen() -> None:
    hand = Hand()
    assert not any(hand.update(partly_stuck(k)) for k in range(STUCK_SAMPLES + 5))
    found = [hand.update(partly_stuck(STUCK_SAMPLES + 4)) for _ in range(FROZEN_SAMPLES)]
    assert found == [""] * (FROZEN_SAMPLES - 1) + ["fingertips_frozen"]


def test_a_hand_with_mostly_stuck_taxels_is_frozen_once_a_fingertip_is_dead() -> None:
    hand, count = Hand(), STUCK_SAMPLES + 5
    assert not any(hand.update(partly_stuck(k, 4)) for k in range(count))
    found = [hand.update(partly_stuck(count - 1, 4)) for _ in range(DEAD_SAMPLES)]
    assert found == [""] * (DEAD_SAMPLES - 1) + ["fingertip_dead A, B, C"]


def test_a_stuck_taxel_is_unresponsive_until_it_changes() -> None:
    hand, telling = Hand(), []
    for k in range(STUCK_SAMPLES + 2):
        hand.update(partly_stuck(k))
        telling.append(sum(map(sum, hand.history.responsive)))
    assert telling == [18] * STUCK_SAMPLES + [12] * 2
    hand.update(codes(1))
    assert hand.history.responsive == [[True] * 6] * 3 and hand.history.all_responsive


def failed_with(stuck: int, phase: State, code: int = 420) -> str:
    """Codes that fail for finger B with this number of stuck taxels."""
    hand = Hand()
    samples = [rails(k, code, taxels=stuck) for k in range(STUCK_SAMPLES + 5)]
    return [hand.update(raw, phase) for raw in samples][-1]


def test_no_lift_with_a_fingertip_with_more_than_half_stuck_taxels() -> None:
    few = "fingertip_few_taxels B"
    assert (failed_with(3, State.BASELINE), failed_with(4, State.BASELINE)) == ("", few)
    assert {phase for phase in State if failed_with(5, phase)} == {State.SETTLE, State.BASELINE}
    for code in (0, 1023):  # pressed
        assert failed_with(5, State.BASELINE, code=code) == ""


def test_saturated_taxels_are_unresponsive_and_a_saturated_fingertip_gives_no_force() -> None:
    hand = Hand()
    hand.update(rails(0, 0, taxels=2))
    assert [sum(row) for row in hand.history.responsive] == [6, 4, 6]
    assert hand.history.plausible
    hand.update(rails(1, 0))
    assert not hand.history.plausible


@pytest.mark.parametrize("value", [20, 60])
def test_jump_counts(value: int) -> None:
    def jumps(by: int) -> str:
        return until_wrong([codes(4) + np.int16(by)], jump_counts=value)[1]

    assert jumps(value) == jumps(-value) == "fingertips_jump"
    assert jumps(value - 1) == jumps(1 - value) == ""


def test_taxels_that_change_in_both_directions_are_an_impact() -> None:
    both = codes(4) + np.where(np.arange(18).reshape(3, 6) < 9, 200, -200).astype(np.int16)
    assert until_wrong([both]) == (0, "")


def test_a_jump_is_detected_unless_most_taxels_are_saturated() -> None:
    for railed, expected in ((1, "fingertips_jump"), (10, "")):
        before, after = codes(0), codes(0) + np.int16(100)
        before.flat[:railed] = after.flat[:railed] = 0
        hand = Hand()
        hand.update(before)
        assert hand.update(after) == expected


def test_missed_samples_are_ignored() -> None:
    hand = Hand()
    assert not any(hand.update(codes(0), missed=missed) for missed in range(100))


def test_codes_are_not_compared_across_a_gap_in_the_frames() -> None:
    jumped, hand = codes(1) + np.int16(100), Hand()
    hand.update(codes(0))
    assert hand.update(jumped) == "fingertips_jump"
    hand = Hand()
    hand.update(codes(0), State.SHAPE)
    hand.update(None, State.SHAPE)
    assert hand.update(jumped) == ""
