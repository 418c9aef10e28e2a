"""Lifts under every answer to slip, in easy and in hard scenes, ended in the air.

Held is physical: in the air, touched, at rest, the run not ended early. The least force is what
carries the weight in sliding, m g / 2 mu, at the thumb, of that trial's draw.
"""

from collections.abc import Iterator, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import SlipDetector
from drivers.interfaces import FINGERS
from grasp.clock import Clock
from grasp.loop import ControlLoop, Tick
from grasp.phases import Phase
from grasp.step import GraspStep
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.rigs.own_settings import Files
from scenarios.rigs.rig import GraspRig
from scenarios.rigs.workers import Workers, results
from scenarios.rigs.world_of_seed import cell_settings
from scenarios.trial.execution import make_controller, make_guard
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.contact_settings import GROSS_SLIP_MPS
from scenarios.world.truth import Truth

AIR_M = 0.005  # off the table
FEASIBLE = 0.95  # of the force limit: what more than that is asked of, no answer holds
ALARM_NS = 100_000_000  # a false alarm lasts
DRAWN = 1000  # of them, more than a lift may hear
WET_M = 0.1  # a wet patch begins where the object is so high


class Policy(msgspec.Struct, frozen=True):
    """An answer to slip. ``oracle``: slip is heard the moment that it is."""

    name: str
    words: tuple[str, ...]
    oracle: bool = False


class Scene(msgspec.Struct, frozen=True):
    """What makes a lift harder. ``axis`` and ``value``: where it stands in a picture. Friction and
    mass are multiplied; ``wet``: share of the friction that is left from 10 cm on; ``alarms``: so
    many a minute that no slip causes, beside those of the detector."""

    name: str
    axis: str
    value: float
    words: tuple[str, ...] = ()
    friction: float = 1.0
    mass: float = 1.0
    wet: float = 1.0
    alarms: float = 0.0


PAPER = ('controller.answer="jump"', 'controller.closing="constant"')
STEPS = 'controller.answer="stop_and_step"'
POLICIES = (
    Policy("jump, one speed", PAPER),
    Policy("jump", ('controller.answer="jump"',)),
    Policy("stop_and_jump", ('controller.answer="stop_and_jump"',)),
    *(Policy(f"stop_and_step, margin {n}", (STEPS, f"controller.margin_steps={n}"))
      for n in (0, 1, 2)),
    Policy("jump, one speed, oracle", PAPER, oracle=True),
)  # fmt: skip


def _quick(speed_mps: float, ramp_mps2: float) -> tuple[str, ...]:
    return (
        f"controller.lift_speed_mps={speed_mps}", f"controller.lift_acceleration_mps2={ramp_mps2}",
        f"arm.max_speed_mps={max(0.25, speed_mps)}", f"arm.max_acceleration_mps2={ramp_mps2}",
    )  # fmt: skip


BASE = Scene("as configured", "base", 0.0)
SCENES = (
    BASE,
    *(Scene(f"pull of {n:g} N", "pull, N", n, (f"pull.force_n={n}", "pull.above_m=0.1"))
      for n in (2.0, 4.0, 6.0, 8.0)),
    *(Scene(f"friction -{share:.0%} from 10 cm on", "friction lost in the air, %", 100 * share,
            wet=1.0 - share) for share in (0.3, 0.5)),
    Scene("0.25 m/s, 3 m/s2", "speed, m/s", 0.25, _quick(0.25, 3.0)),
    Scene("0.4 m/s, 4 m/s2", "speed, m/s", 0.4, _quick(0.4, 4.0)),
    Scene("friction x.7, mass x1.5, 0.25 m/s, 3 m/s2", "heavy, slippery, quick", 1.0,
          _quick(0.25, 3.0), friction=0.7, mass=1.5),
    *(Scene(f"{n:g} false alarms a minute", "false alarms a minute", n, alarms=n)
      for n in (1.0, 4.0, 12.0)),
)  # fmt: skip


class Answered(msgspec.Struct, frozen=True, kw_only=True):
    """One lift. Forces at the thumb, N, at its end in the air and, at most, at any time."""

    policy: str
    scene: str
    object: str
    seed: int
    held: bool
    feasible: bool  # sliding friction carries the weight, lifted so, at 0.95 of the limit
    ended: str  # phase
    slip_mm: float | None  # in all; None: lost
    air_slip_mm: float | None  # of that, since the arm came to the top
    force_n: float
    least_n: float
    peak_n: float
    closings: int
    alarms: int  # false ones, from the beginning of the lift to its end
    paused_s: float  # the arm, in the lift
    seconds: float  # from the beginning of the lift to its end


class Task(msgspec.Struct, frozen=True):
    """One lift to be made."""

    config: LiftConfig
    policy: Policy
    scene: Scene
    seed: int


def configured(
    name: str, scene: Scene, policy: Policy, detector: str | None, rig: str = "simulated",
    files: Files = None, assignments: Sequence[str] = (),
) -> LiftConfig:  # fmt: skip
    """Settings of an object in a scene under an answer, held in the air at the end; ``files`` and
    ``assignments``: what the user sets beneath."""
    plain = load_config(name, rig, detector, files, (*assignments, *policy.words)).object
    scaled = (
        f"object.friction_static={plain.friction_static * scene.friction}",
        f"object.friction_kinetic={plain.friction_kinetic * scene.friction}",
        f"object.mass_kg={plain.mass_kg * scene.mass}",
        f"object.added_mass_kg={plain.added_mass_kg * scene.mass}",
    )
    words = (*assignments, *scaled, *scene.words, *policy.words, "controller.keep=true")
    return load_config(name, rig, detector, files, words).for_lift()


