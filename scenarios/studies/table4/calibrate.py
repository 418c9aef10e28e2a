"""Fits the little that the paper's lift column can tell, and says how well it tells it.

One arm speed that all objects share (its acceleration in proportion, which is what decides: slip
begins within the first centimetre), and one length for each short object (how far below its
widest point it is held, how long its body is), on a grid, on the lift column of Table IV alone. The
tap column is never looked at: what a profile gives for it is a prediction. Friction, mass and the
detector are not fitted: the column cannot tell them apart (a rate of detection fitted to an object
would be circular, and would not carry over to the tap).
"""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from scenarios.campaign.axes import AXES
from scenarios.campaign.config import load_config
from scenarios.campaign.paper import (
    TABLE_IV,
    log_multinomial,
    log_predictive,
    p_value,
    paper_counts,
)
from scenarios.campaign.run import OnProgress, run
from scenarios.campaign.spec import CampaignSpec
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import class_counts
from scenarios.campaign.worker import Row
from scenarios.rigs.workers import Workers

SPEED = "controller.lift_speed_mps"
SPEEDS_MPS = (0.1, 0.2, 0.3, 0.4)  # assumed range of the paper's arm; the profile's own is 0.1
LENGTHS_M: dict[str, tuple[str, tuple[float, ...]]] = {
    "ball": ("object.grip_height_m", (-0.012, -0.008, -0.004, 0.0)),
    "foam": ("object.body_above_grip_m", (0.03, 0.038, 0.046, 0.054)),
    "football": ("object.half_height_m", (0.05, 0.065, 0.08, 0.12)),
}
IN_THE_AIR = "controller.keep=true"  # judged there; the way down costs more than the lift
SEED = 90  # kept apart from the seeds that are reported
LEAST_LIFTS = 20  # a place; with fewer, chance alone moves its likelihood by more than PLAUSIBLE
PLAUSIBLE = 1.92  # log units below the best: 95 % of a likelihood profile


class Candidate(msgspec.Struct, frozen=True):
    """One object at one arm speed and, if it has one, one length."""

    object: str
    speed_mps: float
    length_m: float | None
    counts: tuple[int, ...]  # by the classes of the paper's cell
    log_likelihood: float  # of the paper's counts
    p_value: float

    @property
    def rate(self) -> float:
        return 1 - self.counts[-1] / max(1, sum(self.counts))


class LikelihoodProfile(msgspec.Struct, frozen=True):
    """Likelihood of one setting, the others at their best for it; relative to the best of all."""

    setting: str
    object: str  # empty: shared
    values: list[float]
    log_likelihood: list[float]
    best: float
    plausible: list[float]  # values within 1.92 of the best
    at_border: bool  # the best value is the first or last that was tried


class TradeOff(msgspec.Struct, frozen=True):
    """Arm speed and one length that stand in for one another: all explain the object about as
    well."""

    object: str
    setting: str
    pairs: list[tuple[float, float]]  # (arm speed, length) within 1.92 of the object's best
    everything: bool  # all that were tried


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """What came out."""

    detector: str
    profile: str
    repetitions: int
    coarse: bool  # fewer lifts a place than tell places apart: nothing of it identifies anything
    speed_mps: float
    best: list[Candidate]
    log_likelihood: float
    best_possible: float  # the paper's own frequencies
    profiles: list[LikelihoodProfile]
    trade_offs: list[TradeOff]


def specs(detector: str | None, profile: str, repetitions: int) -> list[CampaignSpec]:
    """The campaigns that a calibration needs: at each arm speed one for the long objects, one a
    short one."""

    def spec(
        name: str, objects: tuple[str, ...], speed_mps: float, sweep: dict[str, Sequence[float]]
    ) -> CampaignSpec:
        return CampaignSpec(
            name=f"calibrate-{name}-{speed_mps:g}", objects=objects, profiles=(profile,),
            detectors=() if detector is None else (detector,), seeds=(SEED,),
            repetitions=repetitions, settings=(IN_THE_AIR, *arm_words(profile, speed_mps)),
            sweep={SPEED: (speed_mps,), **{key: tuple(values) for key, values in sweep.items()}},
            recordings="none",
        )  # fmt: skip

    long = tuple(name for name in TABLE_IV if name not in LENGTHS_M)
    return [
        each
        for speed_mps in SPEEDS_MPS
        for each in (
            spec("long", long, speed_mps, {}),
            *(spec(name, (name,), speed_mps, {k: v}) for name, (k, v) in LENGTHS_M.items()),
        )
    ]


def arm_words(profile: str, speed_mps: float) -> tuple[str, ...]:
    """Assignments, section.key=value, that let the arm rise so fast, and accelerate with it."""
    base = load_config(next(iter(TABLE_IV)), "simulated", None, None, (), profile)
    return tuple(AXES["speed"].moved(base, speed_mps))


