"""Operating envelope of the lift: success over eight difficulty axes, each varied alone, with a
first grasp at given counts, as in the paper, and by touch.

The bound of an axis is the load that sliding friction carries at the force limit F. The thumb at F
and the two opposing fingers at F together carry 2 mu F, so m (g + a) + pull <= 2 mu F. The bound
ignores time. The success rate is the isotonic regression of the trials, linear between values. The
interval of a crossing of a level contains every gap that the likelihood ratio allows (Banerjee and
Wellner 2001, with the wider bound of the chi-square distribution). Lifts that never slip do not
test the response and are counted separately.
"""

import argparse
import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from grasp.cli.parser import Parser
from scenarios.campaign.config import RunConfig, load_config
from scenarios.campaign.summary import wilson
from scenarios.lift.config import LiftConfig
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftOutcome
from scenarios.trial.config import DEFAULT_PROFILE
from scenarios.world import contact, laws
from studies.runner import Study, add_trials, markdown, seeds_of

GRASPS = ("counts", "touch")
LABELS = {"counts": "at given counts", "touch": "by touch"}
LOOKS = {"counts": {"fmt": "o-", "color": "#1f6fb4"}, "touch": {"fmt": "s--", "color": "#d1602a"}}
RATIO = 3.84  # twice the logarithm of the likelihood ratio; 95 %
Floats = NDArray[np.float64]


class Axis(NamedTuple):
    """A quantity that makes a lift harder."""

    title: str
    values: tuple[float, ...]  # easiest first
    here: Callable[[RunConfig], float]  # value in a configuration
    moved: Callable[[RunConfig, float], list[str]]  # settings for a value
    bound: Callable[[RunConfig], float]
    sign: int = 1  # -1: lower is harder

    def share(self, config: RunConfig, value: float) -> float:
        """Share of the bound: 1 at the bound, less where the lift is easier."""
        return (value / self.bound(config)) ** self.sign


def _mass_kg(c: RunConfig) -> float:
    return c.object.mass_kg + c.object.added_mass_kg


def _holds_n(c: RunConfig) -> float:
    return 2 * c.object.friction_kinetic * c.guard.force_limit_n


def _friction(c: RunConfig, kinetic: float) -> list[str]:
    static = kinetic * c.object.friction_static / c.object.friction_kinetic
    return [f"object.friction_kinetic={kinetic:g}", f"object.friction_static={static:g}"]


def _mass(c: RunConfig, mass_kg: float) -> list[str]:
    object_kg = min(c.object.mass_kg, mass_kg)
    return [f"object.mass_kg={object_kg:g}", f"object.added_mass_kg={mass_kg - object_kg:g}"]


def _per_speed(c: RunConfig) -> float:
    return c.controller.lift_acceleration_mps2 / c.controller.lift_speed_mps


def faster(c: RunConfig, speed_mps: float) -> list[str]:
    ramp_mps2 = _per_speed(c) * speed_mps
    return [
        f"controller.lift_speed_mps={speed_mps:g}",
        f"controller.lift_acceleration_mps2={ramp_mps2:g}",
        f"arm.max_speed_mps={max(c.arm.max_speed_mps, speed_mps):g}",
        f"arm.max_acceleration_mps2={max(c.arm.max_acceleration_mps2, ramp_mps2):g}",
    ]


def _pull(c: RunConfig, force_n: float) -> list[str]:
    """Settings of a pull that starts at half height, since an arm that pauses for slip is low."""
    return [f"pull.force_n={force_n:g}", f"pull.above_m={c.controller.lift_height_m / 2:g}"]


def _width_mm(c: RunConfig, side: int, force_n: float) -> float:
    """Change of width per side, mm, from which the first grasp has at least (wider) or at most
    (narrower) this force at the thumb."""
    p = contact.parameters(c.contact, c.object)
    travel = c.hand.m_per_count * np.array(c.object.grip_counts, float)
    forces, low, high = np.zeros(contact.FINGERS), 0.0, 20.0
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        width_m = laws.width_and_slope(p, 0.0)[0] + 1e-3 * side * middle
        laws.normal_forces(p, width_m, travel, contact.initial_state(), forces)
        low, high = (low, middle) if side * (forces[0] - force_n) >= 0.0 else (middle, high)
    return high


