"""The page of a campaign: `grasp report FILE.sqlite`."""

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, ConfigError
from grasp.settings import Layer, load
from scenarios.campaign.config import RunConfig
from scenarios.campaign.spec import CampaignSpec
from scenarios.campaign.store import DAMAGED, CampaignStore
from scenarios.campaign.summary import TABLE_IV, TRIALS, Variant, paper_rate, summarize, wilson
from scenarios.campaign.summary import Cell as Counted
from scenarios.campaign.worker import Row
from scenarios.report.page import Cell, Part, Section, Table, cells, table_page
from scenarios.report.run_settings import command_of
from scenarios.tap.scoring import UNMOVED
from scenarios.trial.result import spelt

FIELDS = RunConfig.__struct_fields__
MOST_FAILURES = 400  # listed, to limit the size of the page
GOOD = ("held", "registered")  # prefixes of successful outcomes
TITLES = {"lift": "Object lift", "tap": "Mallet tap"}
KINDS = ("good", "bad", "excluded", "error")
BARS = (
    "Bars: 95 % intervals (Wilson), 0 to 100 %. Strips: successes, failures, trials excluded from "
    "the rate, errors. A tap without displacement is excluded."
)


def campaign_page(file: Path, out: Path) -> str:
    """The page of a campaign's file; links are relative to ``out``. Raises BadFile."""
    with CampaignStore.open(file) as store:
        spec, rows, settings, rig = store.spec, store.rows(), store.settings(), store.rig
    sections = [
        _scenario(scenario, [v for v in summarize(spec.name, rows).variants
                             if v.scenario == scenario])
        for scenario in dict.fromkeys(row.scenario for row in rows)
    ]  # fmt: skip
    failed = [row for row in rows if _failed(row)]
    for digest in {row.config_hash for row in failed}:
        known = settings.get(digest, {})
        try:
            load(RunConfig, [Layer(digest, {k: v for k, v in known.items() if k in FIELDS})])
        except (ConfigError, RecursionError) as error:
            raise BadFile(file, f"settings do not fit this version: {error}", DAMAGED) from None
    shown = [_failure(spec, row, settings[row.config_hash], file, out)
             for row in failed[:MOST_FAILURES]]  # fmt: skip
    headings = ("trial", "what", "outcome", "seed", "slip, mm", "recording", "again")
    more = f"{len(failed) - len(shown)} more are in the file. " * (len(failed) > len(shown))
    hint = f"{more}`grasp report RECORDING` makes a recording's page; then make this page again."
    table = Table(headings, shown, hint)
    sections += [Section(f"Trials that failed ({len(failed)})", [table])] if failed else []
    errors = sum(row.status == "error" for row in rows)
    versions = dict.fromkeys(row.versions for row in rows if row.versions)
    remarks = [f"{errors} trials ended with an error and count in no rate."] if errors else []
    seeds = ", ".join(map(str, spec.seeds))
    origins = [
        f"{sum(row.cpu_s or 0.0 for row in rows):.0f} s of processor time; {spec.repetitions} "
        f"repetitions of each combination, seeds {seeds}.",
        *(", ".join(f"{name} {text}" for name, text in sorted(json.loads(version).items()))
          for version in versions),
    ]  # fmt: skip
    return table_page(
        f"campaign {spec.name}", f"rig {rig} · {len(rows)} trials · {', '.join(spec.objects)}",
        _sentence(rows), sections, remarks, origins,
    )  # fmt: skip


def _failed(row: Row) -> bool:
    return row.status == "error" or (not row.success and row.outcome not in UNMOVED)


def _counts(row: Row) -> bool:
    """Whether a trial counts in the success rate: every lift, and taps that moved the object."""
    return row.status == "done" and (row.scenario == "lift" or bool(row.moved))


def _sentence(rows: Sequence[Row]) -> str:
    """Success rates, with the paper's for the same objects."""
    parts = []
    for scenario in dict.fromkeys(row.scenario for row in rows):
        counted = [row for row in rows if row.scenario == scenario and _counts(row)]
        won = sum(bool(row.success) for row in counted)
        what = "lifts" if scenario == "lift" else "taps that moved the object"
        share = f" ({100 * won / len(counted):.0f} %)" if counted else ""
        known = {row.object for row in counted} & TABLE_IV.keys()
        paper = [rate for name in known if (rate := paper_rate(scenario, name)) is not None]
        parts.append(f"{won} of {len(counted)} {what} succeeded{share}")
        if paper:
            parts[-1] += f"; the paper's rate for these is {100 * sum(paper) / len(paper):.3g} %"
    return ". ".join(parts) + "." if parts else "No trial has been run yet."


# Table IV