def calibrate(
    detector: str | None,
    profile: str,
    repetitions: int,
    folder: Path,
    workers: Workers,
    on_progress: OnProgress,
) -> Calibration:
    """Run what the folder's campaign files lack, then fit.

    Raises ConfigError, also where the folder is of another calibration.
    """
    rows: list[Row] = []
    for spec in specs(detector, profile, repetitions):
        path = folder / f"{spec.name}.sqlite"
        run(spec, path, workers, resume=True, on_progress=on_progress)
        with CampaignStore.open(path) as store:
            rows += store.rows()
    return fit(rows, profile, repetitions)


def fit(rows: Sequence[Row], profile: str, repetitions: int) -> Calibration:
    """The most likely values, with the likelihood profile of each."""
    found = candidates(rows)
    totals = {s: sum(c.log_likelihood for c in _best_at(found, s)) for s in SPEEDS_MPS}
    speed = max(totals, key=lambda s: totals[s])
    best = _best_at(found, speed)
    profiles = [_profile(SPEED, "", list(totals), list(totals.values()))]
    profiles += [_length_profile(found, totals, name) for name in LENGTHS_M]
    return Calibration(
        detector=rows[0].detector, profile=profile, repetitions=repetitions,
        coarse=repetitions < LEAST_LIFTS, speed_mps=speed, best=best, log_likelihood=totals[speed],
        best_possible=sum(log_multinomial(paper_counts("lift", name)) for name in TABLE_IV),
        profiles=profiles, trade_offs=[_trade_off(found, name) for name in LENGTHS_M],
    )  # fmt: skip


def candidates(rows: Sequence[Row]) -> list[Candidate]:
    """Every place of the grids with its likelihood."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.object, row.swept), []).append(row)
    return [_candidate(name, swept, group) for (name, swept), group in groups.items()]


def _candidate(name: str, swept: str, rows: Sequence[Row]) -> Candidate:
    values: dict[str, float] = msgspec.json.decode(swept)
    counts, paper = class_counts("lift", name, rows), paper_counts("lift", name)
    length_m = values[LENGTHS_M[name][0]] if name in LENGTHS_M else None
    return Candidate(
        name, values[SPEED], length_m, counts, log_predictive(paper, counts), p_value(paper, counts)
    )


def _best_at(found: Sequence[Candidate], speed_mps: float) -> list[Candidate]:
    """Of each object the likeliest candidate at that arm speed."""
    here = [c for c in found if c.speed_mps == speed_mps]
    return [
        max((c for c in here if c.object == name), key=lambda c: c.log_likelihood)
        for name in dict.fromkeys(c.object for c in found)
    ]


def _profile(
    setting: str, name: str, values: list[float], scores: list[float]
) -> LikelihoodProfile:
    top = max(scores)
    best = values[scores.index(top)]
    plausible = [v for v, score in zip(values, scores, strict=True) if top - score <= PLAUSIBLE]
    relative = [round(score - top, 3) for score in scores]
    return LikelihoodProfile(
        setting, name, values, relative, best, plausible, best in (min(values), max(values))
    )


def _length_profile(
    found: Sequence[Candidate], totals: dict[float, float], name: str
) -> LikelihoodProfile:
    """The arm speed and the other objects' lengths at their best for each value."""
    setting, values = LENGTHS_M[name]
    own = {(c.speed_mps, c.length_m): c.log_likelihood for c in found if c.object == name}
    best_own = {s: max(own[s, v] for v in values) for s in totals}
    scores = [max(totals[s] - best_own[s] + own[s, v] for s in totals) for v in values]
    return _profile(setting, name, list(values), scores)


def _trade_off(found: Sequence[Candidate], name: str) -> TradeOff:
    own = [c for c in found if c.object == name]
    top = max(c.log_likelihood for c in own)
    pairs = [
        (c.speed_mps, c.length_m)
        for c in sorted(own, key=lambda c: (c.speed_mps, c.length_m or 0.0))
        if top - c.log_likelihood <= PLAUSIBLE and c.length_m is not None
    ]
    return TradeOff(name, LENGTHS_M[name][0], pairs, len(pairs) == len(own))


def trades(trade_off: TradeOff) -> bool:
    """True where more than one arm speed goes with more than one length."""
    speeds, lengths = (set(each) for each in zip(*trade_off.pairs, strict=True))
    return len(speeds) > 1 and len(lengths) > 1


def counts_over_grid(folder: Path, name: str) -> list[tuple[int, ...]]:
    """Of an object's lifts by the classes of the paper's cell, place by place, as the folder's
    files have them."""
    rows: list[Row] = []
    for path in sorted(folder.glob("calibrate-*.sqlite")):
        with CampaignStore.open(path) as store:
            rows += [row for row in store.rows() if row.object == name]
    return [candidate.counts for candidate in candidates(rows)]


def assignments(result: Calibration) -> list[tuple[str, str]]:
    """(object or empty, section.key=value) of everything that was calibrated."""
    lengths = [
        (c.object, f"{LENGTHS_M[c.object][0]}={c.length_m:g}")
        for c in result.best
        if c.length_m is not None
    ]
    arm = [("", word) for word in arm_words(result.profile, result.speed_mps)]
    return [*arm, *lengths]
