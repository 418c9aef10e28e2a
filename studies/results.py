"""All measured figures of the project: results/*.csv, docs/results.md and its charts.

Each part writes results/PART.csv. A part whose file exists is run again only with `--again`, and an
interrupted part continues from what its studies have stored.
"""

import itertools
import math
import os
import shlex
import shutil
import statistics
import time
from collections import Counter
from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import msgspec

from detector.scores.quantiles import quantiles
from grasp.cli.options import Pool, whole
from grasp.cli.output import progress
from grasp.cli.parser import Parser
from grasp.files import write_whole
from grasp.settings import file_of, load, read_toml
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import load_dataset_config, plan, reduced
from scenarios.campaign import run as campaigns
from scenarios.campaign import worker
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import read_spec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import TRIALS, paper_rate, summarize
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftOutcome
from scenarios.rigs.workers import Workers
from studies import difficulty_sweep, drop_rate, reflex_table, runner
from studies import results_page as pages
from studies.physics_levels import ERRORS_MM, MUJOCO, ONE_AXIS, SCENES, cheapest
from studies.results_detectors import benchmark, detectors
from studies.results_page import Made, Row, median, percent

SUMMARY = "all measured figures: results/*.csv and docs/results.md (`make results`)"
STEP_COST = "processor time of a control step of a lift, µs"
ALL, PAPER_AVERAGES = "all objects", {"lift": 72.5, "tap": 87.5}


class DataSet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of config/datasets, with a seed of its own."""

    set: str
    seed: int
    share: float


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """studies/results.toml."""

    intro: str
    data: dict[str, DataSet]
    detectors: tuple[str, ...]
    campaign: dict[str, Any]  # changes of config/campaigns/paper.toml
    hands: dict[str, tuple[str, ...]]  # settings of each hand
    hand_campaign: dict[str, Any]
    studies: dict[str, str]  # options
    contact_step_s: float
    speed_lifts: int
    rig_lifts: int
    rig_settings: tuple[str, ...]
    topics: list[pages.Topic]


class Run(msgspec.Struct, frozen=True):
    """What a part gets. ``work`` holds data sets, ``folder`` what this part stores."""

    settings: Settings
    work: Path
    folder: Path
    jobs: int
    real: Path | None  # a labelled recording, for the part `benchmark`

    def data(self, name: str) -> Path:
        """Folder of a data set; missing recordings are made."""
        chosen, out = self.settings.data[name], self.work / "data" / name
        config = load_dataset_config(file_of("datasets", chosen.set))
        config = msgspec.structs.replace(reduced(config, chosen.share), seed=chosen.seed)
        with progress(f"data set {name}") as show:
            build(plan(config), config, out, Workers(self.jobs), show)
        return out

    def study(self, name: str, words: str = "", jobs: int | None = None) -> list[Any]:
        """Rows of a study; those stored are not run again."""
        study, parser = import_module(f"studies.{name}").STUDY, Parser(prog=name)
        study.options(parser)
        Pool.add_to(parser)
        options = f"{self.settings.studies[name]} {words} --jobs {jobs or self.jobs}"
        args = parser.parse_args(shlex.split(options))
        return runner.run(study, study.grid(args), args, self.folder)

    def campaign(self, name: str, changes: dict[str, Any]) -> list[worker.Row]:
        """Rows of the paper's campaign with changes; those stored are not run again."""
        spec = read_spec(file_of("campaigns", "paper"))
        spec = msgspec.convert(msgspec.to_builtins(spec) | changes, type(spec))
        path = self.folder / f"{name}.sqlite"
        self.folder.mkdir(parents=True, exist_ok=True)
        with progress(name) as show:
            campaigns.run(spec, path, Workers(self.jobs), resume=path.exists(),
                          on_progress=lambda p: show(p.done, p.total))  # fmt: skip
        with CampaignStore.open(path) as store:
            return store.rows()


# Lifts and taps


