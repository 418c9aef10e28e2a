"""The page of a campaign: `grasp report FILE.sqlite`."""

import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from scenarios.campaign.spec import CampaignSpec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import (
    TABLE_IV,
    TRIALS,
    Cell,
    Variant,
    paper_rate,
    registered_ms,
    summarize,
    wilson,
)
from scenarios.campaign.worker import Row
from scenarios.report.charts import Plot, Rate, rates, shares
from scenarios.report.page import render
from scenarios.report.run_settings import command_of, shell
from scenarios.tap.scoring import UNMOVED
from scenarios.trial.result import spelt

MOST_FAILURES = 400  # that are listed: a page stays below its size
GOOD = ("held", "registered")  # how outcomes of a success begin
TITLES = {"lift": "Object lift", "tap": "Mallet tap"}


class Part(msgspec.Struct, frozen=True):
    """One outcome of a cell, as a share of a strip."""

    outcome: str
    trials: int
    share: float
    kind: str


class TableRow(msgspec.Struct, frozen=True):
    """One object: the paper's rate, and its cell of each variant, None where it was not tried."""

    object: str
    paper: tuple[int, tuple[float, float]] | None  # of twenty
    cells: list[tuple[Cell, list[Part]] | None]


class Table(msgspec.Struct, frozen=True):
    """Table IV of one scenario, and how its trials were distributed."""

    scenario: str
    title: str
    variants: list[Variant]
    headings: list[str]
    rows: list[TableRow]
    paper_average: float | None
    plots: list[Plot]


class Failed(msgspec.Struct, frozen=True):
    """One trial that did not succeed."""

    row: Row
    varied: str
    recording: str | None  # relative to the page
    page: str | None
    command: str


def campaign_page(file: Path, out: Path) -> str:
    """The page of a campaign's file, with links from where it will stand; raises BadFile."""
    with CampaignStore.open(file) as store:
        spec, rows, settings = store.spec, store.rows(), store.settings()
    failed = [row for row in rows if _failed(row)]
    tables = _tables(spec, rows)
    return render(
        "campaign.html",
        (),
        title=f"campaign {spec.name}",
        sentence=_sentence(rows),
        spec=spec,
        spelt=spelt,
        rows=rows,
        errors=sum(row.status == "error" for row in rows),
        tables=tables,
        swept=_swept(spec, rows),
        failed=[
            _shown(spec, row, settings[row.config_hash], file, out)
            for row in failed[:MOST_FAILURES]
        ],
        left_out=max(0, len(failed) - MOST_FAILURES),
        trials_of_the_paper=TRIALS,
        versions=_versions(rows),
        cpu_s=sum(row.cpu_s or 0.0 for row in rows),
        data={},
    )


def _failed(row: Row) -> bool:
    return row.status == "error" or (not row.success and row.outcome not in UNMOVED)


def _sentence(rows: Sequence[Row]) -> str:
    """Success in figures, beside the paper's where its objects were tried."""
    told = []
    for scenario in dict.fromkeys(row.scenario for row in rows):
        counted = [row for row in rows if row.scenario == scenario and _counts(row)]
        won = sum(bool(row.success) for row in counted)
        what = "lifts" if scenario == "lift" else "taps that moved the object"
        share = f" ({100 * won / len(counted):.0f} %)" if counted else ""
        known = {row.object for row in counted} & TABLE_IV.keys()
        paper = [rate for name in known if (rate := paper_rate(scenario, name)) is not None]
        beside = f"; the paper's of these objects {100 * sum(paper) / len(paper):.3g} %"
        told.append(f"{won} of {len(counted)} {what} succeeded{share}{beside if paper else ''}")
    return ". ".join(told) + "." if told else "Nothing has been run yet."


def _counts(row: Row) -> bool:
    """Whether a success rate is out of it: of taps, of those that moved the object."""
    return row.status == "done" and (row.scenario == "lift" or bool(row.moved))


# Table IV


def _tables(spec: CampaignSpec, rows: Sequence[Row]) -> list[Table]:
    """A table a scenario."""
    summary = summarize(spec.name, rows)
    scenarios = dict.fromkeys(variant.scenario for variant in summary.variants)
    return [_table(scenario, summary.variants, rows) for scenario in scenarios]


def _table(scenario: str, every: Sequence[Variant], rows: Sequence[Row]) -> Table:
    variants = [variant for variant in every if variant.scenario == scenario]
    names = list(dict.fromkeys(cell.object for v in variants for cell in v.cells))
    paper = [rate for name in names if (rate := paper_rate(scenario, name)) is not None]
    by_object = [
        (variant, [row for row in rows if _of(variant, row) and _counts(row)])
        for variant in variants
    ]
    return Table(
        scenario=scenario,
        title=TITLES[scenario],
        variants=variants,
        headings=[_heading(variant) for variant in variants],
        rows=[_table_row(scenario, name, variants) for name in names],
        paper_average=sum(paper) / len(paper) if paper else None,
        plots=[
            plot
            for variant, found in by_object
            for plot in _distributions(variant, found, len(variants) > 1)
        ],
    )


