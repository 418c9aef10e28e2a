"""Terminal view of a campaign: Table IV."""

import math
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from detector.scores.quantiles import Quantiles
    from scenarios.campaign.summary import Cell, Summary, Variant

TITLES = {"lift": "object lift", "tap": "mallet tap"}


def print_summary(summary: "Summary") -> None:
    """Table IV, one table a scenario: the paper beside every variant."""
    from rich.console import Console

    console = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    for scenario in dict.fromkeys(variant.scenario for variant in summary.variants):
        variants = [v for v in summary.variants if v.scenario == scenario]
        console.print(_rates(scenario, variants))
        console.print(_times(variants))
    console.print(
        f"{_plural(summary.trials, 'trial')}, {_plural(summary.errors, 'error')}, "
        f"{summary.cpu_s:g} s of CPU time"
    )
    if len(summary.versions) > 1:
        console.print(f"NOTE: rows of {len(summary.versions)} different versions, see --json")


def _plural(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _rates(scenario: str, variants: "list[Variant]") -> Any:
    from rich.table import Table

    from scenarios.campaign.summary import TABLE_IV, TRIALS, paper_rate, wilson

    names = list(dict.fromkeys(cell.object for v in variants for cell in v.cells))
    table = Table(title=TITLES[scenario], title_justify="left")
    for heading in ("object", "paper, n = 20", *map(_heading, variants)):
        table.add_column(heading)
    for name in names:
        rate = paper_rate(scenario, name)
        paper = "-"
        if rate is not None:
            known = TABLE_IV[name]
            paper = _rate(rate, wilson(round(rate * TRIALS), TRIALS))
            if scenario == "lift" and known.far:
                paper += f"  {known.near * 5}+{known.far * 5}"
        cells = [next((c for c in v.cells if c.object == name), None) for v in variants]
        table.add_row(name, paper, *(_shown(cell) for cell in cells))
    rates = [paper_rate(scenario, name) for name in names]
    known_rates = [rate for rate in rates if rate is not None]
    average = f"{sum(known_rates) / len(known_rates):.1%}" if known_rates else "-"
    table.add_section()
    table.add_row("average", average, *(_average(v) for v in variants))
    return table


def _average(variant: "Variant") -> str:
    text = f"{variant.average:.1%}"
    if any(cell.apart for cell in variant.cells):
        text += f"\n{variant.average_of_all:.1%} of all, those apart counted as failed"
    return text


def _heading(variant: "Variant") -> str:
    swept = "" if variant.swept == "{}" else f"\n{variant.swept}"
    return f"{variant.profile}, {variant.detector}{swept}"


def _rate(rate: float, interval: tuple[float, float]) -> str:
    low, high = interval
    if math.isnan(rate):
        return "   -"  # nothing was judged
    return f"{rate:4.0%} ({low * 100:.0f}-{high * 100:.0f})"


def _shown(cell: "Cell | None") -> str:
    if cell is None:
        return "-"
    text = _rate(cell.rate, cell.interval)
    if cell.within_6cm is not None and cell.within_12cm:
        parts = (cell.within_6cm, cell.within_12cm)
        text += "  " + "+".join(f"{100 * part / cell.trials:.0f}" for part in parts)
    text += f"  n {cell.trials}"
    if cell.apart:
        text += f" of {cell.trials + sum(cell.apart.values())}: {cell.rate_of_all:.0%} of all"
    text += f", {_plural(cell.errors, 'error')}" if cell.errors else ""
    good = ("held", "registered", *cell.apart)
    lost = {name: n for name, n in cell.outcomes.items() if not name.startswith(good)}
    text += "".join(f"\n{n} {name}" for name, n in lost.items())
    text += "".join(f"\n{n} {name}, apart" for name, n in cell.apart.items())
    return text + (f"\n{cell.alarms_stayed} held, alarm stayed" if cell.alarms_stayed else "")


def _times(variants: "list[Variant]") -> Any:
    from rich.table import Table

    table = Table(title="50, 90 and 99 % of all trials; inf: that many did not get there",
                  title_justify="left")  # fmt: skip
    tap = variants[0].scenario == "tap"
    third = "nominal after motion, ms" if tap else "force rises after onset, ms"
    fourth = "moved, mm" if tap else "slip, mm"
    headings = (
        "variant",
        "object",
        "registered after onset, ms",
        third,
        fourth,
        "turned, deg",
        "arm stood, s",
    )
    for heading in headings:
        table.add_column(heading)
    for variant in variants:
        for i, cell in enumerate(variant.cells):
            table.add_row(
                _heading(variant) if i == 0 else "", cell.object,
                _three(cell.detection_latency_ms),
                _three(cell.nominal_again_ms if tap else cell.reaction_latency_ms),
                _three(cell.slip_distance_mm),
                _three(cell.turned_deg, ".1f"),
                _three(cell.paused_s, ".2f"),
            )  # fmt: skip
    return table


def _three(q: "Quantiles | None", form: str = ".0f") -> str:
    return "-" if q is None else f"{q.p50:{form}} / {q.p90:{form}} / {q.p99:{form}}"
