"""`grasp campaign`: run a grid of trials in parallel; summary as in the paper's Table IV."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Column, Table

from detector.scores.quantiles import Quantiles
from drivers.errors import UsageError, one_line
from grasp.cli import exits
from grasp.cli.commands import CampaignRunOptions
from grasp.cli.options import Json, workers
from grasp.cli.output import print_json, progress
from grasp.settings import file_of
from scenarios.campaign.config import load_config
from scenarios.campaign.run import Progress, default_path, run
from scenarios.campaign.spec import CampaignSpec, read_spec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import (
    TABLE_IV,
    TRIALS,
    Cell,
    Summary,
    Variant,
    paper_rate,
    summarize,
    wilson,
)
from scenarios.world import COMPILING, is_compiled

TITLES = {"lift": "object lift", "tap": "mallet tap"}
WIDTH_WITHOUT_TERMINAL = 160
CAPTION = (
    "success with 95 % interval; ms and mm: 50th / 90th / 99th percentile of all trials, inf: not "
    "registered"
)
OF_LIFTS = ", or lost; x+y: % that slipped at most 6 cm + 6 to 12 cm"


def _spec(args: CampaignRunOptions) -> CampaignSpec:
    changes: dict[str, object] = {}
    if args.detector is not None:
        changes["detectors"] = (args.detector,)
    if args.profile is not None:
        changes["profiles"] = (args.profile,)
    if args.repetitions is not None:
        changes["repetitions"] = args.repetitions
    if args.record is not None:
        changes["recordings"] = args.record
    spec = read_spec(file_of("campaigns", args.campaign))
    files = (*spec.config, *map(str, args.config or ()))
    spec = msgspec.structs.replace(spec, config=files, **changes)
    if args.set:
        _check_set(spec, args.set)
    return msgspec.structs.replace(spec, settings=(*spec.settings, *args.set))


def _check_set(spec: CampaignSpec, assignments: Sequence[str]) -> None:
    """Raises ConfigError for a wrong `--set`, UsageError for one that the sweep overrides."""
    for key in (assignment.partition("=")[0].strip() for assignment in assignments):
        if key in spec.sweep:
            raise UsageError(f"--set: the campaign's sweep already sets {key}",
                             f"leave out --set {key}")  # fmt: skip
    detector = next(iter(spec.detectors), None)
    files = [Path(word) for word in spec.config]
    load_config(spec.objects[0], "simulated", detector, files, assignments, spec.profiles[0])


def campaign_run(args: CampaignRunOptions) -> int:
    spec = _spec(args)
    out = args.out or default_path(spec)
    last: Progress | None = None
    if not is_compiled():
        exits.print_detail(COMPILING)
    with progress(spec.name, hidden=args.json) as bar:

        def report(at: Progress) -> None:
            nonlocal last
            last = at
            good = f", {at.successes / at.new:.0%} succeeded" if at.new else ""
            wrong = f", {at.errors} ERRORS" if at.errors else ""
            bar(at.new, at.total - at.done + at.new, f"{spec.name}{good}{wrong}")

        try:
            ended = run(spec, out, workers(args), args.resume, report)
        except KeyboardInterrupt:
            kept = "interrupted before any trial ended"
            if last is not None:
                kept = f"{last.done} of {last.total} trials are in {out}"
            return exits.report("interrupted", kept, "continue with --resume", args.json)
    show_summary(args, out)
    if not args.json:
        print(out)
    return exits.TRIAL_FAILED if ended.errors else exits.SUCCESS


def show_summary(args: Json, path: Path) -> int:
    with CampaignStore.open(path) as store:
        found, rig = summarize(store.spec.name, store.rows()), store.rig
    if args.json:
        print_json(found)
    else:
        print_summary(found, rig)
    return exits.SUCCESS


def print_summary(summary: Summary, rig: str) -> None:
    width = None if sys.stdout.isatty() else WIDTH_WITHOUT_TERMINAL
    console = Console(width=width, highlight=False)
    for scenario in dict.fromkeys(variant.scenario for variant in summary.variants):
        table = Table(
            Column("variant", overflow="fold"), "object", "paper, n = 20", "this",
            "registered after onset, ms", "moved, mm" if scenario == "tap" else "slip, mm",
            title=f"{TITLES[scenario]}, rig {rig}",
            caption=CAPTION + (OF_LIFTS if scenario == "lift" else ""),
        )  # fmt: skip
        for variant in (v for v in summary.variants if v.scenario == scenario):
            swept = [f"{key} = {value}" for key, value in json.loads(variant.swept).items()]
            heading = "\n".join([f"{variant.profile}, {variant.detector}", *swept])
            for i, cell in enumerate(variant.cells):
                table.add_row(
                    "" if i else heading, cell.object, _paper(scenario, cell.object), _shown(cell),
                    _three(cell.detection_latency_ms), _three(cell.slip_distance_mm),
                )  # fmt: skip
            rates = [paper_rate(scenario, cell.object) for cell in variant.cells]
            known = [rate for rate in rates if rate is not None]
            paper = f"{sum(known) / len(known):.1%}" if known else "-"
            table.add_row("", "average", paper, _average(variant), end_section=True)
        console.print(table)
    console.print(
        f"{_plural(summary.trials, 'trial')}, {_plural(summary.errors, 'error')}, "
        f"{summary.cpu_s:g} s of CPU time"
    )
    if summary.first_error:
        console.print(f"first error: {one_line(summary.first_error)}", markup=False, soft_wrap=True)
    if len(summary.versions) > 1:
        console.print(f"NOTE: rows of {len(summary.versions)} different versions, see --json")


def _plural(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _paper(scenario: str, name: str) -> str:
    """The paper's success rate, and for lifts its shares within 6 and 12 cm."""
    rate = paper_rate(scenario, name)
    if rate is None:
        return "-"
    known, text = TABLE_IV[name], _rate(rate, wilson(round(rate * TRIALS), TRIALS))
    far = scenario == "lift" and known.far
    return f"{text}  {known.near * 5}+{known.far * 5}" if far else text


def _average(variant: Variant) -> str:
    text = f"{variant.average:.1%}"
    if any(cell.excluded for cell in variant.cells):
        text += f"\n{variant.average_of_all:.1%} of all, with excluded trials as failures"
    return text


def _rate(rate: float, interval: tuple[float, float]) -> str:
    if math.isnan(rate):
        return "   -"  # no trial has a verdict
    return f"{rate:4.0%} ({interval[0] * 100:.0f}-{interval[1] * 100:.0f})"


def _shown(cell: Cell) -> str:
    text = _rate(cell.rate, cell.interval)
    if cell.within_6cm is not None and cell.within_12cm:
        parts = (cell.within_6cm, cell.within_12cm)
        text += "  " + "+".join(f"{100 * part / cell.trials:.0f}" for part in parts)
    text += f"  n {cell.trials}"
    if cell.excluded:
        text += f" of {cell.trials + sum(cell.excluded.values())}: {cell.rate_of_all:.0%} of all"
    text += f", {_plural(cell.errors, 'error')}" if cell.errors else ""
    good = ("held", "registered", *cell.excluded)
    lost = {name: n for name, n in cell.outcomes.items() if not name.startswith(good)}
    text += "".join(f"\n{n} {name}" for name, n in lost.items())
    text += "".join(f"\n{n} {name}, excluded" for name, n in cell.excluded.items())
    return text + (f"\n{cell.alarms_stayed} held, alarm stayed" if cell.alarms_stayed else "")


def _three(q: Quantiles | None) -> str:
    return "-" if q is None else f"{q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}"
