"""Fits the simulated fingertip to a real recording: simulated strokes like the recording's, their
statistics side by side with the real ones, and a search that brings the two together.

The search is the cross-entropy method (Rubinstein 1999): draw parameter sets from a normal
distribution, keep the best, fit the distribution to them, repeat. All sets are judged on the same
seeds. What the recording does not show is left at its assumed value.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.scores.quantiles import quantile
from scenarios.acquire.signal_statistics import FFT_HZ, signal_statistics
from scenarios.acquire.strokes import StrokeSettings, simulate
from scenarios.world.settings import FingertipSettings

SCALE_FACTOR, CORRELATION, CONTRAST, CONTRAST_BY_EDGE = 1.5, 0.2, 0.03, 0.1  # the aims
BATCH, SEEDS = 6, 1000  # clips at a time; seeds apart, so that no clip is made twice
WRITTEN = "# fitted by `grasp calibrate fingertip"  # how every file of fitted values begins
CREEP = 50.0  # counts/s: may be of either sign, so no factor
FIT_SEED, JUDGE_SEED = 1000, 2  # judged on clips that the fit has not seen
Floats = NDArray[np.float64]
Figures = dict[str, float]


class Target(msgspec.Struct, frozen=True):
    """One statistic that the simulation should share with the recording."""

    name: str
    group: str  # groups weigh alike in the fit
    kind: Literal["factor", "difference"]
    aim: float  # how far off is near enough: a factor, or a difference

    def error(self, real: float, simulated: float) -> float:
        """Deviation in units of the aim; 1 is just near enough."""
        if self.kind == "difference":
            return (simulated - real) / self.aim
        return float(np.log(max(simulated, 1e-3) / max(real, 1e-3)) / np.log(self.aim))


def _targets() -> tuple[Target, ...]:
    found = [
        Target("idle noise", "noise", "factor", SCALE_FACTOR),
        Target("deviation in slip", "level", "factor", SCALE_FACTOR),
        Target("highest excursion", "level", "factor", SCALE_FACTOR),
        Target("creep after a stop per s", "level", "difference", CREEP),
        Target("share saturated", "level", "factor", SCALE_FACTOR),
        Target("increment ratio", "increments", "factor", SCALE_FACTOR),
        Target("correlation static", "correlations", "difference", CORRELATION),
        Target("correlation slip", "correlations", "difference", CORRELATION),
        Target("AUC of energy", "contrast", "difference", CONTRAST),
    ]
    for state in ("static", "slip"):
        names = [f"increment {figure} {state}" for figure in ("rms", "median", "p95")]
        found += [Target(name, "increments", "factor", SCALE_FACTOR) for name in names]
        names = [f"{f} Hz {state}" for f in FFT_HZ]
        found += [Target(name, f"spectrum {state}", "factor", SCALE_FACTOR) for name in names]
    names = [f"AUC {edge}" for edge in ("0-50 ms", "50-100 ms", "100-200 ms", "over 200 ms")]
    found += [Target(name, "contrast by edge", "difference", CONTRAST_BY_EDGE) for name in names]
    return tuple(found)


TARGETS = _targets()


class Parameter(msgspec.Struct, frozen=True):
    """One number that the fit may choose, between bounds, on a logarithmic scale."""

    section: Literal["fingertip", "strokes"]
    name: str
    low: float
    high: float


PARAMETERS = (
    Parameter("fingertip", "depth_mm", 2.5, 6.0),
    Parameter("fingertip", "foundation_n_per_mm3", 0.1, 0.9),
    Parameter("fingertip", "tilt_rad", 0.02, 0.1),
    Parameter("fingertip", "crown_radius_mm", 18.0, 200.0),
    Parameter("fingertip", "wander_mm", 0.001, 0.04),
    Parameter("fingertip", "wander_fast_s", 0.005, 0.1),
    Parameter("fingertip", "wander_slow_s", 0.1, 2.0),
    Parameter("fingertip", "vibration_mm", 0.0005, 0.03),
    Parameter("fingertip", "vibration_hz", 10.0, 25.0),
    Parameter("strokes", "peak_mps", 0.015, 0.08),
    Parameter("strokes", "skew", 1.2, 5.0),
    Parameter("strokes", "force_n", 1.2, 12.0),
    Parameter("strokes", "zero_load_n", 0.05, 6.0),
    Parameter("strokes", "texture_rms_mm", 0.1, 0.6),
    Parameter("strokes", "texture_length_mm", 1.0, 3.0),
    Parameter("strokes", "friction", 0.4, 1.2),
)


class FitSetup(msgspec.Struct, frozen=True):
    """A fingertip and the strokes that it is judged on, as the authors' driver recorded it."""

    fingertip: FingertipSettings = FingertipSettings(fold_above_512=True)
    strokes: StrokeSettings = StrokeSettings()

    def changed(self, values: dict[str, float]) -> "FitSetup":
        """With settings named section.name replaced."""
        made = self
        for key, value in values.items():
            section, name = key.split(".")
            part = msgspec.structs.replace(getattr(made, section), **{name: value})
            made = msgspec.structs.replace(made, **{section: part})
        return made


