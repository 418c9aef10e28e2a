"""Comparison of slip responses: lifts under every policy, in easy and in harder scenes.

A lift ends in the air. The object counts as held if it is off the table, in contact and at rest,
and the run did not end early. The least force at the thumb is m g / 2 mu of the trial: sliding
friction then carries the weight.
"""

import argparse
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import SlipDetector
from detector.scores.quantiles import Quantiles, quantiles
from drivers.errors import UsageError
from drivers.interfaces import FINGERS
from grasp.cli.parser import Parser
from grasp.control.states import State
from grasp.control.step import GraspStep
from grasp.run.clock import Clock
from grasp.run.loop import ControlLoop, Tick
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.rigs.simulated import cell_settings
from scenarios.trial.execution import make_controller, make_guard
from scenarios.world.contact import GRAVITY_MPS2
from scenarios.world.settings import GROSS_SLIP_MPS
from scenarios.world.truth import Truth
from studies.runner import Study, add_trials, markdown, seeds_of

AIR_M = 0.005  # off the table
FEASIBLE = 0.95  # of the force limit; no response holds an object that needs more
ALARM_NS = 100_000_000  # duration of a false alarm
WET_M = 0.1  # lower end of the object's wet patch


class Policy(msgspec.Struct, frozen=True):
    """A slip response. ``oracle``: an ideal detector reports slip at its onset."""

    name: str
    settings: tuple[str, ...]
    oracle: bool = False


class Scene(msgspec.Struct, frozen=True):
    """Difficulty of a lift. Friction and mass are factors; ``wet``: share of friction left above
    10 cm; ``alarms``: added false alarms per minute."""

    name: str
    settings: tuple[str, ...] = ()
    friction: float = 1.0
    mass: float = 1.0
    wet: float = 1.0
    alarms: float = 0.0


PAPER = ("controller.slip_response=close", "controller.closing=constant")
POLICIES = (
    Policy("close, one speed", PAPER),
    Policy("close", ("controller.slip_response=close",)),
    Policy("stop_and_close", ("controller.slip_response=stop_and_close",)),
    *(Policy(f"stop_and_step, margin {n}",
             ("controller.slip_response=stop_and_step", f"controller.margin_steps={n}"))
      for n in (0, 1, 2)),
    Policy("close, one speed, oracle", PAPER, oracle=True),
)  # fmt: skip


def _faster(speed_mps: float, ramp_mps2: float) -> tuple[str, ...]:
    return (
        f"controller.lift_speed_mps={speed_mps}", f"controller.lift_acceleration_mps2={ramp_mps2}",
        f"arm.max_speed_mps={max(0.25, speed_mps)}", f"arm.max_acceleration_mps2={ramp_mps2}",
    )  # fmt: skip


BASE = Scene("as configured")
HARD = (
    *(Scene(f"pull of {n:g} N", (f"pull.force_n={n}", "pull.above_m=0.1")) for n in (2, 4, 6, 8)),
    *(Scene(f"friction -{share:.0%} from 10 cm on", wet=1.0 - share) for share in (0.3, 0.5)),
    Scene("0.25 m/s, 3 m/s2", _faster(0.25, 3.0)),
    Scene("0.4 m/s, 4 m/s2", _faster(0.4, 4.0)),
    Scene("friction x.7, mass x1.5, 0.25 m/s, 3 m/s2", _faster(0.25, 3.0), friction=0.7, mass=1.5),
)  # fmt: skip
ALARMS = tuple(Scene(f"{n} false alarms a minute", alarms=n) for n in (1, 4, 12))
SCENES = {"easy": (BASE,), "hard": HARD, "alarms": (BASE, *ALARMS), "all": (BASE, *HARD, *ALARMS)}


