"""Curves of the reaction study: success and slip distance, cliffs, the check, faster detectors."""

import itertools
from collections.abc import Iterable, Sequence

import msgspec

from detector.scores.quantiles import Quantiles, quantile, quantiles
from scenarios.campaign.paper import wilson
from scenarios.studies.reaction.copies import CopyCheck, Reaction, SeedStudy

CLIFF = 0.3  # a fall of success by this much between neighbouring latencies is named


class LatencyPoint(msgspec.Struct, frozen=True):
    """One latency of a curve."""

    latency_ms: float
    trials: int
    success: float
    interval: tuple[float, float]
    slip_mm: Quantiles  # a lost object counts as infinity
    rise_ms: Quantiles | None  # onset to the first rise of grip force, as it came out


class LatencyCurve(msgspec.Struct, frozen=True):
    """One object at one closing speed."""

    object: str
    speed_mps: float
    points: list[LatencyPoint]
    cliff: tuple[float, float, float, float] | None  # ms, success before; ms, success after


class Faster(msgspec.Struct, frozen=True):
    """What one object's detector, so many times as fast, would have made of the same trials."""

    object: str
    factor: float
    trials: int
    success: float
    slip_mm: Quantiles


class Agreement(msgspec.Struct, frozen=True):
    """Copies beside full runs that gave the same command at the same time."""

    trials: int
    same_verdict: int
    median_difference_mm: float
    largest_difference_mm: float


class ReactionSummary(msgspec.Struct, frozen=True):
    """The whole study of one profile and detector."""

    profile: str
    detector: str
    seeds: int
    never_slipped: dict[str, int]
    curves: list[LatencyCurve]
    faster: list[Faster]
    detection_latency_ms: dict[str, Quantiles | None]
    reaction_latency_ms: dict[str, Quantiles | None]
    agreement: Agreement | None


def summarize(
    profile: str, detector: str, objects: Sequence[str], found: Sequence[SeedStudy]
) -> ReactionSummary:
    checks = {name: [s.check for s in found if s.object == name and s.check] for name in objects}
    return ReactionSummary(
        profile=profile,
        detector=detector,
        seeds=len({s.seed for s in found}),
        never_slipped={n: sum(s.object == n and not s.slipped for s in found) for n in objects},
        curves=[curve for name in objects for curve in _curves(name, found)],
        faster=[each for name in objects for each in _faster(name, checks[name])],
        detection_latency_ms={
            name: quantiles([c.detection_latency_ms for c in checks[name]]) for name in objects
        },
        reaction_latency_ms={
            name: quantiles([c.full.rise_ms for c in checks[name]]) for name in objects
        },
        agreement=_agreement(list(itertools.chain(*checks.values()))),
    )


def _curves(name: str, found: Iterable[SeedStudy]) -> list[LatencyCurve]:
    cells: dict[float, dict[float, list[Reaction]]] = {}
    for each in found:
        if each.object == name:
            for p in each.grid:
                by_latency = cells.setdefault(p.speed_mps, {})
                by_latency.setdefault(p.latency_ms, []).append(p.reaction)
    curves = []
    for speed, by_latency in sorted(cells.items()):
        points = [_point(latency, got) for latency, got in sorted(by_latency.items())]
        curves.append(LatencyCurve(name, speed, points, _cliff(points)))
    return curves


def _point(latency_ms: float, got: Sequence[Reaction]) -> LatencyPoint:
    caught = sum(r.success for r in got)
    return LatencyPoint(
        latency_ms, len(got), caught / len(got), wilson(caught, len(got)), _slips_mm(got),
        quantiles([r.rise_ms for r in got]),
    )  # fmt: skip


def _slips_mm(got: Sequence[Reaction]) -> Quantiles:
    found = quantiles(None if r.slip_distance_m is None else r.slip_distance_m * 1e3 for r in got)
    if found is None:
        raise ValueError("quantiles of no reaction")
    return found


def _cliff(points: Sequence[LatencyPoint]) -> tuple[float, float, float, float] | None:
    """The steepest fall between neighbours, if it is one."""
    pairs = list(itertools.pairwise(points))
    if not pairs:
        return None
    a, b = max(pairs, key=lambda pair: pair[0].success - pair[1].success)
    if a.success - b.success < CLIFF:
        return None
    return a.latency_ms, a.success, b.latency_ms, b.success


def _faster(name: str, checks: Sequence[CopyCheck]) -> list[Faster]:
    if not checks:
        return []
    by_factor = {1.0: [c.reduced for c in checks]}
    for factor in checks[0].faster:
        by_factor[float(factor)] = [c.faster[factor] for c in checks]
    return [
        Faster(name, factor, len(got), sum(r.success for r in got) / len(got), _slips_mm(got))
        for factor, got in by_factor.items()
    ]


def _agreement(checks: Sequence[CopyCheck]) -> Agreement | None:
    if not checks:
        return None
    away = sorted(
        abs(c.full.slip_distance_m - c.reduced.slip_distance_m) * 1e3
        for c in checks
        if c.full.slip_distance_m is not None and c.reduced.slip_distance_m is not None
    )
    return Agreement(
        trials=len(checks),
        same_verdict=sum(c.full.success == c.reduced.success for c in checks),
        median_difference_mm=quantile(away, 0.5) if away else 0.0,
        largest_difference_mm=max(away, default=0.0),
    )