def campaign(run: Run) -> Made:
    """The paper's Table IV, with forces, delays and slip."""
    trials = run.campaign("campaign", run.settings.campaign)
    pooled = [msgspec.structs.replace(t, object=ALL) for t in trials]
    rows = [Row(ALL, f"paper: {s}s, %", value) for s, value in PAPER_AVERAGES.items()]
    for variant in [*summarize("", trials).variants, *summarize("", pooled).variants]:
        name = f"{variant.scenario}s, profile {variant.profile}"
        for cell in variant.cells:
            rows.append(percent(cell.object, f"{name}, %", cell.successes, cell.trials))
            rows += [median(cell.object, f"{name}: {of}", q) for of, q in (
                ("registered p50, ms", cell.detection_latency_ms),
                ("force rises p50, ms", cell.reaction_latency_ms),
                ("slip p50, mm", cell.slip_distance_mm))]  # fmt: skip
            theirs = paper_rate(variant.scenario, cell.object)
            if theirs is not None and variant.profile == "default":
                hits = round(theirs * TRIALS)
                rows.append(percent(cell.object, f"paper: {variant.scenario}s, %", hits, TRIALS))
    for scenario, profile in dict.fromkeys((t.scenario, t.profile) for t in trials):
        own = [t for t in trials if (t.scenario, t.profile) == (scenario, profile)]
        rows += highest(f"{scenario}s, profile {profile}", own)
    return rows


def highest(item: str, trials: Sequence[worker.Row]) -> list[Row]:
    """Highest commanded force, and highest true force of any finger."""
    commanded, true = ([f for t in trials if (f := getattr(t, name)) is not None]
                       for name in ("commanded_force_n", "peak_force_n"))  # fmt: skip
    return [Row(item, "highest commanded force, N", max(commanded, default=None),
                n=len(commanded)),
            Row(item, "highest true force, N", max(true, default=None), n=len(true))]  # fmt: skip


def hands(run: Run) -> Made:
    """Forces of lifts with hands that differ from the assumed one."""
    made = run.settings
    return [
        row for number, (hand, words) in enumerate(made.hands.items())
        for row in highest(hand, run.campaign(f"hand-{number}", made.hand_campaign | {
            "settings": words}))
    ]  # fmt: skip


def responses(run: Run) -> Made:
    """Slip responses compared, in the configured scene."""
    every, rows = run.study("slip_responses"), []
    for name in dict.fromkeys(r.policy for r in every):
        group = [r for r in every if r.policy == name]
        held = [r for r in group if r.held]
        rows += [
            percent(name, "held, %", len(held), len(group)),
            median(name, "slip p50, mm", quantiles(r.slip_mm for r in group)),
            median(name, "force over least p50", quantiles(r.force_n / r.least_n for r in held)),
            Row(name, "highest true force, N", max(r.peak_n for r in group), n=len(group)),
            median(name, "lift and hold p50, s", quantiles(r.seconds for r in group)),
        ]
    return rows


def difficulty(run: Run) -> Made:
    """Where lifts fail, on axes that are each varied alone."""
    lifts, rows = run.study("difficulty_sweep"), []
    for (name, axis), grasp in itertools.product(
        difficulty_sweep.AXES.items(), difficulty_sweep.GRASPS
    ):
        own = [r for r in lifts if name in r.at and r.outcome != LiftOutcome.NEVER_SLIPPED]
        own = [r for r in own if r.grasp == grasp]
        title = f"{axis.title}; {difficulty_sweep.LABELS[grasp]}"
        for level in (0.95, 0.5):
            for measure, i, sign in (("", 0, axis.sign), (", share of bound", 1, 1)):
                at = [sign * r.at[name][i] for r in own]
                value, *ends = difficulty_sweep.fall(at, [r.held for r in own], level)
                known = sorted(sign * x for x in ends if x is not None)
                low, high = known if len(known) == 2 and value is not None else (None, None)
                value = math.inf if value is None else sign * value
                words = f"below {100 * level:.0f} % from{measure}"
                rows.append(Row(title, words, value, low, high, len(own)))
        for value in sorted({r.at[name][0] for r in own if r.moved}):
            at = [r.held for r in own if r.moved and r.at[name][0] == value]
            rows.append(percent(f"{title}: {value:g}", "held, %", sum(at), len(at)))
    return rows, msgspec.to_builtins(lifts)


