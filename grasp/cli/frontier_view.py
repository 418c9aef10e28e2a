"""What a person sees of a campaign along axes, and of one over what nobody knows."""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenarios.campaign.falls import Place
    from scenarios.campaign.frontier import Frontier, Line, Tried
    from scenarios.campaign.spread import Column, Spread


def _console() -> Any:
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def print_frontier(found: "Frontier") -> None:
    """A table an axis, then where success falls, for every profile and detector."""
    console = _console()
    for axis in dict.fromkeys(line.axis for line in found.lines):
        console.print(_axis([line for line in found.lines if line.axis == axis]))
    console.print(_falls(found.lines))
    console.print(
        f"{found.trials} trials, {found.errors} errors. Bound: what 10 N hold (docs/frontier.md)"
    )


def _axis(lines: "list[Line]") -> Any:
    from rich.table import Table

    low, high = lines[0].bound
    bound = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g} by object"
    table = Table(title=f"{lines[0].title}, {lines[0].unit}; bound {bound}", title_justify="left")
    table.add_column("value")
    table.add_column("share of the bound")
    for line in lines:
        table.add_column(f"{line.profile}, {line.detector}: held in spite of slip")
        table.add_column("never slipped")
    for i, first in enumerate(lines[0].tried):
        value = "as configured" if first.value is None else f"{first.value:g}"
        share = f"{first.share[0]:.2f}-{first.share[1]:.2f}"
        tried = [line.tried[i] for line in lines]
        cells = [text for at in tried for text in (_held(at), str(at.never_slipped or "-"))]
        table.add_row(value, share, *cells)
    return table


def _held(at: "Tried") -> str:
    if not at.tested:
        return "-"
    low, high = at.interval
    lost = {name: n for name, n in at.outcomes.items() if not name.startswith("held")}
    lost.pop("never_slipped", None)
    text = f"{at.held / at.tested:4.0%} ({low * 100:.0f}-{high * 100:.0f})  n {at.tested}"
    return text + "".join(f", {n} {name}" for name, n in lost.items())


def _falls(lines: "list[Line]") -> Any:
    from rich.table import Table

    table = Table(title="Where success falls below 95 and 50 %, with 95 % intervals; -: not within "
                  "what was tried", title_justify="left")  # fmt: skip
    for heading in ("axis", "profile, detector", "below 95 %, in the unit", "share of the bound",
                    "below 50 %, in the unit", "share of the bound"):  # fmt: skip
        table.add_column(heading)
    for line in lines:
        cells = [place(p) for pair in zip(line.falls, line.falls_share, strict=True) for p in pair]
        table.add_row(f"{line.title}, {line.unit}", f"{line.profile}, {line.detector}", *cells)
    return table


def place(p: "Place") -> str:
    """A place with its interval; - for what lies beyond what was tried."""
    at, low, high = ("-" if v is None else f"{v:.3g}" for v in (p.at, p.low, p.high))
    return f"{at} ({low} to {high})"


def print_spread(found: "Spread") -> None:
    """A table a scenario: the paper beside the range of the draws."""
    console = _console()
    for column in found.columns:
        console.print(_column(column))
        _print_likelihood(console, column)
    console.print(f"{found.trials} trials, {found.errors} errors")


def _column(column: "Column") -> Any:
    from rich.table import Table

    from grasp.cli.campaign_view import TITLES

    title = f"{TITLES[column.scenario]}, {column.profile}, {column.detector}, {column.draws} draws"
    table = Table(title=title, title_justify="left")
    for heading in ("object", "paper", "least, median, most", "of all trials", "beyond chance",
                    "paper inside"):  # fmt: skip
        table.add_column(heading)
    for cell in column.cells:
        paper = "-" if cell.paper is None else f"{cell.paper:.0%}"
        rates = ", ".join(f"{x:.0%}" for x in (cell.least, cell.median, cell.most))
        of_all = ", ".join(f"{x:.0%}" for x in cell.of_all)
        inside = "yes" if cell.inside else "no"
        table.add_row(cell.object, paper, rates, of_all, f"±{cell.between:.0%}", inside)
    return table


def _print_likelihood(console: Any, column: "Column") -> None:
    likely = column.log_likelihoods
    if likely is not None and column.log_likelihood is not None:
        console.print(
            f"log-likelihood of the paper's column: {column.log_likelihood:.1f}, every draw "
            f"equally likely; {min(likely):.1f} to {max(likely):.1f} under single draws, best "
            f"possible {column.best_possible:.1f}"
        )
        best = ", ".join(f"{key} {value:g}" for key, value in (column.best_draw or {}).items())
        console.print(f"likeliest draw: {best}")
    for each in column.tendencies:
        text = f"  {each.unknown}: rank correlation with the rate {each.with_rate:+.2f}"
        if each.with_likelihood is not None:
            text += f", with the column's likelihood {each.with_likelihood:+.2f}"
        console.print(text)
