"""`grasp world check`: closed loops at the level that the planner chooses, beside the brush (L4).

Every draw is an object, a hand and a lift or a tap of its own, wider than any campaign's: mass,
friction, pads, spacing of the fingers, where the weight lies, where and how hard a blow lands. The
whole loop runs three times on it: as planned, always at L4, always at L1. What L4 says is the
reference; equal seeds give equal noise to all three. Where slip is heard by a hair, less than a
micrometre decides whether it is: a control runs L4 once more, with shorter steps.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Literal

import msgspec
import numpy as np

from detector.scores.quantiles import quantile
from drivers.errors import ConfigError
from scenarios.campaign.config import RunConfig, load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.lift.result import LiftResult
from scenarios.rigs.workers import Workers, results
from scenarios.tap import tap
from scenarios.tap.config import TapConfig
from scenarios.tap.result import TapResult
from scenarios.world.world_settings import WorldSettings

Kind = Literal["lift", "top", "off-centre", "side"]
KINDS: tuple[Kind, ...] = ("lift", "top", "off-centre", "side")
OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
ALWAYS = ("L1", "L4")
PLANNED = "planned"
REFERENCE = "L4"
CONTROL, CONTROL_STEPS = "L4, shorter steps", 0.8  # of those of the reference
LOST = ("dropped", "expelled", "knocked_out", "fault")  # how far it went compares nothing


class Loop(msgspec.Struct, frozen=True):
    """One closed loop; slip, of a tap the displacement, and rotation are None if not judged."""

    outcome: str
    moved: bool | None
    slip_m: float | None
    turned_rad: float | None
    peak_n: float | None
    cpu_s: float

    @property
    def verdict(self) -> tuple[str, bool | None]:
        """What must not differ."""
        return self.outcome, self.moved


class Draw(msgspec.Struct, frozen=True):
    """One draw at all levels."""

    kind: Kind
    object: str
    seed: int
    tolerance_m: float
    tolerance_rad: float
    level: str
    blow_level: str
    plan_s: float
    loops: dict[str, Loop]
    tolerance_n: float = WorldSettings().force_tolerance_n  # on the peak force

    def differs(self, name: str) -> bool:
        """Whether its verdict is another than the reference's."""
        return self.loops[name].verdict != self.loops[REFERENCE].verdict

    def slip_error_m(self, name: str) -> float | None:
        """None where either was not judged."""
        return _apart(self.loops[name].slip_m, self.loops[REFERENCE].slip_m)

    def turn_error_rad(self, name: str) -> float | None:
        return _apart(self.loops[name].turned_rad, self.loops[REFERENCE].turned_rad)

    def peak_error_n(self, name: str) -> float | None:
        """Of the largest force of any finger; None where the slip was not judged."""
        if self.slip_error_m(name) is None:
            return None
        return _apart(self.loops[name].peak_n, self.loops[REFERENCE].peak_n)


class _Task(msgspec.Struct, frozen=True):
    """One draw to be made."""

    seed: int
    objects: tuple[str, ...]
    detector: str
    tolerance: float | None
    control: bool
    keep: bool


