"""Session of an acquisition (paper, section III-B): press, stroke and pause, on any rig."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from drivers.errors import ConfigError, GraspError, Stale, describe_exception
from drivers.interfaces import PERIOD_NS, PERIOD_S, ArmState, TactileFrame
from grasp.run import signals
from grasp.run.clock import Deadlines
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import (
    DRIVE_MPS2,
    PressCommand,
    PressController,
    PressPhase,
    StrokeMotion,
)
from scenarios.rigs.opening import open_press_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import PressRig
from scenarios.world.truth import PressedTruth

if TYPE_CHECKING:
    from scenarios.world.pressed_cell import PressedCell

# All assumed, unless a source is named.
REST_TIMEOUT_S = 5.0
LOADED_REST_MAX_STD_COUNTS = 200.0  # of a taxel under load: any variation of a pressed fingertip
TOUCH_TIMEOUT_S = 15.0  # from the start: 5 s of rest counts, and 10 cm at control.approach_mps
KEPT_AFTER_S = 0.75  # samples are kept from this time after contact: half of the settling time
RETREAT_MPS, STOP_MPS2 = 0.05, 1.0
STOP_TIMEOUT_S = 1.0  # a stop is repeated until the arm is at rest, or for this time
JITTER_S = 0.0005  # of a sample's time; real recording: 0.7 ms for the difference of two
SHOWN_AFTER = 4  # samples until the arm's state shows the effect of a command


class Sample(msgspec.Struct, frozen=True):
    """A sample of a session: measurements, command and truth."""

    t_ns: int
    phase: PressPhase
    force_n: float  # estimated
    frame: TactileFrame
    arm: ArmState
    command: PressCommand
    truth: PressedTruth | None


OnTick = Callable[[Sample], None]
Script = Callable[[float, PressController, "PressedCell | None"], None]


def counts_per_newton(config: AcquireConfig, seed: int) -> float:
    """Calibration of the force estimate. Raises ConfigError on hardware without one."""
    known = config.control.counts_per_newton
    if known:
        return known
    if config.rig == "hardware":
        raise ConfigError(
            "control", "counts_per_newton", "must be measured on this rig",
            "sum of a fingertip's counts under a known weight, over that weight in newtons",
        )  # fmt: skip
    return pressed_gain(config, seed)


def pressed_gain(config: AcquireConfig, seed: int) -> float:
    """Sum of counts per newton of the simulated fingertip at the target force, as measured with a
    weight on this fingertip and its tilt."""
    from scenarios.rigs.simulated import make_pressed_cell

    still = msgspec.structs.replace(
        config.fingertip, wander_mm=0.0, vibration_mm=0.0, sway_mm=0.0, noise_counts=0.0
    )
    cell = make_pressed_cell(msgspec.structs.replace(config, fingertip=still), seed)
    tips, load_n = cell.pad.tips, config.control.force_n
    zeros = np.zeros((1, 2))
    for i in range(100):
        load = np.array([load_n * min(1.0, i / 50)])
        tips.advance((i + 1) * PERIOD_S, load, zeros, np.zeros(1), zeros, False)
    difference = (tips.rest - tips.codes()[0]).sum()
    return max(1.0, float(difference) / load_n)


@contextmanager
def open_acquire_rig(
    config: AcquireConfig, seed: int, paced: bool, permit: MotionPermit | None = None
) -> Iterator[PressRig]:
    """``open_press_rig`` with a driver that accepts the unsteady rest counts under load."""
    if config.control.residual_n > 0.0:
        tactile = msgspec.structs.replace(
            config.tactile, rest_min_counts=0, rest_max_std_counts=LOADED_REST_MAX_STD_COUNTS
        )
        config = msgspec.structs.replace(config, tactile=tactile)
    with open_press_rig(config, seed, paced, permit) as rig:
        yield rig


class Session:
    """A session on an open rig: call ``run``, then read ``ticks``."""

    def __init__(
        self, config: AcquireConfig, motion: StrokeMotion | None, seed: int, rig: PressRig,
        on_tick: OnTick = lambda tick: None, script: Script = lambda t_s, controller, cell: None,
    ) -> None:  # fmt: skip
        self._config = config
        self._rig = rig
        self._on_tick = on_tick
        self._script = script
        pace, course = np.random.default_rng([seed, 1]).spawn(2)
        self._pace = pace
        self._controller = PressController(
            config.control, counts_per_newton(config, seed), motion, course
        )
        self.ticks: list[Sample] = []
        self._start_ns = rig.clock.now_ns
        self._deadlines = Deadlines(self._start_ns, PERIOD_NS)
        self._touched_ns: int | None = None

    @property
    def phase(self) -> PressPhase:
        return self._controller.phase

    @property
    def missed_periods(self) -> int:
        """Sample periods missed because the process was late."""
        return self._deadlines.missed

    def run(self, samples: int, from_start: bool = False) -> None:
        """Take rest counts, approach, and record ``samples`` after half of the settling time, or
        with ``from_start`` from the approach on. The arm stops also after an error."""
        rig, arm = self._rig, self._rig.arm
        arm.poll(rig.clock.now_ns)
        self._take_rest()
        start = arm.state
        try:
            if self._config.control.residual_n > 0.0:
                self._rest_under_load(self._config.control.residual_n)
            while len(self.ticks) < samples:
                tick = self._sample()
                if from_start or self._settled(tick):
                    self.ticks.append(tick)
                self._on_tick(tick)
        finally:
            arm.stop(STOP_MPS2)
        if start is not None:
            self._retreat(start)

    def _take_rest(self) -> None:
        rig = self._rig
        rig.tactile.begin_rest()
        end_ns = rig.clock.now_ns + round(REST_TIMEOUT_S * 1e9)
        while not rig.tactile.rest_taken:
            if rig.clock.now_ns > end_ns:
                raise Stale("the fingertips send no rest counts", "see `grasp tactile`")
            self._wait()
            rig.arm.poll(rig.clock.now_ns)
            rig.tactile.poll(rig.clock.now_ns)

    def _rest_under_load(self, residual_n: float) -> None:
        """Press with ``residual_n``, stop, and take rest counts that include this load."""
        controller, settings = self._controller, self._config.control
        presser = PressController(settings, controller.counts_per_newton, None, self._pace)
        presser.target_n = residual_n
        self._controller = presser
        while self._touched_ns is None or not self._settled(self._sample()):
            self._sample()
        self._rig.arm.stop(STOP_MPS2)
        self._take_rest()
        controller.zero_n = presser.force_n
        self._controller, self._touched_ns = controller, None

    def _wait(self) -> None:
        """Wait for the next sample, in a simulation with the real board's jitter and losses. Raises
        Interruption after a signal."""
        signals.check()
        rig = self._rig
        self._deadlines.skip_missed(rig.clock.now_ns)
        due_ns = self._deadlines.next_ns()
        if rig.cell is None:
            rig.clock.sleep_until_ns(due_ns)
            return
        jitter = float(np.clip(self._pace.standard_normal(), -4.0, 4.0)) * JITTER_S
        wake_ns = due_ns + round(jitter * 1e9)
        if self._pace.random() < self._config.sampling.lost_share:
            rig.cell.board.silence(wake_ns)
        rig.clock.sleep_until_ns(wake_ns)

    def _sample(self) -> Sample:
        """Exchange data with each device once and make a controller step."""
        self._wait()
        rig, controller = self._rig, self._controller
        now_ns = rig.clock.now_ns
        rig.arm.poll(now_ns)
        rig.tactile.poll(now_ns)
        frame, arm = rig.tactile.frame, rig.arm.state
        if frame is None or arm is None or frame.stale:
            raise Stale("the fingertips stopped sending", "see `grasp tactile`, then run again")
        t_s = (now_ns - self._start_ns) * 1e-9
        self._script(t_s, controller, rig.cell)
        command = controller.step(t_s, frame.counts[self._config.finger], arm)
        rig.arm.drive(command.velocity_mps, command.spin_radps, DRIVE_MPS2)
        self._check_approach(now_ns)
        truth = rig.truth()
        return Sample(now_ns, controller.phase, controller.force_n, frame, arm, command, truth)

    def _settled(self, tick: Sample) -> bool:
        settling_ns = tick.t_ns - (self._touched_ns if self._touched_ns is not None else tick.t_ns)
        return settling_ns > KEPT_AFTER_S * 1e9

    def _check_approach(self, now_ns: int) -> None:
        if self._controller.phase is not PressPhase.APPROACH:
            if self._touched_ns is None:
                self._touched_ns = now_ns
        elif now_ns - self._start_ns > TOUCH_TIMEOUT_S * 1e9:
            raise Stale(
                f"no contact within {TOUCH_TIMEOUT_S:g} s",
                "start closer above the surface, or check which finger is pressed",
            )

    def _retreat(self, start: ArmState) -> None:
        arm, clock = self._rig.arm, self._rig.clock
        self._wait_for_rest()
        arm.move_to(start.position_m, RETREAT_MPS, STOP_MPS2)
        arm.poll(clock.now_ns)
        self._wait_for_rest()

    def stop_arm(self) -> str:
        """Command a stop until the arm is at rest, or time is up; returns its state as a text."""
        arm, clock = self._rig.arm, self._rig.clock
        moving, failure = True, ""
        end_ns = clock.now_ns + round(STOP_TIMEOUT_S * 1e9)
        while moving and clock.now_ns < end_ns:
            try:
                arm.stop(STOP_MPS2)
                clock.sleep_until_ns(clock.now_ns + SHOWN_AFTER * PERIOD_NS)
                arm.poll(clock.now_ns)
                failure, moving = "", self._moving
            except GraspError as error:
                failure = f" in its last known state: {error.message}"
                clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
            except Exception as error:  # the stop is repeated after any error
                failure = f" in its last known state: {describe_exception(error)}"
                clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        if failure:
            return f"the arm was {'still moving' if self._moving else 'stationary'}{failure}"
        return "the arm is still moving" if moving else "the arm is stationary"

    @property
    def _moving(self) -> bool:
        state = self._rig.arm.state
        return state is None or state.moving

    def _wait_for_rest(self) -> None:
        """Wait until the arm is at rest. Its driver raises if it stops responding."""
        arm, clock, samples = self._rig.arm, self._rig.clock, 0
        while samples < SHOWN_AFTER or (arm.state is not None and arm.state.moving):
            clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
            arm.poll(clock.now_ns)
            samples += 1