G = contact.GRAVITY_MPS2
AXES = {
    "friction": Axis("kinetic friction", (0.5, 0.4, 0.35, 0.3, 0.25, 0.2),
                     lambda c: c.object.friction_kinetic, _friction,
                     lambda c: _mass_kg(c) * G / (2 * c.guard.force_limit_n), -1),
    "mass": Axis("mass, kg", (0.8, 1.0, 1.2, 1.4, 1.6),
                 _mass_kg, _mass, lambda c: _holds_n(c) / G),
    "speed": Axis("arm speed, acceleration with it, m/s", (0.15, 0.2, 0.3, 0.4, 0.5),
                  lambda c: c.controller.lift_speed_mps, faster,
                  lambda c: (_holds_n(c) / _mass_kg(c) - G) / _per_speed(c)),
    "pull": Axis("pull in the hold, N", (4.0, 6.0, 8.0, 10.0, 13.0),
                 lambda c: c.pull.force_n, _pull, lambda c: _holds_n(c) - _mass_kg(c) * G),
    "wider": Axis("wider, mm a side", (0.3, 0.6, 1.0, 1.5, 2.0, 8.0, 15.0),
                  lambda c: max(0.0, 1e3 * c.variation.width_error_m),
                  lambda c, x: [f"variation.width_error_m={1e-3 * x:g}"],
                  lambda c: _width_mm(c, 1, c.guard.force_limit_n)),
    "narrower": Axis("narrower, mm a side", (0.15, 0.3, 0.45, 0.6, 1.0, 8.0, 15.0),
                     lambda c: max(0.0, -1e3 * c.variation.width_error_m),
                     lambda c, x: [f"variation.width_error_m={-1e-3 * x:g}"],
                     lambda c: _width_mm(c, -1, 0.0)),
    "taxels": Axis("share of taxels lost", (0.17, 0.34, 0.5, 0.67, 0.84),
                   lambda c: c.damage.taxels_lost,
                   lambda c, x: [f"damage.taxels_lost={x:g}"], lambda c: 1.0),
    "gain": Axis("share of gain lost", (0.3, 0.5, 0.7, 0.8, 0.9, 0.95),
                 lambda c: c.damage.gain_lost,
                 lambda c, x: [f"damage.gain_lost={x:g}"], lambda c: 1.0),
}  # fmt: skip


class Task(msgspec.Struct, frozen=True):
    """A lift. ``at``: its value and share of the bound on each axis."""

    config: LiftConfig
    seed: int
    grasp: str
    at: dict[str, tuple[float, float]]
    moved: str  # axis; empty: unchanged


class Row(msgspec.Struct, frozen=True):
    """Result of one lift."""

    grasp: str  # the first one: by touch, or at given counts
    at: dict[str, tuple[float, float]]
    moved: str
    outcome: str
    held: bool


def options(parser: Parser) -> None:
    add_trials(parser, seeds=10)
    parser.add_argument("--profile", default=DEFAULT_PROFILE, metavar="NAME")
    parser.add_argument("--axes", nargs="+", choices=AXES, default=tuple(AXES))


def grid(args: argparse.Namespace) -> list[Task]:
    tasks = []
    for grasp, name in itertools.product(GRASPS, args.objects):
        chosen, base_settings = (
            (name, "simulated", args.detector, args.config),
            (*args.set, "controller.keep=true", f"controller.first_grasp={grasp}"),
        )
        base = load_config(*chosen, base_settings, args.profile)
        points = [("", list[str](), {a: AXES[a].here(base) for a in args.axes})]
        points += [(a, AXES[a].moved(base, x), {a: x}) for a in args.axes for x in AXES[a].values]
        for moved, words, values in points:
            config = load_config(*chosen, (*base_settings, *words), args.profile).for_lift()
            at = {a: (x, AXES[a].share(base, x)) for a, x in values.items()}
            tasks += [Task(config, seed, grasp, at, moved) for seed in seeds_of(args)]
    return tasks