# Simulation and timing


def contact(run: Run) -> Made:
    """Contact levels against their reference, and the speed of a simulated lift."""
    rows, points = [], run.study("physics_levels", jobs=1)
    for each in points:
        if each.step_s == run.settings.contact_step_s and "extrapolated" in each.curve:
            item = f"{each.curve}, {each.scene}"
            rows += [Row(item, "error, µm", 1e6 * each.error_m),
                     Row(item, "processor time, ms", 1e-3 * each.cost_us)]  # fmt: skip
    for scene, error_mm in product(dict.fromkeys(p.scene for p in points), ERRORS_MM):
        here, item = [p for p in points if p.scene == scene], f"{scene}, {error_mm:g} mm"
        for curve, name in (("L", "levels"), ("MuJoCo", "MuJoCo"), (ONE_AXIS, "MuJoCo one axis")):
            best = cheapest(here, curve, error_mm)
            cost_ms = math.inf if best is None else 1e-3 * best.cost_us
            if any(p.curve.startswith(curve) for p in here):
                rows.append(Row(item, f"{name}: processor time at equal error, ms", cost_ms))
    config, factors = load_config("can", "simulated").for_lift(), []
    for seed in range(run.settings.speed_lifts + 1):
        start = time.process_time()
        result = lift.run(config, seed, None).result
        spent_s = time.process_time() - start
        if result is not None and seed:  # the first one compiles
            factors.append((result.phases[-1].t_s - result.phases[0].t_s) / spent_s)
    factors.sort()
    value = statistics.median(factors)
    rows.append(Row("one lift on one core", "times real time", value, factors[0], factors[-1],
                    len(factors)))  # fmt: skip
    period_us = 1e6 * config.loop.period_s
    whole = Row("whole step, level L1 at 0.5 ms", STEP_COST, period_us / value)
    laws = {"contact law alone, level L1 at 0.5 ms": ("L1", run.settings.contact_step_s),
            "contact law alone, MuJoCo at 2 ms": (f"MuJoCo {next(iter(MUJOCO))}", 2e-3),
            "contact law alone, MuJoCo one axis at 4 ms": (ONE_AXIS, 4e-3)}  # fmt: skip
    cost_us = {(p.curve, p.step_s): p.cost_us for p in points if p.scene == "lift"}
    periods = SCENES["lift"]().duration_s / config.loop.period_s
    rows += [whole, *(Row(name, STEP_COST, cost_us[at] / periods) for name, at in laws.items())]
    return rows, msgspec.to_builtins(points)


def drops(run: Run) -> Made:
    """Drops and excess forces of lifts over random objects and hands, with exact intervals."""
    lifts, rows = run.study("drop_rate"), []
    for name, hits, of, low, high in drop_rate.rates(lifts):
        rows += [Row(name, "lifts counted", hits, n=of), Row(name, "of lifts", of),
                 Row(name, "per 10,000 lifts", 1e4 * hits / max(1, of), 1e4 * low, 1e4 * high,
                     of)]  # fmt: skip
    holdable = Counter(row.outcome for row in lifts if row.holdable)
    others = Counter(row.outcome for row in lifts if not row.holdable)
    for outcome in holdable | others:
        rows += [Row(outcome, "holdable at the limit", holdable[outcome]),
                 Row(outcome, "not holdable", others[outcome])]  # fmt: skip
    return rows