def _apart(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else abs(a - b)


def drawn(config: RunConfig, kind: Kind, rng: np.random.Generator) -> LiftConfig | TapConfig:
    """Settings of one draw, around those of an object."""
    body, pads, replace = config.object, config.contact, msgspec.structs.replace
    static = body.friction_static * rng.uniform(0.8, 1.25)
    mass = rng.uniform(0.75, 1.3)
    config = replace(
        config,
        object=replace(
            body,
            mass_kg=body.mass_kg * mass,
            added_mass_kg=body.added_mass_kg * mass,
            friction_static=static,
            friction_kinetic=static * rng.uniform(0.7, 0.95),
            radius_of_gyration_m=rng.uniform(0.04, 0.12),
            centre_aside_m=rng.uniform(-0.01, 0.01),
            centre_above_m=rng.uniform(-0.02, 0.03),
        ),
        contact=replace(
            pads,
            shear_stiffness_npm=rng.uniform(6e3, 12e3),
            shear_damping_nspm=rng.uniform(5.0, 16.0),
            finger_spacing_m=rng.uniform(0.04, 0.075),
            pad_half_length_m=rng.uniform(0.008, 0.012),
        ),
    )
    if kind == "lift":
        return config.for_lift()
    side = 1.0 if rng.random() < 0.5 else -1.0
    beside = side * rng.uniform(0.005, 0.03) if kind == "off-centre" else 0.0
    blow = replace(
        config.tap,
        direction="side" if kind == "side" else "top",
        aim_m=rng.uniform(0.002, 0.012),
        top_offset_m=beside,
        side_offset_m=rng.uniform(0.0, 0.06),
        duration_s=rng.uniform(0.004, 0.016),
    )
    return replace(config, tap=blow).for_tap()


def one(task: _Task) -> Draw | None:
    """A draw at all levels; None where no blow moves its object and leaves it in the hand."""
    rng = np.random.default_rng(task.seed)
    kind, name = KINDS[task.seed % len(KINDS)], str(rng.choice(task.objects))
    assignments = [] if task.tolerance is None else [f"world.tolerance={task.tolerance}"]
    assignments += ["controller.keep=true"] if task.keep else []
    base = load_config(name, "simulated", task.detector, None, assignments)
    config = drawn(base, kind, rng)
    start = time.thread_time()
    try:
        as_run = tap.tap_config(config) if isinstance(config, TapConfig) else config
        plan = as_run.physics(task.seed)
    except ConfigError:
        return None
    plan_s = time.thread_time() - start
    assert plan is not None  # noqa: S101  (there is a world)
    loops = {level: _loop(config, task.seed, level) for level in ALWAYS}
    alike = plan.level if plan.level == plan.blow_level else None
    loops[PLANNED] = loops[alike] if alike in loops else _loop(config, task.seed, "auto")
    if task.control:
        loops[CONTROL] = _loop(with_shorter_steps(config), task.seed, REFERENCE)
    return Draw(
        kind, base.object.name, task.seed, plan.tolerance_m, plan.tolerance_rad, plan.level,
        plan.blow_level, plan_s, loops, plan.tolerance_n,
    )  # fmt: skip


def with_shorter_steps(config: LiftConfig | TapConfig) -> LiftConfig | TapConfig:
    """What a control runs: as true as the reference, and not the same to the last digit."""
    pads = config.contact
    shorter = msgspec.structs.replace(
        pads, step_s=CONTROL_STEPS * pads.step_s, blow_step_s=CONTROL_STEPS * pads.blow_step_s
    )
    return msgspec.structs.replace(config, contact=shorter)


def _loop(config: LiftConfig | TapConfig, seed: int, level: str) -> Loop:
    world: WorldSettings = msgspec.convert(
        {**msgspec.to_builtins(config.world), "level": level}, WorldSettings
    )
    told = msgspec.structs.replace(config, world=world)
    start = time.thread_time()
    if isinstance(told, TapConfig):
        result: TapResult | LiftResult | None = tap.run(told, seed, None).result
    else:
        result = lift.run(told, seed, None).result
    cpu_s = time.thread_time() - start
    assert result is not None  # noqa: S101  (nothing here ends without a verdict)
    slip_m = result.displacement_m if isinstance(result, TapResult) else result.slip_distance_m
    lost = result.outcome in LOST
    return Loop(
        outcome=result.outcome,
        moved=result.moved if isinstance(result, TapResult) else None,
        slip_m=None if lost else slip_m,
        turned_rad=None if lost else result.turned_rad,
        peak_n=max(result.peak_force_n.values()) if result.peak_force_n else None,
        cpu_s=cpu_s,
    )


def check(
    seeds: Sequence[int], objects: Sequence[str], detector: str, tolerance: float | None,
    control: bool, keep: bool, workers: Workers,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[Draw]:  # fmt: skip
    """All draws as they finish; with `keep` each ends in the air, where it is judged."""
    tasks = [_Task(seed, tuple(objects), detector, tolerance, control, keep) for seed in seeds]
    for done, found in enumerate(results(one, tasks, workers), 1):
        progress(done, len(tasks))
        if found is not None:
            yield found


def table(draws: Sequence[Draw]) -> str:
    """Of each kind and of all, in Markdown: verdicts that differ from L4's, errors, cost."""
    rows = [
        "| draws | n | levels chosen | verdict differs: planned | always L1 | control "
        "| slip off by more than the tolerance: planned | always L1 | median, worst of 95 %, mm "
        "| rotation off by more: planned | always L1 | median, worst of 95 %, deg "
        "| peak force off by more: planned | always L1 | median, worst of 95 %, N "
        "| time over always L4 | over always L1 | ms to plan |",
        "|---" * 18 + "|",
    ]
    for kind in (*KINDS, "all"):
        of = [d for d in draws if kind in (d.kind, "all")]
        if of:
            rows.append(_row(kind, of))
    return "\n".join(rows)


def _row(kind: str, draws: Sequence[Draw]) -> str:
    levels = Counter(
        d.level if d.kind == "lift" or d.level == d.blow_level else f"{d.level}, {d.blow_level}"
        for d in draws
    )
    chosen = "; ".join(f"{name}: {n}" for name, n in sorted(levels.items()))
    verdicts = [sum(d.differs(name) for d in draws) for name in (PLANNED, "L1")]
    again = [d.differs(CONTROL) for d in draws if CONTROL in d.loops]
    control = f"{sum(again)} of {len(again)}" if again else "-"
    slip = [_over(draws, name, Draw.slip_error_m, "tolerance_m") for name in (PLANNED, "L1")]
    turn = [_over(draws, name, Draw.turn_error_rad, "tolerance_rad") for name in (PLANNED, "L1")]
    peak = [_over(draws, name, Draw.peak_error_n, "tolerance_n") for name in (PLANNED, "L1")]
    slip_mm = _spread([d.slip_error_m(PLANNED) for d in draws], 1e3)
    turn_deg = _spread([d.turn_error_rad(PLANNED) for d in draws], 180 / np.pi)
    peak_n = _spread([d.peak_error_n(PLANNED) for d in draws], 1.0)
    plan_ms = 1e3 * float(np.median([d.plan_s for d in draws]))
    cells = [
        kind, len(draws), chosen, *verdicts, control, *slip, slip_mm, *turn, turn_deg,
        *peak, peak_n, _cost(draws, "L4"), _cost(draws, "L1"), f"{plan_ms:.0f}",
    ]  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def _cost(draws: Sequence[Draw], name: str) -> str:
    """Median ratio of processor times; the first run of a process also loads what is compiled."""
    ratios = [d.loops[PLANNED].cpu_s / d.loops[name].cpu_s for d in draws]
    return f"{np.median(ratios):.2f}"


def _over(
    draws: Sequence[Draw], name: str, error: Callable[[Draw, str], float | None], tolerance: str
) -> str:
    """How many were off by more than was asked, of those that both judged."""
    judged = [(e, d) for d in draws if (e := error(d, name)) is not None]
    return f"{sum(e > getattr(d, tolerance) for e, d in judged)} of {len(judged)}"


def _spread(errors: Sequence[float | None], scale: float) -> str:
    known = sorted(scale * e for e in errors if e is not None)
    if not known:
        return "-"
    return f"{quantile(known, 0.5):.2f}, {quantile(known, 0.95):.2f}"