class Oracle:
    """Hears slip where there is some, of the cell that it is told."""

    def __init__(self, rig: GraspRig) -> None:
        self._rig = rig

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        truth = self._rig.truth()
        slips = truth is not None and abs(truth.slip_speed_mps) > GROSS_SLIP_MPS
        return np.full(FINGERS, float(slips))


class FalseAlarms:
    """What a detector says, and at times drawn by the seed, for 0.1 s each, that slip is certain
    at every finger. Without a rate there are none."""

    def __init__(self, of: SlipDetector | Oracle, clock: Clock, a_minute: float, seed: int) -> None:
        self._of, self._clock = of, clock
        draw = np.random.default_rng(seed)
        gaps_s = draw.exponential(60.0, DRAWN) / a_minute if a_minute else np.empty(0)
        self._begun_ns = clock.now_ns + np.cumsum(gaps_s * 1e9)

    def reset(self) -> None:
        self._of.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        said, now_ns = self._of.update(counts), self._clock.now_ns
        if self.between(now_ns - ALARM_NS, now_ns):
            return np.ones(FINGERS)
        return said

    def between(self, from_ns: int, to_ns: int) -> int:
        """How many have begun after the one time and up to the other."""
        return int(np.count_nonzero((self._begun_ns > from_ns) & (self._begun_ns <= to_ns)))


class _Seen:
    """What is kept of a lift, tick by tick."""

    def __init__(self, scene: Scene, rig: GraspRig) -> None:
        self._scene, self._rig = scene, rig
        self.end: Truth | None = None
        self.top_slip_m: float | None = None
        self.begun_ns = self.ended_ns = 0
        self._rising = False
        self._wet = scene.wet == 1.0

    def take(self, tick: Tick) -> None:
        phase, truth = tick.decision.phase, self._rig.truth()
        if truth is None:
            return
        if phase is Phase.LIFT and not self.begun_ns:
            self.begun_ns = tick.t_ns
        if phase in (Phase.LIFT, Phase.COMPENSATE, Phase.HOLD, Phase.KEPT):
            self.end, self.ended_ns = truth, tick.t_ns
        if phase is Phase.HOLD and self.top_slip_m is None:
            self.top_slip_m = truth.slip_distance_m
        if not self._wet and truth.height_m >= WET_M and self._rig.cell is not None:
            self._rig.cell.contact.wet(self._scene.wet)
            self._wet = True


def lift(task: Task) -> Answered:
    """One lift; raises what opening a rig raises."""
    config, scene = task.config, task.scene
    with open_rig(config.built_for(task.seed), task.seed, paced=config.rig != "simulated") as rig:
        seen = _Seen(scene, rig)
        heard = Oracle(rig) if task.policy.oracle else config.make_detector(FINGERS)
        detector = FalseAlarms(heard, rig.clock, scene.alarms, task.seed)
        controller = make_controller(config)
        step = GraspStep(detector, controller, make_guard(config))
        loop = ControlLoop(rig.devices, rig.clock, step, config.loop, seen.take)
        loop.run(config.loop.deadline_s)
    end = seen.end
    held = controller.phase is Phase.KEPT and end is not None and _stands_in_the_air(end)
    body = cell_settings(config, task.seed)[0].body
    least_n = body.total_kg * GRAVITY_MPS2 / (2.0 * body.friction_kinetic * scene.wet)
    rise = 1.0 + config.controller.lift_acceleration_mps2 / GRAVITY_MPS2
    top_m = seen.top_slip_m
    return Answered(
        policy=task.policy.name, scene=scene.name, object=config.object.name, seed=task.seed,
        held=held, feasible=least_n * rise <= FEASIBLE * config.guard.force_limit_n,
        ended=controller.phase.value,
        slip_mm=end.slip_distance_m * 1e3 if held and end else None,
        air_slip_mm=(end.slip_distance_m - top_m) * 1e3 if held and end and top_m is not None
        else None,
        force_n=end.normal_n[0] if end else 0.0, least_n=least_n,
        peak_n=max(end.peak_n) if end else 0.0, closings=controller.closings,
        alarms=detector.between(seen.begun_ns, seen.ended_ns),
        paused_s=controller.pause.stood_s,
        seconds=(seen.ended_ns - seen.begun_ns) * 1e-9,
    )  # fmt: skip


def _stands_in_the_air(end: Truth) -> bool:
    still = abs(end.slip_speed_mps) < GROSS_SLIP_MPS
    return end.touched and still and end.height_m >= AIR_M


def lifts(
    names: Sequence[str], seeds: Sequence[int], policies: Sequence[Policy],
    scenes: Sequence[Scene], detector: str | None, workers: Workers, rig: str = "simulated",
    files: Files = None, assignments: Sequence[str] = (),
) -> Iterator[Answered]:  # fmt: skip
    """All of them as they finish."""
    tasks = [
        Task(
            configured(name, scene, policy, detector, rig, files, assignments), policy, scene, seed
        )
        for scene in scenes
        for policy in policies
        for name in names
        for seed in seeds
    ]
    yield from results(lift, tasks, workers)
