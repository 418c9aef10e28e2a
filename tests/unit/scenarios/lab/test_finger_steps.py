"""Motions of the hand in short steps, on a modelled hand in virtual time, with and without a frozen
link."""

import re
from asyncio import CancelledError
from collections.abc import Callable

import numpy as np
import pytest

from drivers.errors import DeviceFault, LinkLost
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.model.gripper import HandSettings
from grasp.run.clock import VirtualClock
from scenarios.lab.calibrate import BACK_COUNTS, Presser
from scenarios.lab.hand import LEAD_M, TRIES, Hand, closing_targets, lead_counts, retry
from tests.calibrations import MANUAL, PAPER
from tests.unit.drivers.robotiq.conftest import MS, Rig, Springs
from tests.unit.scenarios.conftest import config

LAB = config("gripper.calibration=paper")
LEAD = lead_counts(PAPER.m_per_count)
OPEN = 6
NOTHING, SCALE = Springs((0, 0, 0), (1, 1, 1)), Springs((2500, 0, 0), (0.08, 1, 1))  # N/m, m

AllThree = tuple[int, int, int]


class Pressed:
    """Fingertips with these sums of counts once a finger has closed to 30 counts."""

    def __init__(self, bench: "Bench", counts_sum: list[float]) -> None:
        self._bench, self._pressed = bench, tuple(counts_sum)

    def poll(self, now_ns: int) -> None: ...

    @property
    def counts_sum(self) -> tuple[float, ...]:
        return self._pressed if max(self._bench.positions) >= 30 else (0.0, 0.0, 0.0)


class Bench:
    """A modelled hand whose link freezes once ``freeze`` is true of the finger positions."""

    def __init__(
        self,
        springs: Springs = NOTHING,
        freeze: Callable[[AllThree], bool] | None = None,
        calibration: GripperCalibration = PAPER,
    ) -> None:
        self.rig = Rig(HandSettings(), calibration, springs=springs)
        self.freeze = freeze
        self.clock = VirtualClock(self._advance)
        self.messages: list[str] = []
        self.rig.driver.poll(0)
        known = LAB if calibration is PAPER else config("gripper.calibration=manual")
        self.hand = Hand(known, self.rig.driver, None, self.clock, "grasp release")
        self.presser = Presser(self.hand, "A")

    def _advance(self, t_ns: int) -> None:
        while self.rig.now_ns < t_ns:
            self.rig.advance(1)
            if self.freeze is not None and self.freeze(self.positions):
                self.frozen_at, self.freeze = self.positions, None
                self.rig.transport.down = True

    @property
    def positions(self) -> AllThree:
        a, b, c = np.round(self.rig.model.travel_m / PAPER.m_per_count).astype(int).tolist()
        return a, b, c

    def close(self, *targets: int) -> None:
        self.hand.move(targets, self.messages.append)

    def final_positions(self) -> AllThree:
        """Positions of the fingers after 15 s."""
        self._advance(self.rig.now_ns + 15_000 * MS)
        return self.positions


@pytest.mark.parametrize(
    "targets", [(255, OPEN, OPEN), (OPEN, 255, 255), (255, 255, 255)], ids=["A", "BC", "ABC"]
)
def test_frozen_link_leaves_no_more_than_one_short_step(targets: AllThree) -> None:
    bench = Bench(freeze=lambda at: max(at) >= 50)
    with pytest.raises(LinkLost):
        bench.close(*targets)
    ends = bench.final_positions()
    moved = [end - start for end, start in zip(ends, bench.frozen_at, strict=True)]
    assert max(moved) <= LEAD <= LEAD_M / PAPER.m_per_count
    assert [counts > 0 for counts in moved] == [target == 255 for target in targets]
    last = re.search(r"last commanded to \((.*)\) counts", bench.messages[0])
    assert last is not None
    assert bench.positions == tuple(map(int, last[1].split(", ")))


def test_frozen_link_stops_a_press_before_the_scale() -> None:
    bench = Bench(SCALE, freeze=lambda at: at[0] >= 90)
    with pytest.raises(LinkLost):
        bench.presser.move_to(255)
    assert bench.final_positions()[0] <= 90 + LEAD
    bench.presser.back_off(bench.messages.append, "grasp release")
    assert "BACK-OFF NOT CONFIRMED" in bench.messages[0]


def test_fingers_close_and_open_fully_in_free_air() -> None:
    bench = Bench()
    bench.close(255, OPEN, OPEN)
    assert bench.positions == (240, OPEN, OPEN)  # limit of the hand
    bench.close(0, 0, 0)
    assert bench.positions == (OPEN, OPEN, OPEN)


@pytest.mark.parametrize(
    ("reads", "closes", "swapped"),
    [(1, "B", False), (2, "B", True), (0, "BC", True), (2, "BC", False)],
)
def test_a_fingertip_that_responds_although_another_finger_closes_is_named(
    reads: int, closes: str, swapped: bool
) -> None:
    bench, pressed = Bench(), [0.0, 0.0, 0.0]
    pressed[reads] = -400.0
    bench.hand = Hand(LAB, bench.rig.driver, Pressed(bench, pressed), bench.clock, "")  # type: ignore[arg-type]
    targets = closing_targets(bench.positions, closes, 90)
    moved = bench.hand.close(targets, bench.messages.append)
    assert max(moved.positions_counts) < 50
    name = "ABC"[reads]
    problem = f"fingertip {name} responds, but {closes} closes: press each pad in `grasp tactile"
    assert (
        moved.stopped_by.startswith(problem if swapped else "")
        and bool(moved.stopped_by) is swapped
    )


def test_targets_that_do_not_follow_a_step_are_reported() -> None:
    bench = Bench()
    bench.rig.model.ignores_writes = True
    with pytest.raises(DeviceFault, match=r"another client .* targets \(\d.*, expected \(\d"):
        bench.close(60, 60, 60)


def test_press_in_steps_reaches_the_full_force() -> None:
    bench = Bench(SCALE, calibration=MANUAL)
    contact = bench.presser.move_to(255)
    assert contact
    assert bench.rig.springs.force_n(bench.rig.model.travel_m)[0] == pytest.approx(10.0, abs=0.5)
    pressed = bench.positions[0]
    bench.presser.back_off(bench.messages.append, "grasp release --rig hardware")
    assert bench.final_positions()[0] == pressed - BACK_COUNTS
    assert "`grasp release --rig hardware`" in bench.messages[0]


@pytest.mark.parametrize(
    "bug", [LinkLost("gone", "look"), ValueError(), SystemExit(0), CancelledError()]
)
def test_action_that_fails_once_is_repeated(bug: BaseException) -> None:
    calls: list[int] = []
    clock = VirtualClock(lambda t_ns: None)

    def fails_once() -> None:
        calls.append(clock.now_ns)
        if len(calls) == 1:
            raise bug

    assert retry(fails_once, clock)
    assert len(calls) == 2 and calls[1] > calls[0]


def test_action_that_always_fails_is_abandoned() -> None:
    calls: list[int] = []

    def fails() -> None:
        calls.append(1)
        raise ZeroDivisionError

    assert not retry(fails, VirtualClock(lambda t_ns: None))
    assert len(calls) == TRIES