def _table_row(scenario: str, name: str, variants: Sequence[Variant]) -> TableRow:
    rate = paper_rate(scenario, name)
    won = None if rate is None else round(rate * TRIALS)
    cells = [next((c for c in v.cells if c.object == name), None) for v in variants]
    return TableRow(
        object=name,
        paper=None if won is None else (won, wilson(won, TRIALS)),
        cells=[None if cell is None else (cell, _strip(cell)) for cell in cells],
    )


def _strip(cell: Cell) -> list[Part]:
    """Its trials by outcome: successes, failures, what stands apart, errors."""
    order = {"good": 0, "bad": 1, "apart": 2, "error": 3}
    counts = [*cell.outcomes.items(), *((("error", cell.errors),) if cell.errors else ())]
    total = sum(n for _, n in counts)
    parts = [Part(name, n, n / total, _kind(name, cell)) for name, n in counts]
    return sorted(parts, key=lambda part: order[part.kind])


def _kind(outcome: str, cell: Cell) -> str:
    if outcome == "error":
        return "error"
    if outcome in cell.apart:
        return "apart"
    return "good" if outcome.startswith(GOOD) else "bad"


def _heading(variant: Variant) -> str:
    swept = json.loads(variant.swept)
    told = ", ".join(f"{key} = {json.dumps(value)}" for key, value in swept.items())
    return ", ".join(filter(None, (variant.profile, variant.detector, told)))


def _of(variant: Variant, row: Row) -> bool:
    keys = (row.scenario, row.profile, row.detector, row.swept)
    return keys == (variant.scenario, variant.profile, variant.detector, variant.swept)


def _distributions(variant: Variant, rows: Sequence[Row], named: bool) -> list[Plot]:
    """How late slip was registered, and how far the object moved, by object."""
    heading = f", {_heading(variant)}" if named else ""
    names = list(dict.fromkeys(row.object for row in rows))

    def by_object(value: Callable[[Row], float | None]) -> list[tuple[str, list[float]]]:
        return [
            (name, [_or_never(value(row)) for row in rows if row.object == name]) for name in names
        ]

    moved = "Moved" if variant.scenario == "tap" else "Slip in the hand"
    plots = (
        shares(f"Slip registered{heading}", "ms after its onset", by_object(registered_ms)),
        shares(f"{moved}{heading}", "mm", by_object(_slip_mm)),
    )
    return [plot for plot in plots if plot is not None]


def _or_never(value: float | None) -> float:
    return math.inf if value is None else value


def _slip_mm(row: Row) -> float | None:
    """What was lost slipped for ever."""
    lost = row.scenario == "lift" and not row.success
    return None if row.slip_distance_m is None or lost else row.slip_distance_m * 1e3


# What was varied


def _told(row: Row) -> dict[str, Any]:
    table: dict[str, Any] = json.loads(row.swept)
    return table


def _swept(spec: CampaignSpec, rows: Sequence[Row]) -> list[Plot]:
    """Success against each thing that was varied, all others taken together."""
    plots = []
    for key in spec.sweep:
        values = [_told(row).get(key) for row in rows]
        places = _places(values)
        groups: dict[str, dict[float, list[Row]]] = {}
        for row, place in zip(rows, places, strict=True):
            if place is not None and _counts(row):
                name = f"{row.scenario}, {row.profile}, {row.detector}"
                groups.setdefault(name, {}).setdefault(place[0], []).append(row)
        labels = dict(place for place in places if place is not None)
        if groups:
            named = [(name, _rated(by_place, labels)) for name, by_place in groups.items()]
            plots.append(rates(key, "", named))
    return plots


def _rated(by_place: dict[float, list[Row]], labels: dict[float, str]) -> list[Rate]:
    found = []
    for x, rows in by_place.items():
        won = sum(bool(row.success) for row in rows)
        found.append(Rate(x, labels[x], won, len(rows), wilson(won, len(rows))))
    return found


def _places(values: Sequence[Any]) -> list[tuple[float, str] | None]:
    """Where each value stands, and its name: a number where it is one, else its place in the order
    of the values."""
    numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(numbers) < sum(value is not None for value in values):
        order = list(dict.fromkeys(json.dumps(value) for value in values if value is not None))
        return [
            None if value is None else (float(order.index(json.dumps(value))), json.dumps(value))
            for value in values
        ]
    return [None if value is None else (float(value), f"{value:g}") for value in values]


# Failures


def _shown(spec: CampaignSpec, row: Row, settings: dict[str, Any], file: Path, out: Path) -> Failed:
    recording = page = None
    if row.recording is not None:
        kept = file.parent / row.recording
        recording = _link(kept, out)
        page = _link(kept.with_suffix(".html"), out)
    told = _told(row)
    varied = [f"{key} = {told[key]}" for key in spec.sweep if key in told]
    command = command_of(settings, str(row.seed), begun=False)
    return Failed(row, ", ".join(varied), recording, page, shell(command))


def _link(target: Path, out: Path) -> str | None:
    """Relative address of a file beside the page; None where it is not there."""
    if not target.is_file():
        return None
    return os.path.relpath(target.resolve(), out.parent.resolve())


def _versions(rows: Sequence[Row]) -> list[dict[str, str]]:
    found = dict.fromkeys(row.versions for row in rows if row.versions)
    return [json.loads(text) for text in found]
