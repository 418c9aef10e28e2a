"""Motions of the hand as short steps, on a modelled hand in virtual time: what a frozen link leaves
to be done, and what is done where it answers."""

import re
from asyncio import CancelledError
from collections.abc import Callable

import numpy as np
import pytest

from drivers.errors import LinkLost
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.model.gripper import HandSettings
from grasp.clock import VirtualClock
from scenarios.lab.calibrate import BACK_COUNTS, Presser
from scenarios.lab.hand import LEAD_M, TRIES, Hand, lead_counts, retry
from tests.calibrations import MANUAL, PAPER
from tests.unit.drivers.robotiq.conftest import MS, Rig, Springs
from tests.unit.scenarios.conftest import config

LAB = config("gripper.calibration=paper")
LEAD = lead_counts(PAPER.m_per_count)
OPEN = 6
NOTHING, SCALE = Springs((0, 0, 0), (1, 1, 1)), Springs((2500, 0, 0), (0.08, 1, 1))  # N/m, m

AllThree = tuple[int, int, int]


class Bench:
    """A hand that is moved by hand, its link freezing once finger A or B is so far closed, and how
    fast it is in every millisecond."""

    def __init__(
        self,
        springs: Springs = NOTHING,
        freeze: Callable[[AllThree], bool] | None = None,
        calibration: GripperCalibration = PAPER,
    ) -> None:
        self.rig = Rig(HandSettings(), calibration, springs=springs)
        self.freeze = freeze
        self.clock = VirtualClock(self._advance)
        self.speeds: list[float] = []
        self.heard: list[str] = []
        self.rig.driver.poll(0)
        known = LAB if calibration is PAPER else config("gripper.calibration=manual")
        self.hand = Hand(known, self.rig.driver, None, self.clock, "grasp release")
        self.presser = Presser(self.hand, "A")

    def _advance(self, t_ns: int) -> None:
        while self.rig.now_ns < t_ns:
            self.rig.advance(1)
            self.speeds.append(float(self.rig.model.velocity_mps.max()))
            if self.freeze is not None and self.freeze(self.places):
                self.frozen_at, self.freeze = self.places, None
                self.rig.transport.down = True

    @property
    def places(self) -> AllThree:
        a, b, c = np.round(self.rig.model.travel_m / PAPER.m_per_count).astype(int).tolist()
        return a, b, c

    def close(self, *targets: int) -> None:
        self.hand.move(targets, self.heard.append)

    def later(self) -> AllThree:
        """Where the fingers have come to stand in the end."""
        self._advance(self.rig.now_ns + 15_000 * MS)
        return self.places


@pytest.mark.parametrize(
    "targets", [(255, OPEN, OPEN), (OPEN, 255, 255), (255, 255, 255)], ids=["A", "BC", "ABC"]
)
def test_frozen_link_leaves_no_more_than_one_short_step(targets: AllThree) -> None:
    bench = Bench(freeze=lambda at: max(at) >= 50)
    with pytest.raises(LinkLost):
        bench.close(*targets)
    further = [end - at for end, at in zip(bench.later(), bench.frozen_at, strict=True)]
    assert max(further) <= LEAD <= LEAD_M / PAPER.m_per_count
    assert [way > 0 for way in further] == [target == 255 for target in targets]
    told = re.search(r"told to go to \((.*)\) counts and no further", bench.heard[0])
    assert told is not None
    assert bench.places == tuple(map(int, told[1].split(", ")))


def test_frozen_link_stops_a_press_on_its_way_to_the_scale() -> None:
    bench = Bench(SCALE, freeze=lambda at: at[0] >= 90)
    with pytest.raises(LinkLost):
        bench.presser.to(255)
    assert bench.later()[0] <= 90 + LEAD
    bench.presser.back_off(bench.heard.append, "grasp release")
    assert "NOT SEEN TO BACK OFF" in bench.heard[0]


def test_closing_goes_all_the_way_where_nothing_is_and_opening_back() -> None:
    bench = Bench()
    bench.close(255, OPEN, OPEN)
    assert bench.places == (240, OPEN, OPEN)  # the hand's own limit
    bench.close(0, 0, 0)
    assert bench.places == (OPEN, OPEN, OPEN)


def test_press_has_its_whole_force_though_it_is_told_step_by_step() -> None:
    bench = Bench(SCALE, calibration=MANUAL)
    met = bench.presser.to(255)
    assert met
    assert bench.rig.springs.force_n(bench.rig.model.travel_m)[0] == pytest.approx(10.0, abs=0.5)
    at = bench.places[0]
    bench.presser.back_off(bench.heard.append, "grasp release --rig hardware")
    assert bench.later()[0] == at - BACK_COUNTS
    assert "`grasp release --rig hardware`" in bench.heard[0]


@pytest.mark.parametrize(
    "bug", [LinkLost("gone", "look"), ValueError(), SystemExit(0), CancelledError()]
)
def test_what_fails_once_is_asked_for_again(bug: BaseException) -> None:
    asked: list[int] = []
    clock = VirtualClock(lambda t_ns: None)

    def fails_once() -> None:
        asked.append(clock.now_ns)
        if len(asked) == 1:
            raise bug

    assert retry(fails_once, clock)
    assert len(asked) == 2 and asked[1] > asked[0]


def test_what_fails_for_ever_is_given_up() -> None:
    asked: list[int] = []

    def fails() -> None:
        asked.append(1)
        raise ZeroDivisionError

    assert not retry(fails, VirtualClock(lambda t_ns: None))
    assert len(asked) == TRIES
