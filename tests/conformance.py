"""Conformance tests of a driver against a protocol of `drivers.interfaces`, to be copied.

A project with a driver for a gripper, an arm or fingertips copies this file and runs the tests
against its emulator or, with a person at the emergency stop, against the device:

    from conformance import Bench, GripperConformance

    class TestAcme(GripperConformance):
        @pytest.fixture
        def bench(self):
            with AcmeEmulator() as emulator, AcmeGripper(emulator.address) as gripper:
                yield Bench(gripper, time.monotonic_ns, time.sleep, cut=emulator.stop)

The hand must be empty, and the arm needs free space above it. Each test gets a new bench. See
docs/extending.md.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Generic, TypeVar

import msgspec
import numpy as np
import pytest

from drivers.errors import GraspError, LinkLost, Refused, Stale
from drivers.interfaces import (
    CODE_MAX,
    FINGERS,
    PERIOD_NS,
    Arm,
    ArmState,
    Gripper,
    GripperState,
    TactileFrame,
    TactileSensor,
    Vector3,
)

DeviceT = TypeVar("DeviceT")
STEP_S = 0.01
SOON_S = 5.0  # time limit for immediate reactions
ACTIVATION_S = 60.0
NEAR_COUNTS = 3  # tolerance at a target; a count is 0.8 mm
NEAR_M = 0.002


class Bench(msgspec.Struct, Generic[DeviceT], frozen=True):
    """Test bench: a connected device, its clock, and a function that waits."""

    device: DeviceT
    now_ns: Callable[[], int]
    wait: Callable[[float], object]  # seconds; in virtual time it advances the emulator
    cut: Callable[[], object] | None = None  # takes the link away; None: cannot be tried
    press: Callable[[], object] | None = None  # loads fingertip A; None: cannot be tried

    def until(
        self, poll: Callable[[int], None], condition: Callable[[], bool], seconds: float = SOON_S
    ) -> None:
        """Poll every 10 ms until the condition holds; fail after ``seconds``."""
        end_ns = self.now_ns() + round(seconds * 1e9)
        poll(self.now_ns())
        while not condition():
            assert self.now_ns() < end_ns, f"not reached within {seconds:g} s"
            self.wait(STEP_S)
            poll(self.now_ns())

    def errors(self, poll: Callable[[int], None], seconds: float = SOON_S) -> list[GraspError]:
        """Poll until the first GraspError: a list of that error, empty if there is none within
        ``seconds``. Other exceptions pass through."""
        end_ns = self.now_ns() + round(seconds * 1e9)
        while self.now_ns() < end_ns:
            try:
                poll(self.now_ns())
            except GraspError as error:
                return [error]
            self.wait(STEP_S)
        return []


class GripperConformance:
    """Tests of ``drivers.interfaces.Gripper``. They need a fixture ``bench``: a `Bench` of an empty
    gripper that is on and not activated."""

    speed_mps = 0.05
    force_n = 15.0  # that the hand can be set to
    free_counts = (60, 60, 60)  # targets that every finger reaches without contact
    further_counts = (100, 60, 60)

    def ready(self, bench: Bench[Gripper]) -> Gripper:
        """Activate the gripper and wait until it is at rest."""
        gripper = bench.device
        bench.until(gripper.poll, lambda: gripper.state is not None)
        gripper.activate()
        bench.until(gripper.poll, lambda: self.state(gripper).active, ACTIVATION_S)
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest)
        return gripper

    @staticmethod
    def state(gripper: Gripper) -> GripperState:
        """The latest state; fails if there is none."""
        state = gripper.state
        assert state is not None
        return state

    def test_state_is_reported_soon_with_its_age(self, bench: Bench[Gripper]) -> None:
        gripper = bench.device
        bench.until(gripper.poll, lambda: gripper.state is not None)
        first = self.state(gripper)
        assert 0 <= first.age_ns(bench.now_ns()) < 1_000_000_000
        bench.wait(STEP_S)
        bench.until(gripper.poll, lambda: self.state(gripper).seq > first.seq)
        assert self.state(gripper).t_ns > first.t_ns
        with pytest.raises(AttributeError):
            first.seq = 0  # type: ignore[misc]

    def test_only_activate_activates_it(self, bench: Bench[Gripper]) -> None:
        gripper = bench.device
        bench.until(gripper.poll, lambda: gripper.state is not None)
        assert not self.state(gripper).active
        assert self.state(self.ready(bench)).fault == 0

    def test_fingers_move_to_their_targets(self, bench: Bench[Gripper]) -> None:
        gripper = self.ready(bench)
        applied = gripper.move_to(self.free_counts, self.speed_mps, self.force_n)
        assert applied.targets_counts == self.free_counts
        bench.until(gripper.poll, lambda: self.state(gripper).requested == self.free_counts)
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest, 20.0)
        self.at_rest_at(gripper, self.free_counts)

    def at_rest_at(self, gripper: Gripper, counts: tuple[int, int, int]) -> None:
        """Assert that each finger is within ``NEAR_COUNTS`` of its target."""
        pairs = zip(self.state(gripper).positions, counts, strict=True)
        assert all(abs(at - there) <= NEAR_COUNTS for at, there in pairs)

    def test_a_status_from_before_a_command_is_not_fresh(self, bench: Bench[Gripper]) -> None:
        gripper = self.ready(bench)
        gripper.move_to(self.free_counts, self.speed_mps, self.force_n)
        assert not self.state(gripper).at_rest
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest, 20.0)
        self.at_rest_at(gripper, self.free_counts)

    def test_it_says_what_force_it_applies_and_never_more_than_it_may(
        self, bench: Bench[Gripper]
    ) -> None:
        gripper = self.ready(bench)
        least_n = gripper.least_force_n
        for requested_n in (least_n, least_n + 0.3, self.force_n):
            applied = gripper.move_to(self.free_counts, self.speed_mps, requested_n)
            assert least_n <= applied.force_n <= requested_n + 1e-9
            bench.until(gripper.poll, lambda: self.state(gripper).fresh)
        with pytest.raises(Refused):
            gripper.move_to(self.free_counts, self.speed_mps, 0.9 * least_n)
        with pytest.raises(Refused):
            gripper.close_to_limit(
                0.9 * least_n, (True, False, False), self.further_counts, self.speed_mps
            )

    def test_only_the_fingers_that_close_move_and_none_beyond_its_limit(
        self, bench: Bench[Gripper]
    ) -> None:
        gripper = self.ready(bench)
        gripper.move_to(self.free_counts, self.speed_mps, self.force_n)
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest, 20.0)
        before = self.state(gripper).positions
        gripper.close_to_limit(
            self.force_n, (True, False, False), self.further_counts, self.speed_mps
        )
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest, 20.0)
        self.at_rest_at(gripper, (self.further_counts[0], before[1], before[2]))
        assert self.state(gripper).positions[0] <= self.further_counts[0]

    def test_hold_stops_moving_fingers(self, bench: Bench[Gripper]) -> None:
        gripper = self.ready(bench)
        gripper.move_to(self.free_counts, 0.022, self.force_n)
        bench.until(
            gripper.poll, lambda: self.state(gripper).positions[0] > self.free_counts[0] // 3
        )
        gripper.hold()
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest)
        assert self.state(gripper).positions[0] < self.free_counts[0] - NEAR_COUNTS

    def test_an_open_hand_is_reported_open(self, bench: Bench[Gripper]) -> None:
        gripper = self.ready(bench)
        gripper.move_to(self.free_counts, self.speed_mps, self.force_n)
        bench.until(gripper.poll, lambda: self.state(gripper).at_rest, 20.0)
        gripper.open(self.speed_mps)
        bench.until(
            gripper.poll, lambda: self.state(gripper).at_rest and self.state(gripper).is_open, 20.0
        )

    def test_a_lost_link_is_raised_by_poll_and_by_no_command(self, bench: Bench[Gripper]) -> None:
        gripper = self.ready(bench)
        if bench.cut is None:
            pytest.skip("this bench cannot cut the link")
        bench.cut()
        (error,) = bench.errors(gripper.poll)
        assert isinstance(error, LinkLost)
        gripper.hold()
        gripper.open(self.speed_mps)


class FingertipConformance:
    """Tests of ``drivers.interfaces.TactileSensor``. They need a fixture ``bench``: a `Bench` of
    unloaded fingertips."""

    taxels = 6

    def sampling(self, bench: Bench[TactileSensor]) -> TactileSensor:
        """Take rest counts and wait for a frame."""
        sensor = bench.device
        bench.until(sensor.poll, lambda: True)
        sensor.begin_rest()
        bench.until(sensor.poll, lambda: sensor.rest_taken and sensor.frame is not None)
        return sensor

    @staticmethod
    def frame(sensor: TactileSensor) -> TactileFrame:
        """The latest frame; fails if there is none."""
        frame = sensor.frame
        assert frame is not None
        return frame

    def test_there_is_no_frame_before_rest_counts_are_taken(
        self, bench: Bench[TactileSensor]
    ) -> None:
        sensor = bench.device
        bench.until(sensor.poll, lambda: True)
        assert not sensor.rest_taken
        assert sensor.frame is None
        self.sampling(bench)

    def test_frames_come_on_a_grid_of_10_ms(self, bench: Bench[TactileSensor]) -> None:
        sensor = self.sampling(bench)
        found = [self.frame(sensor)]
        for _ in range(50):
            bench.wait(STEP_S)
            sensor.poll(bench.now_ns())
            if self.frame(sensor).seq > found[-1].seq:
                found.append(self.frame(sensor))
        assert all(b.t_ns > a.t_ns for a, b in pairwise(found))
        assert all(f.sampled_ns <= f.t_ns <= bench.now_ns() for f in found)
        first, last = found[0], found[-1]
        period_ns = (last.t_ns - first.t_ns) / (last.seq - first.seq)
        assert abs(period_ns - PERIOD_NS) < 0.1 * PERIOD_NS

    def test_counts_are_raw_minus_rest(self, bench: Bench[TactileSensor]) -> None:
        frame = self.frame(self.sampling(bench))
        for array in (frame.counts, frame.raw, frame.rest, frame.temperature):
            assert array.shape == (FINGERS, self.taxels)
            assert array.dtype == np.int16
        assert np.array_equal(frame.counts, frame.raw - frame.rest)
        assert 0 <= frame.raw.min() <= frame.raw.max() <= CODE_MAX

    def test_a_frame_that_was_handed_over_does_not_change(
        self, bench: Bench[TactileSensor]
    ) -> None:
        sensor = self.sampling(bench)
        frame = self.frame(sensor)
        counts, raw, seq = frame.counts.copy(), frame.raw.copy(), frame.seq
        bench.until(sensor.poll, lambda: self.frame(sensor).seq > seq + 5)
        assert np.array_equal(frame.counts, counts) and np.array_equal(frame.raw, raw)

    def test_pressing_is_negative(self, bench: Bench[TactileSensor]) -> None:
        sensor = self.sampling(bench)
        if bench.press is None:
            pytest.skip("this bench cannot press a fingertip")
        bench.press()
        bench.until(sensor.poll, lambda: bool(self.frame(sensor).counts[0].min() < -20))

    def test_lost_samples_are_stale_before_long(self, bench: Bench[TactileSensor]) -> None:
        sensor = self.sampling(bench)
        if bench.cut is None:
            pytest.skip("this bench cannot cut the link")
        bench.cut()

        def poll(now_ns: int) -> None:
            sensor.poll(now_ns)
            if self.frame(sensor).stale:
                raise Stale("the frame is stale", "none")

        (error,) = bench.errors(poll)
        assert isinstance(error, LinkLost | Stale)


class ArmConformance:
    """Tests of ``drivers.interfaces.Arm``. They need a fixture ``bench``: a `Bench` of an arm at
    rest, with ``up_m`` of free space above it."""

    up_m = 0.03
    speed_mps = 0.05
    acceleration_mps2 = 0.5
    outside_m: Vector3 = (5.0, 0.0, 0.0)  # relative to its position: beyond every limit

    def standing(self, bench: Bench[Arm]) -> Arm:
        """Wait for a state and a standstill."""
        arm = bench.device
        bench.until(arm.poll, lambda: arm.state is not None and not self.state(arm).moving)
        return arm

    @staticmethod
    def state(arm: Arm) -> ArmState:
        """The latest state; fails if there is none."""
        state = arm.state
        assert state is not None
        return state

    @staticmethod
    def above(at_m: Vector3, up_m: float) -> Vector3:
        return (at_m[0], at_m[1], at_m[2] + up_m)

    def rises(self, arm: Arm) -> Vector3:
        """Command a motion up; returns its target."""
        there_m = self.above(self.state(arm).position_m, self.up_m)
        arm.move_to(there_m, self.speed_mps, self.acceleration_mps2)
        return there_m

    def test_position_is_reported_with_its_age(self, bench: Bench[Arm]) -> None:
        state = self.state(self.standing(bench))
        assert 0 <= state.age_ns(bench.now_ns()) < 1_000_000_000
        assert all(math.isfinite(x) for x in (*state.position_m, *state.velocity_mps))

    def test_a_move_starts_at_once_and_ends_at_its_target(self, bench: Bench[Arm]) -> None:
        arm = self.standing(bench)
        there_m = self.rises(arm)
        assert self.state(arm).moving
        fastest = 0.0

        def arrived() -> bool:
            nonlocal fastest
            fastest = max(fastest, math.hypot(*self.state(arm).velocity_mps))
            return not self.state(arm).moving

        bench.until(arm.poll, arrived, 10.0)
        assert math.dist(self.state(arm).position_m, there_m) < NEAR_M
        assert fastest < 1.1 * self.speed_mps

    def test_a_stop_ends_a_move(self, bench: Bench[Arm]) -> None:
        arm = self.standing(bench)
        before_m = self.state(arm).position_m
        there_m = self.rises(arm)
        bench.until(
            arm.poll, lambda: math.dist(self.state(arm).position_m, before_m) > self.up_m / 5
        )
        arm.stop(self.acceleration_mps2 * 2)
        bench.until(arm.poll, lambda: not self.state(arm).moving, 1.0)
        stood_m = self.state(arm).position_m
        assert math.dist(stood_m, there_m) > self.up_m / 5
        bench.wait(0.3)
        arm.poll(bench.now_ns())
        assert math.dist(self.state(arm).position_m, stood_m) < 0.001

    def test_a_drive_that_is_not_renewed_is_stopped(self, bench: Bench[Arm]) -> None:
        arm = self.standing(bench)
        arm.drive((0.0, 0.0, 0.02), 0.0, self.acceleration_mps2)
        bench.until(arm.poll, lambda: self.state(arm).velocity_mps[2] > 0.01)
        bench.until(arm.poll, lambda: abs(self.state(arm).velocity_mps[2]) < 0.001, 2.0)

    @pytest.mark.parametrize("wrong", ["place", "speed", "acceleration"])
    def test_what_is_beyond_its_limits_is_refused_before_it_moves(
        self, wrong: str, bench: Bench[Arm]
    ) -> None:
        arm = self.standing(bench)
        at_m = self.state(arm).position_m
        x, y, z = (a + b for a, b in zip(at_m, self.outside_m, strict=True))
        there_m = (x, y, z) if wrong == "place" else self.above(at_m, self.up_m)
        speed_mps = 50.0 if wrong == "speed" else self.speed_mps
        acceleration_mps2 = 500.0 if wrong == "acceleration" else self.acceleration_mps2
        with pytest.raises(Refused):
            arm.move_to(there_m, speed_mps, acceleration_mps2)
        bench.wait(0.2)
        arm.poll(bench.now_ns())
        assert math.dist(self.state(arm).position_m, at_m) < 0.001

    def test_a_lost_link_is_raised(self, bench: Bench[Arm]) -> None:
        arm = self.standing(bench)
        if bench.cut is None:
            pytest.skip("this bench cannot cut the link")
        bench.cut()
        (error,) = bench.errors(arm.poll)
        assert isinstance(error, LinkLost | Stale)
