"""Force and stiffness of a grip, from readings at rest."""

import pytest

from drivers.interfaces import Counts3, Vector3
from grasp.control.grip_measure import READ_NS, GripMeasure

GUESS_N, LIMIT_N, OVERSHOOT_N = 1.9, 10.0, 1.0
STEP_NS = 10_000_000


class Hand:
    """A hand that closes on a contact and rests after each motion, before a measure."""

    def __init__(self, alone: bool = False) -> None:
        self.measure = GripMeasure(GUESS_N, LIMIT_N, OVERSHOOT_N, alone)
        self.t_ns = 0

    def at(
        self,
        positions: Counts3,
        sides_n: tuple[float, float],
        responsive: bool = True,
        risen: bool = True,
    ) -> GripMeasure:
        """Move there, then rest until there is a reading."""
        thumb_n, others_n = sides_n
        estimated_n: Vector3 = (thumb_n, others_n / 2, others_n / 2)
        for rests in (False, *[True] * (READ_NS // STEP_NS + 1)):
            self._step(rests, positions, estimated_n, responsive, risen)
        return self.measure

    def _step(
        self,
        rests: bool,
        positions: Counts3,
        estimated_n: Vector3,
        responsive: bool,
        risen: bool = True,
    ) -> None:
        self.t_ns += STEP_NS
        self.measure.update(self.t_ns, rests, positions, estimated_n, responsive, risen)


def gripped(rise_n: float = 2.0) -> Hand:
    hand = Hand()
    hand.at((50, 50, 50), (1.0, 1.0))
    hand.at((51, 50, 50), (1.0 + rise_n, 1.0 + rise_n))
    hand.measure.begin()
    return hand


def test_there_is_a_reading_only_after_the_hand_has_rested() -> None:
    measure = GripMeasure(GUESS_N, LIMIT_N, OVERSHOOT_N)
    for k in range(READ_NS // STEP_NS):
        measure.update(k * STEP_NS, True, (50, 50, 50), (1.0, 0.5, 0.5), True)
        assert measure.now is None
    measure.update(READ_NS, True, (50, 50, 50), (1.0, 0.5, 0.5), True)
    assert measure.now is not None and measure.now.sides_n == (1.0, 1.0)
    measure.update(READ_NS + STEP_NS, False, (50, 50, 50), (1.0, 0.5, 0.5), True)
    assert measure.now is None


def test_stiffness_is_the_largest_rise_a_count_in_the_grip() -> None:
    hand = Hand()
    assert not hand.at((50, 50, 50), (0.2, 0.2)).measured
    assert not hand.at((51, 50, 50), (1.0, 1.0)).measured  # contact began within this count
    assert hand.at((52, 50, 50), (2.5, 2.5)).rise_n == pytest.approx(1.5)
    assert hand.at((53, 50, 50), (3.5, 3.5)).rise_n == pytest.approx(1.5)
    assert hand.at((55, 50, 50), (8.5, 8.5)).rise_n == pytest.approx(2.5)


def test_one_finger_against_an_object_that_the_table_holds_counts_two_thirds() -> None:
    hand = Hand()
    hand.at((50, 50, 50), (1.0, 1.0))
    assert hand.at((51, 50, 50), (4.0, 1.0)).rise_n == pytest.approx(2.0)


def test_rise_by_other_fingers_or_with_saturated_taxels_measures_no_lower_stiffness() -> None:
    hand = Hand()
    hand.at((50, 50, 50), (1.0, 1.0))
    assert not hand.at((50, 51, 51), (3.0, 6.0)).measured
    assert hand.at((51, 51, 51), (3.2, 6.2), responsive=False).rise_n == GUESS_N


def test_limit_uses_a_share_of_the_room_and_leaves_a_spare_part_of_a_count() -> None:
    for rise_n, end_counts in [(2.0, 53), (3.0, 52), (3.9, 52), (4.0, 51), (0.5, 61)]:
        # room of 10 - (1 + rise) N, 0.7 of it in whole counts; one count where 1.3 would fit
        assert gripped(rise_n).measure.end_counts == end_counts, rise_n


def test_force_counts_as_at_least_what_the_first_grasp_predicts() -> None:
    hand = gripped()
    # four counts further, the fingertips show nothing
    assert hand.at((55, 50, 50), (3.0, 3.0)).end_counts == 55


def test_a_later_stage_uses_the_whole_room_and_the_accepted_overshoot() -> None:
    hand = gripped(2.0)  # 3 N at 51 counts
    assert hand.at((53, 50, 50), (6.5, 6.5)).end_counts == 55  # 4.5 N fit into 2 counts of 2 N
    assert gripped(2.0).at((54, 50, 50), (8.5, 8.5)).end_counts == 55  # 2.5 N, one count


def test_where_position_alone_bounds_force_counts_as_what_the_first_reading_predicts() -> None:
    hand = Hand(alone=True)
    hand.at((50, 50, 50), (1.0, 1.0))
    hand.at((51, 50, 50), (3.0, 3.0))
    silent = hand.at((54, 50, 50), (3.0, 3.0)).now
    assert silent is not None and silent.force_n == pytest.approx(1.0 + 0.9 * 2.0 * 4)
    opened = hand.at((40, 50, 50), (0.0, 0.0)).now
    assert opened is not None and opened.force_n == 0.0
    again = hand.at((45, 50, 50), (2.0, 2.0)).now
    assert again is not None and again.force_n == 2.0


def test_where_position_alone_bounds_the_first_stage_by_a_guess_is_one_count() -> None:
    for alone, counts in ((False, 2), (True, 1)):
        hand = Hand(alone)
        hand.at((50, 50, 50), (2.0, 2.0)).begin()
        assert hand.measure.end_counts == 50 + counts
    assert hand.at((51, 50, 50), (3.0, 3.0)).end_counts == 59  # 7 + 1 N, 1 N a count
    assert hand.measure.rise_n == pytest.approx(1.0)


def test_first_rise_after_a_grasp_by_a_guess_is_not_taken_for_less_than_its_error() -> None:
    for counts, alone, rise_n in ((1, False, 0.5), (5, False, 0.2), (5, True, GUESS_N / 2)):
        hand = Hand(alone)
        hand.at((50, 50, 50), (2.0, 2.0)).begin()
        force_n = 2.0 + 0.2 * counts
        assert hand.at((50 + counts, 50, 50), (force_n, force_n)).rise_n == pytest.approx(rise_n)


def test_first_rise_in_the_air_replaces_that_on_the_table_but_not_by_less_than_half() -> None:
    hand = gripped(3.0)
    assert hand.at((52, 50, 50), (6.0, 6.0)).rise_n == pytest.approx(2.0)
    assert hand.at((53, 50, 50), (7.0, 7.0)).rise_n == pytest.approx(2.0)
    assert gripped(3.0).at((52, 50, 50), (4.5, 4.5)).rise_n == pytest.approx(1.5)


def test_no_closing_is_left_without_a_reading_of_the_first_grasp() -> None:
    measure = GripMeasure(GUESS_N, LIMIT_N, OVERSHOOT_N)
    measure.begin()
    assert measure.end_counts is None and measure.first is None


def test_a_count_without_a_rise_is_no_stiffness() -> None:
    """A hand at its stop reports counts without a motion."""
    hand = Hand()
    hand.at((0, 50, 50), (0.6, 0.6))
    still = hand.at((6, 50, 50), (0.62, 0.62))
    assert not still.measured and still.rise_n == GUESS_N


@pytest.mark.parametrize(
    ("sides_n", "risen", "force_n"),
    [((6.0, 4.0), True, 5.0), ((6.0, 4.0), False, 6.0), ((6.0, 2.9), True, 6.0)],
)
def test_larger_side_counts_on_the_table_and_where_one_reads_less_than_half_of_the_other(
    sides_n: tuple[float, float], risen: bool, force_n: float
) -> None:
    now = gripped(0.5).at((52, 50, 50), sides_n, risen=risen).now
    assert now is not None and now.force_n == force_n


def test_rise_on_the_table_after_the_first_grasp_lowers_no_stiffness() -> None:
    assert gripped(3.0).at((52, 50, 50), (4.5, 4.5), risen=False).rise_n == pytest.approx(3.0)