def trial(task: Task) -> Row:
    result = lift.run(task.config, task.seed, None).result
    if result is None:
        raise RuntimeError(f"{task.config.object.name}, seed {task.seed}: no result")
    return Row(task.grasp, task.at, task.moved, result.outcome, bool(result.success))


Fall = tuple[float | None, float | None, float | None]  # value, interval; None: beyond the values


def fall(hard: Sequence[float], held: Sequence[bool], level: float) -> Fall:
    """Levels of success over the difficulty of the trials, from held or not."""
    x, which = np.unique(np.asarray(hard, float), return_inverse=True)
    won, n = np.zeros(len(x)), np.zeros(len(x))
    np.add.at(won, which, np.asarray(held, float))
    np.add.at(n, which, 1.0)
    best = _log_likelihood(falling(won, n), won, n)
    may = [i for i in range(len(x) + 1)
           if 2 * (best - _log_likelihood(_split(won, n, i, level), won, n)) <= RATIO]  # fmt: skip
    low = float(x[max(0, may[0] - 1)]) if may[0] < len(x) else None
    high = float(x[may[-1]]) if may[-1] < len(x) else None
    return _crossing(x, falling(won, n), level), low, high


def falling(won: Floats, n: Floats) -> Floats:
    """Non-increasing rates (values,) nearest to won / n, weighted by the trials."""
    blocks: list[tuple[float, float, int]] = []  # won, trials, values
    for each in zip(won.tolist(), n.tolist(), [1] * len(n), strict=True):
        blocks.append(each)
        while len(blocks) > 1 and blocks[-1][0] / blocks[-1][1] > blocks[-2][0] / blocks[-2][1]:
            (w1, n1, k1), (w0, n0, k0) = blocks.pop(), blocks.pop()
            blocks.append((w0 + w1, n0 + n1, k0 + k1))
    return np.repeat([w / n for w, n, _ in blocks], np.array([k for *_, k in blocks], int))


def _crossing(x: Floats, rate: Floats, level: float) -> float | None:
    below = np.flatnonzero(rate < level)
    if len(below) == 0:
        return None
    i = int(below[0])
    return float(x[0] if i == 0 else np.interp(-level, -rate[i - 1 : i + 1], x[i - 1 : i + 1]))


def _split(won: Floats, n: Floats, i: int, level: float) -> Floats:
    """Best rates of at least the level at the first i values and at most the level after."""
    easy = np.maximum(falling(won[:i], n[:i]), level)
    return np.concatenate([easy, np.minimum(falling(won[i:], n[i:]), level)])


def _log_likelihood(rate: Floats, won: Floats, n: Floats) -> float:
    p = np.clip(rate, 1e-300, 1.0 - 1e-16)
    return float((won * np.log(p) + (n - won) * np.log1p(-p)).sum())


Line = dict[float | None, list[Row]]  # by value, easiest first; None: unchanged, objects differ


def _lines(rows: Sequence[Row]) -> list[tuple[str, str, Line]]:
    """Grasp, axis and line, by axis."""
    lines = []
    pairs = dict.fromkeys((axis, row.grasp) for row in rows for axis in row.at)
    for axis, grasp in sorted(pairs, key=lambda pair: [*AXES].index(pair[0])):
        of_axis = [row for row in rows if axis in row.at and row.grasp == grasp]
        plain = [row for row in of_axis if not row.moved]
        here = {row.at[axis][0] for row in plain}
        line: Line = {here.pop() if len(here) == 1 else None: plain}
        lines.append((grasp, axis, line))
        for value in sorted(
            {row.at[axis][0] for row in of_axis if row.moved}, reverse=AXES[axis].sign < 0
        ):
            line[value] = [row for row in of_axis if row.moved and row.at[axis][0] == value]
    return lines