def _scenario(scenario: str, variants: Sequence[Variant]) -> Section:
    """Success rate of each object and the paper's, then latencies and distances."""
    names = list(dict.fromkeys(cell.object for v in variants for cell in v.cells))
    paper = [rate for name in names if (rate := paper_rate(scenario, name)) is not None]
    headings = [_heading(variant) for variant in variants]
    of_paper = [f"paper (n {TRIALS})"] if paper else []
    rows = []
    for name in names:
        rate = paper_rate(scenario, name)
        known = [Cell() if rate is None else _rate(rate, *wilson(round(rate * TRIALS), TRIALS))]
        found = (next((c for c in v.cells if c.object == name), None) for v in variants)
        rows.append([Cell(name), *(known if paper else []), *map(_cell, found)])
    averages = ([sum(paper) / len(paper)] if paper else []) + [v.average for v in variants]
    rows.append(cells("average", *(f"{100 * average:.1f} %" for average in averages)))
    return Section(
        TITLES[scenario],
        [Table(["object", *of_paper, *headings], rows, BARS), _delays(scenario, variants)],
    )


def _rate(rate: float, low: float, high: float, trials: str = "") -> Cell:
    text = f"{100 * rate:.0f} % ({100 * low:.0f}–{100 * high:.0f}){trials}"
    return Cell(text, interval=(low, rate, high))


def _cell(found: Counted | None) -> Cell:
    """Success rate and number of trials by outcome: successes, failures, excluded, errors."""
    if found is None:
        return Cell()
    counts = [*found.outcomes.items(), *((("error", found.errors),) if found.errors else ())]
    total = sum(n for _, n in counts)
    parts = [Part(f"{n} {spelt(name)}", n / total, _kind(name, found)) for name, n in counts]
    parts.sort(key=lambda part: KINDS.index(part.kind))
    if not found.trials:
        return Cell("none counted", parts=parts)
    rate = _rate(found.rate, *found.interval, f", n {found.trials}")
    return Cell(rate.text, interval=rate.interval, parts=parts)


def _kind(outcome: str, cell: Counted) -> str:
    if outcome == "error":
        return "error"
    if outcome in cell.excluded:
        return "excluded"
    return "good" if outcome.startswith(GOOD) else "bad"


def _heading(variant: Variant) -> str:
    swept = json.loads(variant.swept)
    values = ", ".join(f"{key} = {json.dumps(value)}" for key, value in swept.items())
    return ", ".join(filter(None, (variant.profile, variant.detector, values)))


def _delays(scenario: str, variants: Sequence[Variant]) -> Table:
    tap = scenario == "tap"
    headings = (
        "object", "variant", "slip registered after onset, ms",
        "nominal after motion, ms" if tap else "force rises after onset, ms",
        "displacement, mm" if tap else "slip, mm", "arm stopped to respond, s",
    )  # fmt: skip
    rows = [
        cells(
            cell.object, _heading(variant), _three(cell.detection_latency_ms),
            _three(cell.nominal_again_ms if tap else cell.reaction_latency_ms),
            _three(cell.slip_distance_mm), _three(cell.paused_s, "{:.2f}"),
        )
        for variant in variants for cell in variant.cells
    ]  # fmt: skip
    return Table(headings, rows, "50, 90 and 99 % quantiles; –: infinite (never, or object lost).")


def _three(quantiles: Any, form: str = "{:.0f}") -> str:
    if not quantiles:
        return ""
    three = (quantiles.p50, quantiles.p90, quantiles.p99)
    return " / ".join("–" if math.isinf(value) else form.format(value) for value in three)


# Failures


def _failure(
    spec: CampaignSpec, row: Row, settings: dict[str, Any], file: Path, out: Path
) -> list[Cell]:
    recording = None if row.recording is None else file.parent / row.recording
    files = []
    if recording is not None:
        files = [("page", recording.with_suffix(".html")), ("recording", recording)]
    folder, own = out.parent.resolve(), file.parent.resolve()
    links = [
        (what, os.path.relpath(at.resolve(), folder)) for what, at in files
        if at.resolve().is_relative_to(own) and at.is_file()  # no link out of the campaign's folder
    ]  # fmt: skip
    swept = json.loads(row.swept)
    varied = ", ".join(f"{key} = {swept[key]}" for key in spec.sweep if key in swept)
    error = ((row.error or "").strip().splitlines() or [""])[-1]
    slip_mm = "" if row.slip_distance_m is None else f"{1e3 * row.slip_distance_m:.1f}"
    controller = settings["controller"] | {"keep": not row.set_down}
    command = command_of(settings | {"controller": controller}, str(row.seed), configured=False)
    return [
        Cell(str(row.trial)),
        Cell(f"{row.scenario}, {row.object}, {row.profile}, {row.detector}", varied),
        Cell(spelt(row.outcome or "error"), error),
        *cells(str(row.seed), slip_mm),
        Cell(links=links),
        Cell(command, code=True),
    ]