class Task(msgspec.Struct, frozen=True):
    """A lift under one policy in one scene."""

    config: LiftConfig
    policy: Policy
    scene: Scene
    seed: int


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Result of one lift. Forces at the thumb, N."""

    policy: str
    scene: Scene
    object: str
    seed: int
    held: bool
    feasible: bool  # sliding friction carries the accelerated weight at 0.95 of the force limit
    slip_mm: float | None  # None: not held
    air_slip_mm: float | None  # of that, after the arm had reached the top
    force_n: float  # at the end
    least_n: float
    peak_n: float
    alarms: int  # false alarms during the lift
    paused_s: float  # the arm stood
    seconds: float  # from the start of the lift to its end


def options(parser: Parser) -> None:
    add_trials(parser, seeds=20)
    parser.add_argument("--scenes", choices=SCENES, default="all")
    parser.add_argument("--policies", nargs="+", metavar="NAME", help="quoted (default: all)")


def grid(args: argparse.Namespace) -> list[Task]:
    known = {policy.name: policy for policy in POLICIES}
    chosen = args.policies or known
    if unknown := set(chosen) - known.keys():
        raise UsageError(f"no policy {min(unknown)!r}", f"one of: {', '.join(map(repr, known))}")
    return [
        Task(configured(name, scene, known[policy], args), known[policy], scene, seed)
        for scene in SCENES[args.scenes]
        for policy in chosen
        for name in args.objects
        for seed in seeds_of(args)
    ]


def configured(name: str, scene: Scene, policy: Policy, args: argparse.Namespace) -> LiftConfig:
    """Settings of an object in a scene under a policy; they override the user's."""
    base = name, "simulated", args.detector, args.config
    body = load_config(*base, (*args.set, *policy.settings)).object
    scaled = (
        f"object.friction_static={body.friction_static * scene.friction}",
        f"object.friction_kinetic={body.friction_kinetic * scene.friction}",
        f"object.mass_kg={body.mass_kg * scene.mass}",
        f"object.added_mass_kg={body.added_mass_kg * scene.mass}",
    )
    settings = (*args.set, *scaled, *scene.settings, *policy.settings, "controller.keep=true")
    return load_config(*base, settings).for_lift()


class Oracle:
    """Detects slip exactly when the simulated object slips."""

    def __init__(self, rig: GraspRig) -> None:
        self._rig = rig

    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        truth = self._rig.truth()
        slips = truth is not None and abs(truth.slip_speed_mps) > GROSS_SLIP_MPS
        return np.full(FINGERS, float(slips))


class FalseAlarms:
    """A detector whose probabilities are all 1 for 0.1 s at random times."""

    name, threshold, memory = "false alarms", 0.5, 0

    def __init__(self, of: SlipDetector | Oracle, clock: Clock, a_minute: float, seed: int) -> None:
        self._of, self._clock = of, clock
        gaps_s = np.random.default_rng(seed).exponential(60.0, 1000) / (a_minute or 1e-9)
        self._starts_ns = clock.now_ns + np.cumsum(gaps_s * 1e9)

    def reset(self) -> None:
        self._of.reset()

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        probabilities, now_ns = self._of.update(counts), self._clock.now_ns
        return np.ones(FINGERS) if self.between(now_ns - ALARM_NS, now_ns) else probabilities

    def between(self, from_ns: int, to_ns: int) -> int:
        return int(((self._starts_ns > from_ns) & (self._starts_ns <= to_ns)).sum())


class Observer:
    """Records the quantities of the result, and reduces friction if the scene has a wet patch."""

    def __init__(self, scene: Scene, rig: GraspRig) -> None:
        self._rig, self._wet = rig, scene.wet
        self.end: Truth | None = None
        self.top_slip_m: float | None = None
        self.start_ns = self.end_ns = 0

    def take(self, tick: Tick) -> None:
        phase, truth = tick.decision.state, self._rig.truth()
        if truth is None:
            return
        if phase is State.LIFT and not self.start_ns:
            self.start_ns = tick.t_ns
        if phase in (State.LIFT, State.COMPENSATE, State.HOLD, State.KEPT):
            self.end, self.end_ns = truth, tick.t_ns
        if phase is State.HOLD and self.top_slip_m is None:
            self.top_slip_m = truth.slip_distance_m
        if self._wet < 1.0 and truth.height_m >= WET_M and self._rig.cell is not None:
            self._rig.cell.contact.wet(self._wet)
            self._wet = 1.0


