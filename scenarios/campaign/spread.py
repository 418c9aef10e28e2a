"""Table IV over what nobody knows: a range of rates, and how likely the paper's column is in it."""

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from detector.scores.quantiles import quantile
from scenarios.campaign.paper import log_multinomial, paper_counts
from scenarios.campaign.spec import DRAW
from scenarios.campaign.summary import Variant, paper_rate
from scenarios.campaign.summary import summarize as by_variant
from scenarios.campaign.worker import Row


class CellRange(msgspec.Struct, frozen=True, kw_only=True):
    """Success rates of one object over the draws."""

    object: str
    least: float
    median: float
    most: float
    of_all: tuple[float, float, float]  # the same, what drops out of the rate counted as failed
    between: float  # deviation of the rates beyond what chance alone spreads them by
    paper: float | None
    inside: bool  # the paper's rate lies in the range


class Tendency(msgspec.Struct, frozen=True):
    """Spearman's rank correlation of an unknown with a figure of the column, over the draws."""

    unknown: str
    with_rate: float
    with_likelihood: float | None


class Column(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario under one profile and detector, over all draws."""

    scenario: str
    profile: str
    detector: str
    draws: int
    cells: list[CellRange]
    # of the paper's column, under each draw, and under all of them as equally likely; None: the
    # objects are not the paper's
    log_likelihoods: list[float] | None
    log_likelihood: float | None
    best_possible: float | None
    best_draw: dict[str, float] | None  # the unknowns of the likeliest
    tendencies: list[Tendency]


class Spread(msgspec.Struct, frozen=True):
    """Of a whole campaign."""

    name: str
    trials: int
    errors: int
    columns: list[Column]


def summarize(name: str, rows: Sequence[Row]) -> Spread:
    """The draws of each scenario, profile and detector, together."""
    whole = by_variant(name, rows)
    groups: dict[tuple[str, str, str], list[Variant]] = {}
    for variant in whole.variants:
        key = variant.scenario, variant.profile, variant.detector
        groups.setdefault(key, []).append(variant)
    columns = [_column(*key, variants) for key, variants in groups.items()]
    return Spread(name, whole.trials, whole.errors, columns)


def _column(scenario: str, profile: str, detector: str, draws: Sequence[Variant]) -> Column:
    names = list(dict.fromkeys(cell.object for v in draws for cell in v.cells))
    scores = [v.log_likelihood for v in draws if v.log_likelihood is not None]
    whole = len(scores) == len(draws)
    at = [_unknowns(v) for v in draws]
    return Column(
        scenario=scenario, profile=profile, detector=detector, draws=len(draws),
        cells=[_cell(scenario, name, draws) for name in names],
        log_likelihoods=scores if whole else None,
        log_likelihood=log_mean(scores) if whole else None,
        best_possible=sum(log_multinomial(paper_counts(scenario, n)) for n in names)
        if whole
        else None,
        best_draw=at[int(np.argmax(scores))] if whole else None,
        tendencies=[
            Tendency(
                key,
                rank_correlation([a[key] for a in at], [v.average_of_all for v in draws]),
                rank_correlation([a[key] for a in at], scores) if whole else None,
            )
            for key in at[0]
        ],
    )  # fmt: skip


def _unknowns(variant: Variant) -> dict[str, float]:
    swept: dict[str, Any] = msgspec.json.decode(variant.swept)
    return {key: float(value) for key, value in swept.items() if key != DRAW}


def _median(values: list[float]) -> float:
    return quantile(sorted(values), 0.5)


def _cell(scenario: str, name: str, draws: Sequence[Variant]) -> CellRange:
    cells = [cell for v in draws for cell in v.cells if cell.object == name]
    rates = [cell.rate for cell in cells if cell.trials] or [math.nan]
    of_all = [cell.rate_of_all for cell in cells]
    paper = paper_rate(scenario, name)
    return CellRange(
        object=name, least=min(rates), median=_median(rates), most=max(rates),
        of_all=(min(of_all), _median(of_all), max(of_all)),
        between=between([(cell.successes, cell.trials) for cell in cells]), paper=paper,
        inside=paper is not None and min(rates) <= paper <= max(rates),
    )  # fmt: skip


def between(counts: Sequence[tuple[int, int]]) -> float:
    """Deviation of the true rates of which these are (successes, trials): what the rates vary by,
    less what trials so few vary by chance (method of moments); 0 where that explains it all."""
    tried = [(k / n, n) for k, n in counts if n > 1]
    if len(tried) < 2:
        return 0.0
    chance = np.mean([p * (1 - p) / (n - 1) for p, n in tried])
    return math.sqrt(max(0.0, float(np.var([p for p, _ in tried], ddof=1) - chance)))


def log_mean(logs: Sequence[float]) -> float:
    """Logarithm of the mean of what these are the logarithms of."""
    top = max(logs)
    return top + math.log(sum(math.exp(x - top) for x in logs) / len(logs))


def rank_correlation(a: Sequence[float], b: Sequence[float]) -> float:
    """Spearman's; ties share their mean rank. 0 where one does not vary."""
    x, y = (_ranks(np.asarray(each, float)) for each in (a, b))
    if x.std() == 0.0 or y.std() == 0.0:
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])


def _ranks(values: Any) -> Any:
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return (last - 0.5 * (counts - 1))[which]
