"""Acquisition of labelled slip data as in the paper (section III-B): press, stroke, pause.

One session leaves one recording. It runs on every rig; where there is a simulation, its truth
gives the second label.
"""

import math
from collections.abc import Callable
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from detector.recordings import MAX_MISSED, SUFFIX, Metadata, Recording, missed_samples, write
from drivers.errors import GraspError, Stale
from drivers.interfaces import ArmState, TactileFrame
from grasp import interruption
from grasp.files import make_private_folder
from scenarios.acquire.config import AcquireConfig, SamplingSettings
from scenarios.acquire.force_calibration import counts_per_newton
from scenarios.acquire.press import PressController, PressPhase, StrokeMotion
from scenarios.acquire.rig import open_acquire_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import PressRig
from scenarios.trial.ending import End
from scenarios.trial.result import Failure, versions
from scenarios.world.pressed_cell import PressedCell, PressedTruth

REST_TIMEOUT_S = 5.0
APPROACH_TIMEOUT_S = 10.0
RETREAT_MPS = 0.05
TURN_RADPS = 1.0  # paper, section III-B
STOP_MPS2 = 1.0
STAND_S = 1.0  # to be seen standing, after the end was asked for
LEAST_SAMPLES = 2  # of a recording


class Sample(msgspec.Struct, frozen=True):
    """One sample of a session."""

    t_ns: int
    phase: PressPhase
    force_n: float  # estimated
    frame: TactileFrame
    arm: ArmState
    truth: PressedTruth | None


OnTick = Callable[[Sample], None]
Script = Callable[[float, PressController, PressedCell | None], None]


class Session:
    """One session on an open rig: ``run`` it, then ask for the ``ticks``."""

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
        self._tick = 0
        self.missed_periods = 0
        self.ticks: list[Sample] = []
        self._start_ns = rig.clock.now_ns
        self._touched_ns: int | None = None

    def run(self, samples: int, from_start: bool = False) -> None:
        """Rest, approach, then so many samples; the arm stops and retreats in any case.

        Kept are the samples since half of the settling time has passed, or with ``from_start``
        all of them, the approach included.
        """
        rig, arm = self._rig, self._rig.arm
        arm.pump(rig.clock.now_ns)
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
            rig.arm.pump(rig.clock.now_ns)
            rig.tactile.pump(rig.clock.now_ns)

    def _rest_under_load(self, residual_n: float) -> None:
        """Press so hard, stand, and take the rest counts again: they hide that load."""
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
        """Until the next sample is due; in a simulation with the real board's jitter and losses.
        Raises Interruption when a signal has come."""
        interruption.check()
        rig, sampling = self._rig, self._config.sampling
        late = int((rig.clock.now_ns - self._start_ns) * 1e-9 / sampling.period_s)
        slept = max(late - self._tick, 0)  # samples that were slept through do not come back
        self.missed_periods += slept
        self._tick += slept + 1
        due_ns = self._start_ns + round(self._tick * sampling.period_s * 1e9)
        if rig.cell is None:
            rig.clock.sleep_until_ns(due_ns)
            return
        jitter = float(np.clip(self._pace.standard_normal(), -4.0, 4.0)) * sampling.jitter_s
        wake_ns = due_ns + round(jitter * 1e9)
        if self._pace.random() < sampling.lost_share:
            rig.cell.board.silence(wake_ns)
        rig.clock.sleep_until_ns(wake_ns)

    def _sample(self) -> Sample:
        """One exchange with each device and one decision."""
        self._wait()
        rig, controller = self._rig, self._controller
        now_ns = rig.clock.now_ns
        rig.arm.pump(now_ns)
        rig.tactile.pump(now_ns)
        frame, arm = rig.tactile.frame, rig.arm.state
        if frame is None or arm is None or frame.stale:
            raise Stale("the fingertips stopped sending", "see `grasp tactile`, then run again")
        t_s = (now_ns - self._start_ns) * 1e-9
        self._script(t_s, controller, rig.cell)
        drive = controller.step(t_s, frame.counts[self._config.finger], arm)
        rig.arm.drive(drive.velocity_mps, drive.spin_radps, self._config.control.drive_mps2)
        self._check_approach(now_ns)
        truth = rig.truth()
        return Sample(now_ns, controller.phase, controller.force_n, frame, arm, truth)

    def _settled(self, tick: Sample) -> bool:
        settling_ns = tick.t_ns - (self._touched_ns if self._touched_ns is not None else tick.t_ns)
        return settling_ns > 0.5 * self._config.control.settle_s * 1e9

    def _check_approach(self, now_ns: int) -> None:
        if self._controller.phase is not PressPhase.APPROACH:
            if self._touched_ns is None:
                self._touched_ns = now_ns
        elif now_ns - self._start_ns > (REST_TIMEOUT_S + APPROACH_TIMEOUT_S) * 1e9:
            raise Stale(
                "nothing was touched on the way down",
                "start closer above the surface, or check which finger is pressed",
            )

    def _retreat(self, start: ArmState) -> None:
        arm, clock = self._rig.arm, self._rig.clock
        self._until_standing()
        arm.move_to(start.position_m, RETREAT_MPS, STOP_MPS2)
        arm.pump(clock.now_ns)
        self._until_standing()

    def stand(self) -> str:
        """Ask the arm to stop until it is seen to stand, for a while; how it was left."""
        arm, clock = self._rig.arm, self._rig.clock
        step_ns = round(self._config.sampling.period_s * 1e9)
        moving, trouble = True, ""
        end_ns = clock.now_ns + round(STAND_S * 1e9)
        while moving and clock.now_ns < end_ns:
            try:
                arm.stop(STOP_MPS2)
                clock.sleep_until_ns(clock.now_ns + 4 * step_ns)  # until the command shows
                arm.pump(clock.now_ns)
                trouble = ""
            except GraspError as error:
                trouble = f" when last heard: {error.message}"
                clock.sleep_until_ns(clock.now_ns + step_ns)
            moving = bool(trouble) or arm.state is None or arm.state.moving
        if trouble:
            moving = arm.state is None or arm.state.moving
            return f"the arm {'was still moving' if moving else 'stood'}{trouble}"
        return "the arm is still moving" if moving else "the arm stands"

    def _until_standing(self) -> None:
        """The arm answers within its own stale limit, so this ends."""
        arm, clock = self._rig.arm, self._rig.clock
        step_ns = round(self._config.sampling.period_s * 1e9)
        for _ in range(4):  # until a command shows
            clock.sleep_until_ns(clock.now_ns + step_ns)
            arm.pump(clock.now_ns)
        while (state := arm.state) is not None and state.moving:
            clock.sleep_until_ns(clock.now_ns + step_ns)
            arm.pump(clock.now_ns)