def trial(task: Task) -> Row:
    config, scene = task.config, task.scene
    with open_rig(config.built_for(task.seed), task.seed, paced=False) as rig:
        observer = Observer(scene, rig)
        plain = Oracle(rig) if task.policy.oracle else config.make_detector(FINGERS)
        detector = FalseAlarms(plain, rig.clock, scene.alarms, task.seed)
        controller = make_controller(config)
        step = GraspStep(detector, controller, make_guard(config))
        loop = ControlLoop(rig.devices, rig.clock, step, config.loop, observer.take)
        loop.run(config.loop.deadline_s)
    end, top_m = observer.end, observer.top_slip_m
    body = cell_settings(config, task.seed)[0].body
    least_n = body.total_kg * GRAVITY_MPS2 / (2.0 * body.friction_kinetic * scene.wet)
    rise = 1.0 + config.controller.lift_acceleration_mps2 / GRAVITY_MPS2
    held = (
        controller.state is State.KEPT and end is not None and end.touched
        and end.height_m >= AIR_M and abs(end.slip_speed_mps) < GROSS_SLIP_MPS
    )  # fmt: skip
    slip_mm = end.slip_distance_m * 1e3 if held and end else None
    return Row(
        policy=task.policy.name, scene=scene, object=config.object.name, seed=task.seed, held=held,
        least_n=least_n, feasible=least_n * rise <= FEASIBLE * config.guard.force_limit_n,
        slip_mm=slip_mm,
        air_slip_mm=None if slip_mm is None or top_m is None else slip_mm - top_m * 1e3,
        force_n=end.normal_n[0] if end else 0.0, peak_n=max(end.peak_n) if end else 0.0,
        alarms=detector.between(observer.start_ns, observer.end_ns),
        paused_s=controller.response.paused_s, seconds=(observer.end_ns - observer.start_ns) * 1e-9,
    )  # fmt: skip


def _cells(rows: Sequence[Row]) -> dict[tuple[Scene, str], list[Row]]:
    cells: dict[tuple[Scene, str], list[Row]] = {}
    for row in rows:
        cells.setdefault((row.scene, row.policy), []).append(row)
    return cells


def _three(q: Quantiles | None, digits: int) -> str:
    return "-" if q is None else " / ".join(f"{v:z.{digits}f}" for v in (q.p50, q.p90, q.p99))


def _force_over_least(cell: Sequence[Row]) -> Quantiles | None:
    return quantiles(row.force_n / row.least_n for row in cell if row.held)


def table(rows: Sequence[Row]) -> str:
    cells = _cells(rows)
    names: dict[str, list[object]] = {"scene": [scene.name for scene, _ in cells],
                                      "response": [policy for _, policy in cells]}  # fmt: skip
    groups = list(cells.values())

    def mean(name: str) -> list[object]:
        return [sum(getattr(row, name) for row in g) / len(g) for g in groups]

    feasible = [[row.held for row in g if row.feasible] for g in groups]
    first = names | {
        "held": [f"{sum(row.held for row in g)} of {len(g)}" for g in groups],
        "of feasible": [f"{sum(f)} of {len(f)}" for f in feasible],
        "lift and hold, s": mean("seconds"), "arm stands, s": mean("paused_s"),
        "false alarms": mean("alarms"),
    }  # fmt: skip
    second = names | {
        "slip, mm, p50 / p90 / p99": [_three(quantiles(r.slip_mm for r in g), 1) for g in groups],
        "slip in the air": [_three(quantiles(r.air_slip_mm for r in g), 1) for g in groups],
        "force over least": [_three(_force_over_least(g), 2) for g in groups],
        "highest force, N": [max(r.peak_n for r in g) for g in groups],
    }
    return f"{markdown(first)}\n\n{markdown(second)}"


STUDY = Study("slip, force and success by the response to slip, also in harder lifts",
              grid, trial, Row, table, options=options)  # fmt: skip