def _bound(axis: str, line: Line) -> tuple[float, float]:
    at = [row.at[axis] for group in line.values() for row in group if row.at[axis][1] > 0]
    bounds = [value / share ** AXES[axis].sign for value, share in at]
    return min(bounds), max(bounds)


def _tested(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.outcome != LiftOutcome.NEVER_SLIPPED]


def _text(found: Fall, sign: int) -> str:
    at, low, high = ("-" if v is None else f"{sign * v:.3g}" for v in found)
    return f"{at} ({low} to {high})"


def table(rows: Sequence[Row]) -> str:
    falls, rates = [], []
    for grasp, axis, line in _lines(rows):
        tested, sign = _tested([row for group in line.values() for row in group]), AXES[axis].sign
        held = [row.held for row in tested]
        values, shares = ([row.at[axis][i] for row in tested] for i in (0, 1))
        found = [(_text(fall([sign * v for v in values], held, level), sign),
                  _text(fall(shares, held, level), 1)) for level in (0.95, 0.5)]  # fmt: skip
        bound = " to ".join(f"{end:.3g}" for end in _bound(axis, line))
        falls.append((AXES[axis].title, grasp, bound, *found[0], *found[1]))
        for value, group in line.items():
            tested, parts = _tested(group), [row.at[axis][1] for row in group]
            won = sum(row.held for row in tested)
            low, high = wilson(won, len(tested))
            lost = Counter(row.outcome for row in tested if not row.held).most_common()
            rates.append((
                axis, grasp, "unchanged" if value is None else value,
                f"{min(parts):.2f}-{max(parts):.2f}",
                f"{100 * won / max(1, len(tested)):.0f} ({100 * low:.0f}-{100 * high:.0f})",
                len(tested), ", ".join(f"{n} {name}" for name, n in lost),
                len(group) - len(tested),
            ))  # fmt: skip
    first = (
        "axis",
        "first grasp",
        "bound",
        "below 95 %",
        "share of the bound",
        "below 50 %",
        "the same share",
    )
    second = ("axis", "first grasp", "value", "share of the bound", "held, %", "n", "not held",
            "never slipped")  # fmt: skip
    return "\n\n".join(markdown(dict(zip(names, zip(*lines, strict=True), strict=True)))
                       for names, lines in ((first, falls), (second, rates)))  # fmt: skip


def chart(rows: Sequence[Row], figure: Any) -> None:
    """Success with 95 % intervals, a panel per axis; a band is the bound over the objects."""
    lines = _lines(rows)
    axes = [*dict.fromkeys(axis for _, axis, _ in lines)]
    panels = figure.subplots(-(-len(axes) // 4), min(4, len(axes)), sharey=True, squeeze=False)
    for grasp, axis, line in lines:
        panel = panels.flat[axes.index(axis)]
        points = [(v, sum(r.held for r in _tested(g)), len(_tested(g))) for v, g in line.items()]
        points = [(v, won, n) for v, won, n in points if v is not None and n]
        rate = np.array([won / n for _, won, n in points])
        ends = np.array([wilson(won, n) for _, won, n in points]).reshape(-1, 2).T
        if not panel.has_data():  # the first of the two grasps
            panel.axvspan(*_bound(axis, line), color="#00000014", lw=0)
            panel.set(xlabel=AXES[axis].title, ylim=(-0.03, 1.05), ylabel="held")
            *_, linear, _, farthest = AXES[axis].values
            if farthest > 5.0 * linear:
                panel.set_xscale("symlog", linthresh=linear)
            if AXES[axis].sign < 0:
                panel.invert_xaxis()  # harder to the right
        panel.errorbar([v for v, *_ in points], rate, np.abs(ends - rate), ms=3.5, lw=1, capsize=2,
                       label=LABELS[grasp], **LOOKS[grasp])  # fmt: skip
    panels.flat[0].legend(loc="lower left")


STUDY = Study("operating envelope of the lift on eight difficulty axes", grid, trial,
              Row, table, chart, options, (16.0, 7.5))  # fmt: skip