class FinishedAcquisition(msgspec.Struct, frozen=True):
    """What a run has left behind; with a ``failure`` it ended early, and this is what there was."""

    scenario: str
    rig: str
    surface: str
    direction: str
    seed: int
    samples: int
    slip: int
    slip_true: int | None
    missed_periods: int  # that the session slept through, from its start on
    repeated: int  # samples without a new frame
    force_mean_n: float | None  # estimated by the fingertip
    force_std_n: float | None
    speed_max_mps: float | None
    recordings: list[str]
    failure: Failure | None = None

    def as_json(self) -> str:
        return msgspec.json.encode(self).decode()

    def as_text(self) -> str:
        if not self.recordings:
            return "nothing was recorded"
        true = "" if self.slip_true is None else f" (the contact truly slid in {self.slip_true})"
        cut = "" if len(self.recordings) == 1 else ", cut where too many samples were missing"
        return (
            f"{self.samples} samples, {self.slip} labelled slip{true}, {self.repeated} repeated, "
            f"{self.missed_periods} periods missed\n"
            f"force by the fingertip {self.force_mean_n:.1f} +- {self.force_std_n:.1f} N, "
            f"fastest {(self.speed_max_mps or 0.0) * 1e3:.0f} mm/s\n"
            f"recording: {', '.join(self.recordings)}{cut}"
        )


def run(
    config: AcquireConfig, motion: StrokeMotion, seed: int, seconds: float, runs: Path, paced: bool,
    on_tick: OnTick, permit: MotionPermit | None = None,
) -> FinishedAcquisition:  # fmt: skip
    """One session on the rig of the configuration; writes `runs/<stamp>-acquire-<surface>.npz`.

    What was recorded is kept, whatever ends the session: a device's error or Ctrl-C becomes the
    ``failure``. A recording may not lack many samples in a row, so it is cut in two there.

    Raises ConfigError, the drivers' errors before anything moves, and OSError when it cannot be
    written.
    """
    with interruption.held():
        return _run(config, motion, seed, seconds, runs, paced, on_tick, permit)