def figures(setup: FitSetup, clips: int, seed: int) -> list[Figures]:
    """Statistics of simulated clips, one by one; few at a time share an arm and its vibration."""
    out: list[Figures] = []
    for first in range(0, clips, BATCH):
        n = min(BATCH, clips - first)
        made = simulate(setup.fingertip, setup.strokes, n, BATCH * SEEDS * seed + first)
        out += [signal_statistics(made.t_s, counts, made.slip) for counts in made.counts]
    return out


def mean(of: Sequence[Figures]) -> Figures:
    """Mean of each figure over the clips that have it; nan where none has."""
    out = {}
    for name in of[0]:
        values = np.array([f[name] for f in of])
        values = values[np.isfinite(values)]
        out[name] = float(values.mean()) if len(values) else np.nan
    return out


def misfit(real: Figures, simulated: Figures) -> float:
    """Root mean square over the groups of the mean squared error in aims; 1 is just near enough."""
    groups: dict[str, list[float]] = {}
    for target in TARGETS:
        if np.isfinite(real[target.name]):
            value = simulated[target.name]
            error = target.error(real[target.name], value) if np.isfinite(value) else 5.0
            groups.setdefault(target.group, []).append(min(error**2, 100.0))
    return float(np.sqrt(np.mean([np.mean(errors) for errors in groups.values()])))


class Search(msgspec.Struct, frozen=True, kw_only=True):
    """How long to look: first widely at few clips, then closely at many."""

    wide_rounds: int = 9
    wide_tries: int = 40
    wide_clips: int = 12
    close_rounds: int = 8
    close_tries: int = 24
    close_clips: int = 36
    kept_share: float = 0.25
    seed: int = 0

    def plan(self) -> list[tuple[int, int]]:
        """Tries and clips of each round."""
        wide = [(self.wide_tries, self.wide_clips)] * self.wide_rounds
        return wide + [(self.close_tries, self.close_clips)] * self.close_rounds


def fit(
    real: Figures,
    start: FitSetup,
    search: Search,
    progress: Callable[[int, int, float], None] = lambda done, total, least: None,
) -> tuple[FitSetup, dict[str, float]]:
    """Where the search has contracted to, as values by name and put into ``start``.

    All sets of a round are judged on the same clips, those of other rounds on others: no set wins
    by luck twice. ``progress`` gets tries done, tries in all and the round's least misfit.
    """
    rng = np.random.default_rng(search.seed)
    low = np.log([p.low for p in PARAMETERS])
    high = np.log([p.high for p in PARAMETERS])
    centre, spread = (low + high) / 2, (high - low) / 3
    plan = search.plan()
    done, total = 0, sum(tries for tries, _ in plan)
    for r, (tries, clips) in enumerate(plan):
        sets = np.clip(centre + spread * rng.standard_normal((tries, len(low))), low, high)
        sets[0] = centre
        errors: list[float] = []
        for values in sets:
            setup = start.changed(named(values))
            errors.append(misfit(real, mean(figures(setup, clips, FIT_SEED + r))))
            done += 1
            progress(done, total, min(errors))
        kept = sets[np.argsort(errors)[: max(2, round(search.kept_share * tries))]]
        centre = 0.2 * centre + 0.8 * kept.mean(axis=0)
        spread = np.maximum(0.3 * spread + 0.7 * kept.std(axis=0), (high - low) / 200)
    return start.changed(named(centre)), named(centre)


def named(logarithms: Floats) -> dict[str, float]:
    """Parameter values by section.name, three digits."""
    pairs = zip(PARAMETERS, np.exp(logarithms).tolist(), strict=True)
    return {f"{p.section}.{p.name}": float(f"{value:.3g}") for p, value in pairs}


class FitRow(msgspec.Struct, frozen=True):
    """One statistic side by side; ``low`` and ``high``: quantiles 0.1 and 0.9 over clips."""

    name: str
    real: float
    simulated: float
    low: float
    high: float
    within_aim: bool


def compare(real: Figures, of: Sequence[Figures]) -> list[FitRow]:
    """Every target that the recording has."""
    average = mean(of)
    rows = []
    for target in TARGETS:
        wanted, value = real[target.name], average[target.name]
        if not np.isfinite(wanted):
            continue
        spread = np.sort([f[target.name] for f in of if not np.isnan(f[target.name])])
        low, high = (quantile(spread, share) if len(spread) else np.nan for share in (0.1, 0.9))
        near = bool(abs(target.error(wanted, value)) <= 1.0)
        rows.append(FitRow(target.name, wanted, value, low, high, near))
    return rows


def parameter_values(setup: FitSetup) -> list[tuple[str, float, float, float]]:
    """Name, value, and the bounds of the search, of every parameter of the fit."""
    return [
        (f"{p.section}.{p.name}", getattr(getattr(setup, p.section), p.name), p.low, p.high)
        for p in PARAMETERS
    ]


def as_toml(fitted: dict[str, float], recording: str) -> str:
    """The fingertip's fitted values as a settings file; the nuisances as comments."""
    lines = [f"{WRITTEN} --recording {recording}`", "[fingertip]"]
    for key, value in fitted.items():
        section, name = key.split(".")
        lines.append(f"{'' if section == 'fingertip' else '# strokes: '}{name} = {value}")
    return "\n".join(lines) + "\n"