def reflex(run: Run) -> Made:
    """Policies that grasp badly, with the reflex and without it."""
    every, rows = run.study("reflex_table"), []
    for name, own in reflex_table.groups(every).items():
        rows += [percent(name, f"{outcome}, %", sum(r.outcome == outcome for r in own), len(own))
                 for outcome in ("held", "dropped", reflex_table.SLID_OUT)]  # fmt: skip
        rows += [Row(name, "commands above the limit", sum(r.above for r in own), n=len(own)),
                 Row(name, "highest commanded force, N", max(r.commanded_n for r in own)),
                 Row(name, "highest true force, N", max(r.peak_n for r in own))]  # fmt: skip
    p50, p99 = (statistics.median(r.step_us[i] for r in every if r.reflex) for i in (0, 1))
    return [*rows, Row("one step of the reflex", "processor time, µs", p50, None, p99, len(every))]


def timing(run: Run) -> Made:
    """Wall times of the control loop in lifts on the emulated rig."""
    config = load_config("can", "emulated", None, None, run.settings.rig_settings).for_lift()
    lifts = [lift.run(config, seed, None).result for seed in range(run.settings.rig_lifts)]
    timings, rows = [each.timing for each in lifts if each is not None], []
    for item, name in (("new sample to decision", "frame_to_decision_us"),
                       ("command to acknowledged write", "decision_to_ack_us")):  # fmt: skip
        every = [q for t in timings if (q := getattr(t, name)) is not None]
        for part, over in (("p50", statistics.median), ("p90", statistics.median),
                           ("p99", statistics.median), ("max", max)):  # fmt: skip
            value = 1e-3 * over([getattr(q, part) for q in every]) if every else None
            rows.append(Row(item, f"{part}, ms", value, n=len(every)))
    missed = sum(t.missed_periods for t in timings)
    return [*rows, Row("control periods missed", "periods", missed, n=len(timings))]


PARTS: dict[str, Callable[[Run], Made]] = {
    part.__name__: part
    for part in (benchmark, detectors, campaign, hands, responses, contact, timing, difficulty,
                 drops, reflex)
}  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Run the missing parts, then write the page; returns the exit code. Raises GraspError."""
    parser = Parser(prog="python -m studies results", description=SUMMARY)
    folder = {"type": Path, "metavar": "DIR"}
    parser.add_argument("--only", nargs="+", choices=PARTS, default=(), metavar="PART",
                        help=f"parts to run: {', '.join(PARTS)} (default: all)")  # fmt: skip
    parser.add_argument("--again", action="store_true", help="run finished parts as well")
    parser.add_argument("--real", type=Path, metavar="FILE", default=os.environ.get("REAL") or None,
                        help="labelled recording of a real fingertip (default: $REAL)")  # fmt: skip
    parser.add_argument("--settings", type=Path, default=Path(__file__).with_suffix(".toml"),
                        metavar="FILE", help="(default: studies/results.toml)")  # fmt: skip
    parser.add_argument("--out", default=pages.ROOT, **folder,
                        help="folder of docs/ and results/ (default: the checkout)")  # fmt: skip
    parser.add_argument("--work", default=pages.ROOT / "build/results", **folder,
                        help="data sets and stored rows (default: build/results)")  # fmt: skip
    parser.add_argument("--jobs", type=whole(1, 256), default=2, metavar="N",
                        help="worker processes (default: %(default)s)")  # fmt: skip
    args = parser.parse_args(words)
    settings = load(Settings, [read_toml(args.settings)])
    kept = pages.Kept(args.out)
    for name in args.only or PARTS:
        if args.again:
            shutil.rmtree(args.work / name, ignore_errors=True)
        if args.again or not kept.csv(name).exists():
            print(f"{name} ...", flush=True)
            start = time.monotonic()
            run = Run(settings, args.work, args.work / name, args.jobs, args.real)
            made = PARTS[name](run)
            rows, more = made if isinstance(made, tuple) else (made, None)
            kept.add(name, rows, more, time.monotonic() - start)
    pages.charts(kept)
    write_whole(kept.page, pages.page(settings.topics, settings.intro, kept).encode())
    print(kept.page)
    return 0