def _run(
    config: AcquireConfig, motion: StrokeMotion, seed: int, seconds: float, runs: Path, paced: bool,
    on_tick: OnTick, permit: MotionPermit | None,
) -> FinishedAcquisition:  # fmt: skip
    make_private_folder(runs)
    failure = None
    with open_acquire_rig(config, seed, paced, permit) as rig:
        session = Session(config, motion, seed, rig, on_tick)
        try:
            session.run(round(seconds / config.sampling.period_s))
        except GraspError as error:
            failure = Failure(error.kind, error.message, error.remedy, _left(session))
        except KeyboardInterrupt as stop:
            failure = Failure("interrupted", interruption.cause(stop), "", _left(session))
    parts = [part for part in _without_gaps(session.ticks) if len(part) >= LEAST_SAMPLES]
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")  # noqa: DTZ005  (a person's local time)
    name = f"{stamp}-acquire-{config.surface.name}-{motion.direction}-{seed}"
    names = [name] if len(parts) == 1 else [f"{name}-{k}" for k in range(1, len(parts) + 1)]
    metadata = Metadata(
        set="slide", split="train", surface=config.surface.name, motion=motion.kind,
        speed_mps=motion.speed_mps, spin_radps=motion.spin_radps, direction=motion.direction,
        seed=seed, commit=versions()["commit"],
    )  # fmt: skip
    made = []
    for part, stem in zip(parts, names, strict=True):
        path = runs / f"{stem}{SUFFIX}"
        made.append(recording(part, config, metadata, str(path)))
        write(path, made[-1])
    return _finished(
        config, motion, seed, [t for p in parts for t in p], session.missed_periods, made, failure
    )


def _left(session: Session) -> End:
    return End(session.stand(), "the hand was told nothing", "")


def _without_gaps(ticks: list[Sample]) -> list[list[Sample]]:
    """The session, cut where more samples in a row are missing than a recording may lack."""
    times = np.array([tick.t_ns * 1e-9 for tick in ticks])
    ends = np.flatnonzero(missed_samples(times) > MAX_MISSED) + 1
    edges = [0, *ends.tolist(), len(ticks)]
    return [ticks[first:end] for first, end in pairwise(edges)]


def _finished(
    config: AcquireConfig, motion: StrokeMotion, seed: int, ticks: list[Sample],
    missed_periods: int, made: list[Recording], failure: Failure | None,
) -> FinishedAcquisition:  # fmt: skip
    force = np.array([tick.force_n for tick in ticks])
    fastest = [np.hypot(*r.velocity_mps.T).max() for r in made if r.velocity_mps is not None]
    true = [int(r.slip_true.sum()) for r in made if r.slip_true is not None]
    return FinishedAcquisition(
        "acquire", config.rig, config.surface.name, motion.direction, seed, len(ticks),
        sum(int(r.slip.sum()) for r in made), sum(true) if true else None,
        missed_periods, sum(tick.frame.missed > 0 for tick in ticks),
        float(force.mean()) if ticks else None, float(force.std()) if ticks else None,
        float(max(fastest)) if fastest else None, [r.source for r in made], failure,
    )  # fmt: skip


def recording(
    ticks: list[Sample], config: AcquireConfig, metadata: Metadata, source: str
) -> Recording:
    """Labelled frames of the pressed fingertip."""
    velocity = np.array([_on_fingertip(tick.arm, config) for tick in ticks])
    spin = np.array([tick.arm.spin_radps for tick in ticks])
    truth = [tick.truth for tick in ticks if tick.truth is not None]
    speed, turn, slides = None, None, None
    if len(truth) == len(ticks):
        speed = np.array([t.contact_speed_mps for t in truth])
        turn = np.array([t.contact_turn_radps for t in truth])
        slides = slip_label(speed, turn, config.sampling)
    start_ns = ticks[0].t_ns
    return Recording(
        t_s=np.array([(tick.t_ns - start_ns) * 1e-9 for tick in ticks]),
        counts=np.stack([tick.frame.counts[config.finger] for tick in ticks])[:, None, :],
        slip=slip_label(np.hypot(velocity[:, 0], velocity[:, 1]), abs(spin), config.sampling),
        slip_true=slides,
        source=source,
        metadata=metadata,
        contact_speed_mps=None if speed is None else speed.astype(np.float32),
        contact_turn_radps=None if turn is None else turn.astype(np.float32),
        velocity_mps=velocity.astype(np.float32),
        spin_radps=spin.astype(np.float32),
    )


def slip_label(
    speed_mps: np.ndarray, turn_radps: np.ndarray, sampling: SamplingSettings
) -> np.ndarray:
    """(n,) bool: faster than either bound (paper, section III-B)."""
    out: np.ndarray = (speed_mps > sampling.slip_mps) | (turn_radps > sampling.slip_radps)
    return out


def _on_fingertip(arm: ArmState, config: AcquireConfig) -> tuple[float, float]:
    """The arm's velocity along x and y of the fingertip, m/s."""
    x, y = arm.velocity_mps[0], -arm.velocity_mps[1]
    angle = arm.angle_rad + math.radians(config.control.fingertip_x_deg)
    c, s = math.cos(angle), math.sin(angle)
    return c * x + s * y, -s * x + c * y
