"""Fit of the simulated fingertip to a real recording, by the statistics of simulated strokes.

The search is the cross-entropy method (Rubinstein 1999): sample parameter sets from a normal
distribution, keep the best, fit the distribution to them, repeat. All sets of a round use the same
random numbers; each round uses others. Parameters that the recording does not determine keep their
assumed values. The table ends with the fitted settings as a file for `--config`.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import read
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from drivers.errors import BadFile
from drivers.interfaces import PERIOD_S
from grasp.cli.options import whole
from grasp.cli.parser import Parser
from scenarios.acquire.config import with_values
from scenarios.world.fingertip import Fingertips
from scenarios.world.settings import GROSS_SLIP_MPS, FingertipSettings, Surface
from studies.runner import Study, markdown
from studies.slip_types import energy_series

ROUNDS = ((9, 40, 12), (8, 24, 36))  # rounds, sets, simulations a set: coarse, then fine
KEPT_SHARE = 0.25
BATCH, SEEDS = 6, 1000  # simulations at a time; distance of seeds, so that all differ
FIT_SEED, VALIDATION_SEED = 1000, 2  # validation uses simulations that the fit has not used
ZEROING, SETTLED = 20, 50  # samples: for rest counts; at rest before the first that counts
LOADED = 3  # the taxels that vary most; the one that varies least is unloaded
ENERGY_SAMPLES = 10
FFT_SAMPLES, FFT_HZ = 21, range(5, 55, 5)  # the authors' window; its bins, by rounded names
PLATEAU_COUNTS, PRESSED_COUNTS = -380, -40
CREEP_SAMPLES = 35  # after a stop
EDGES_MS = (0.0, 50.0, 100.0, 200.0, np.inf)  # distance to the nearest change of the label
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Figures = dict[str, float]

# Statistics to reproduce: group (all groups have equal weight), tolerated deviation (a factor, or
# for DIFFERENCES a difference: correlations, AUC, counts/s), and names.
AIMS: tuple[tuple[str, float, tuple[str, ...]], ...] = (
    ("noise", 1.5, ("unloaded noise",)),
    ("level", 1.5, ("deviation in slip", "highest excursion", "share saturated")),
    ("level", 50.0, ("creep after a stop per s",)),
    ("increments", 1.5, ("increment ratio", *(
        f"increment {figure} {state}" for state in ("static", "slip")
        for figure in ("rms", "median", "p95")))),
    ("correlations", 0.2, ("correlation static", "correlation slip")),
    ("spectrum static", 1.5, tuple(f"{f} Hz static" for f in FFT_HZ)),
    ("spectrum slip", 1.5, tuple(f"{f} Hz slip" for f in FFT_HZ)),
    ("contrast", 0.03, ("AUC of energy",)),
    ("contrast by edge", 0.1, tuple(f"AUC from {low:g} ms" for low in EDGES_MS[:-1])),
)  # fmt: skip
COLUMNS = ("statistic", "real", "simulated", "10 %", "90 %", "error over tolerance")
DIFFERENCES = ("creep", "correlation", "AUC")  # first words of these statistics

# Bounds of the search, on a logarithmic scale. Those of `strokes` are nuisance parameters: speed,
# force and surface of the real recording are unknown.
BOUNDS = {
    "fingertip.depth_mm": (2.5, 6.0), "fingertip.foundation_n_per_mm3": (0.1, 0.9),
    "fingertip.tilt_rad": (0.02, 0.1), "fingertip.crown_radius_mm": (18.0, 200.0),
    "fingertip.wander_mm": (0.001, 0.04), "fingertip.wander_fast_s": (0.005, 0.1),
    "fingertip.wander_slow_s": (0.1, 2.0), "fingertip.vibration_mm": (0.0005, 0.03),
    "fingertip.vibration_hz": (10.0, 25.0), "strokes.peak_mps": (0.015, 0.08),
    "strokes.skew": (1.2, 5.0), "strokes.force_n": (1.2, 12.0), "strokes.zero_load_n": (0.05, 6.0),
    "strokes.texture_rms_mm": (0.1, 0.6), "strokes.texture_length_mm": (1.0, 3.0),
    "strokes.friction": (0.4, 1.2),
}  # fmt: skip


class StrokeSettings(msgspec.Struct, frozen=True):
    """Strokes of arm and surface as in the authors' recording ("real" below)."""

    strokes: int = 4  # back and forth; real
    stroke_s: float = 0.6  # of motion above 3 mm/s; real mean
    pause_s: float = 0.25  # between strokes; real mean
    rest_s: float = 0.9  # after the last; real
    peak_mps: float = 0.0599  # maximum speed; fitted, like all parameters in BOUNDS
    skew: float = 2.49  # speed ~ s^2 (1 - s)^skew
    force_n: float = 1.99  # mean
    force_spread: float = 0.3  # between recordings, relative; assumed
    zero_load_n: float = 1.29  # on the pad while rest counts were taken
    arm_npmm: float = 5.0  # stiffness of arm and mount along the normal; assumed, 3-10
    # corner of the arm's force loop; assumed: the real load recovers at less than 0.4 /s
    force_loop_radps: float = 0.2
    texture_rms_mm: float = 0.444
    texture_length_mm: float = 1.14
    friction: float = 0.737  # kinetic
    static_share: float = 1.2  # static over kinetic; assumed, 1.1-1.5


class Setup(msgspec.Struct, frozen=True):
    """A fingertip, as recorded by the authors' driver, and its strokes."""

    fingertip: FingertipSettings = FingertipSettings(fold_above_512=True)
    strokes: StrokeSettings = StrokeSettings()


def stroke_speeds(s: StrokeSettings) -> tuple[Floats, Floats]:
    """Times (n,) and speed (n,) of the fingertip, m/s, from the first sample that counts."""
    part = np.linspace(0.0, 1.0, 501)
    bell = part**2 * (1 - part) ** s.skew
    bell /= bell.max()
    whole_s = s.stroke_s / (bell * s.peak_mps > GROSS_SLIP_MPS).mean()
    period_s = max(s.stroke_s + s.pause_s, whole_s + PERIOD_S)
    n = round((s.pause_s + s.strokes * period_s + s.rest_s) / PERIOD_S)
    t = np.arange(n) * PERIOD_S
    stroke = np.floor((t - s.pause_s) / period_s)
    phase = (t - s.pause_s - stroke * period_s) / whole_s
    speed = s.peak_mps * np.interp(phase, part, bell)
    speed[(stroke < 0) | (stroke >= s.strokes) | (phase >= 1.0)] = 0.0
    return t, np.where(stroke % 2 == 0, speed, -speed)


def simulate(setup: Setup, number: int, seed: int) -> tuple[Floats, NDArray[np.int16], Bools]:
    """Times (n,), counts (number, n, taxels) over rest and labels (n,) of simulated recordings.

    Each has its own surface, tilt, direction, force and rest. Within a stroke the arm is a stiff
    spring; a slow force loop moves its base.
    """
    rng, s = np.random.default_rng(seed), setup.strokes
    surface = Surface(
        texture_rms_mm=s.texture_rms_mm, texture_length_mm=s.texture_length_mm,
        friction_static=s.static_share * s.friction, friction_kinetic=s.friction,
    )  # fmt: skip
    angle = rng.uniform(0.0, 2 * math.pi, number)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    target = s.force_n * np.exp(s.force_spread * rng.standard_normal(number))
    slope = rng.normal(0.0, setup.fingertip.tilt_rad, number)
    tips = Fingertips(setup.fingertip, [surface] * number, rng)
    t, speed = stroke_speeds(s)
    x = np.concatenate([np.zeros(SETTLED), np.cumsum(speed) * PERIOD_S * 1e3])
    still, middle = np.zeros(number), np.zeros((number, 2))
    mount_npmm, zero_load = np.full(number, s.arm_npmm), np.full(number, s.zero_load_n)
    for k in range(ZEROING):
        tips.advance((k + 1) * PERIOD_S, zero_load, middle, still, middle, False)
    zero = tips.codes()[0]
    tips.advance((ZEROING + 1) * PERIOD_S, target, middle, still, middle, True)
    base_mm = target / s.arm_npmm + tips.approach_mm
    counts = np.empty((number, len(t), tips.rest.shape[1]), np.int16)
    for k in range(1, len(x)):
        base_mm += s.force_loop_radps * (target - tips.load_n) / s.arm_npmm * PERIOD_S
        load_n = s.arm_npmm * (base_mm - slope * x[k])  # the mount's, at approach zero
        t_s = (ZEROING + k + 1) * PERIOD_S
        tips.advance(t_s, load_n, x[k] * along, still, middle, True, mount_npmm)
        if k >= SETTLED:
            counts[:, k - SETTLED] = tips.codes()[0] - zero
    return t, counts, np.abs(speed) > GROSS_SLIP_MPS


def signal_statistics(t_s: Floats, counts: NDArray[np.int16], slip: Bools) -> Figures:
    """Named statistics of one fingertip's recording: (n,) times, (n, taxels) counts, (n,) labels.

    In counts, unless the name has another unit; NaN if the recording does not determine it.
    """
    p = counts.astype(np.float64)
    order = np.argsort(p.std(axis=0))
    loaded = p[:, np.sort(order[-LOADED:])]
    changes = np.diff(loaded, axis=0)
    static, sliding = ~slip[1:] & ~slip[:-1], slip[1:] & slip[:-1]
    out = {"unloaded noise": _rms(np.diff(p[:, order[:1]], axis=0)[static]) / math.sqrt(2.0)}
    for name, rows, chosen in (
        ("static", changes[static], ~slip), ("slip", changes[sliding], slip),
    ):  # fmt: skip
        out[f"increment rms {name}"] = _rms(rows)
        out[f"increment median {name}"] = _quantile(np.abs(rows), 0.5)
        out[f"increment p95 {name}"] = _quantile(np.abs(rows), 0.95)
        out[f"correlation {name}"] = _correlation(rows)
        bins = (f"{f} Hz {name}" for f in FFT_HZ)
        out |= zip(bins, _spectrum(loaded, chosen), strict=True)
    out["increment ratio"] = out["increment rms slip"] / (out["increment rms static"] or np.nan)
    out["deviation in slip"] = float(loaded[slip].std(axis=0).mean())
    out["highest excursion"] = _quantile(p.max(axis=1), 0.99)
    windows = np.lib.stride_tricks.sliding_window_view(p, 3, axis=0)
    low, high = windows.min(axis=-1), windows.max(axis=-1)
    plateau = (high - low <= 1) & (high < PLATEAU_COUNTS)
    out["share saturated"] = float(plateau.any(axis=1).mean())
    out["creep after a stop per s"] = _creep(t_s, loaded, slip)
    energy = energy_series(counts[:, None, :], ENERGY_SAMPLES)[ENERGY_SAMPLES:, 0]
    labels, away = slip[ENERGY_SAMPLES:], _edge_distance_ms(t_s, slip)[ENERGY_SAMPLES:]
    edges = zip((0.0, *EDGES_MS[:-1]), (np.inf, *EDGES_MS[1:]), strict=True)
    names = ("AUC of energy", *(f"AUC from {low:g} ms" for low in EDGES_MS[:-1]))
    for name, (nearest, furthest) in zip(names, edges, strict=True):
        chosen = (away >= nearest) & (away < furthest)
        value = auc(energy[chosen], labels[chosen])
        out[name] = np.nan if value is None else value
    return out


def _edge_distance_ms(t_s: Floats, labels: Bools) -> Floats:
    """Time (n,), ms, to the nearest change of the label, midway between two samples."""
    at = np.flatnonzero(labels[1:] != labels[:-1])
    edges = np.concatenate([[-np.inf], (t_s[at] + t_s[at + 1]) / 2.0, [np.inf]])
    after = np.searchsorted(edges, t_s)
    nearest: Floats = np.minimum(t_s - edges[after - 1], edges[after] - t_s) * 1e3
    return nearest


def _rms(x: Floats) -> float:
    return float(np.sqrt((x**2).mean())) if x.size else np.nan


def _quantile(x: Floats, share: float) -> float:
    return quantile(np.sort(x, axis=None), share) if x.size else np.nan


def _spectrum(loaded: Floats, chosen: Bools) -> list[float]:
    """Mean |FFT21|/20 over loaded taxels and all windows within one label, by FFT_HZ."""
    inside = np.convolve(chosen, np.ones(FFT_SAMPLES), "valid") == FFT_SAMPLES
    windows = np.lib.stride_tricks.sliding_window_view(loaded, FFT_SAMPLES, axis=0)[inside]
    amplitude = np.abs(np.fft.rfft(windows, axis=-1))[..., 1:] / (FFT_SAMPLES - 1)
    return amplitude.mean(axis=(0, 1)).tolist() if inside.any() else [np.nan] * len(FFT_HZ)


def _creep(t_s: Floats, loaded: Floats, slip: Bools) -> float:
    """Mean speed, counts/s, at which the most pressed taxel rises towards zero after a stop."""
    speeds = []
    for stop in np.flatnonzero(slip[:-1] & ~slip[1:]) + 1:
        after = slip[stop : stop + CREEP_SAMPLES]
        end = stop + (int(np.argmax(after)) if after.any() else CREEP_SAMPLES)
        if end - stop >= CREEP_SAMPLES // 2 and end <= len(t_s):
            rows = loaded[stop:end]
            taxel = rows[:, int(np.argmin(rows.mean(axis=0)))]
            if taxel.mean() < PRESSED_COUNTS:
                speeds.append(float(np.polyfit(t_s[stop:end] - t_s[stop], taxel, 1)[0]))
    return float(np.mean(speeds)) if speeds else np.nan


def _correlation(changes: Floats) -> float:
    """Mean correlation of increments over all pairs of loaded taxels."""
    if len(changes) < 3 or (changes.std(axis=0) == 0.0).any():
        return np.nan
    matrix: Floats = np.atleast_2d(np.corrcoef(changes.T))
    return float(matrix[np.triu_indices(LOADED, 1)].mean())


def recording_statistics(setup: Setup, number: int, seed: int) -> list[Figures]:
    """Statistics of each simulated recording; those of a batch share the arm's vibration."""
    out: list[Figures] = []
    for first in range(0, number, BATCH):
        n = min(BATCH, number - first)
        t_s, counts, slip = simulate(setup, n, BATCH * SEEDS * seed + first)
        out += [signal_statistics(t_s, each, slip) for each in counts]
    return out


def mean(of: Sequence[Figures]) -> Figures:
    """Mean of each statistic over the recordings that have it; NaN if none has."""
    found = {name: [f[name] for f in of if np.isfinite(f[name])] for name in of[0]}
    return {name: float(np.mean(each)) if each else np.nan for name, each in found.items()}


def error_in_aims(name: str, aim: float, real: float, simulated: float) -> float:
    """Deviation over the tolerance."""
    if name.startswith(DIFFERENCES):
        return (simulated - real) / aim
    return math.log(max(simulated, 1e-3) / max(real, 1e-3)) / math.log(aim)


def misfit(real: Figures, simulated: Figures) -> float:
    """Root mean square over the groups of the mean squared error over tolerance."""
    groups: dict[str, list[float]] = {}
    for group, aim, names in AIMS:
        for name in names:
            if np.isfinite(real[name]):
                value = simulated[name]
                error = error_in_aims(name, aim, real[name], value) if np.isfinite(value) else 5.0
                groups.setdefault(group, []).append(min(error**2, 100.0))
    return float(np.sqrt(np.mean([np.mean(errors) for errors in groups.values()])))


def fit(real: Figures, seed: int) -> Setup:
    """Parameters found by the search."""
    rng = np.random.default_rng(seed)
    low, high = np.log(np.array(list(BOUNDS.values()))).T
    centre, spread = (low + high) / 2, (high - low) / 3
    plan = [(sets, number) for n, sets, number in ROUNDS for _ in range(n)]
    for r, (tries, number) in enumerate(plan):
        sets = np.clip(centre + spread * rng.standard_normal((tries, len(low))), low, high)
        sets[0] = centre
        setups = [setup_at(values) for values in sets]
        errors = [
            misfit(real, mean(recording_statistics(each, number, FIT_SEED + r))) for each in setups
        ]
        kept = sets[np.argsort(errors)[: max(2, round(KEPT_SHARE * tries))]]
        centre = 0.2 * centre + 0.8 * kept.mean(axis=0)
        spread = np.maximum(0.3 * spread + 0.7 * kept.std(axis=0), (high - low) / 200)
    return setup_at(centre)


def setup_at(logarithms: Floats) -> Setup:
    values = zip(BOUNDS, np.exp(logarithms).tolist(), strict=True)
    return with_values(Setup(), {key: float(f"{value:.3g}") for key, value in values})


class Task(msgspec.Struct, frozen=True):
    """A search, or with ``check`` an evaluation of the built-in values."""

    recording: str
    check: bool
    simulations: int
    seed: int


class Row(msgspec.Struct, frozen=True):
    """Fitted parameters, and their statistics."""

    misfit: float
    statistics: list[list[str | float]]  # by COLUMNS
    parameters: dict[str, float]


def _trial(task: Task) -> Row:
    recording = read(Path(task.recording))
    if recording.fingers != 1 or recording.slip.all() or not recording.slip.any():
        raise BadFile(task.recording, "needs one fingertip with samples of slip and of rest",
                      "give one fingertip's labelled strokes with pauses between them")  # fmt: skip
    real = signal_statistics(recording.t_s, recording.counts[:, 0], recording.slip)
    setup = Setup() if task.check else fit(real, task.seed)
    simulated = recording_statistics(setup, task.simulations, VALIDATION_SEED)
    average = mean(simulated)
    statistics: list[list[str | float]] = []
    for name, aim in ((name, aim) for _, aim, names in AIMS for name in names):
        if np.isfinite(real[name]):
            values = np.array([each[name] for each in simulated if np.isfinite(each[name])])
            between = _quantile(values, 0.1), _quantile(values, 0.9)
            error = error_in_aims(name, aim, real[name], average[name])
            statistics.append([name, real[name], average[name], *between, error])
    tree = msgspec.to_builtins(setup)
    parameters = {key: tree[key.split(".")[0]][key.split(".")[1]] for key in BOUNDS}
    return Row(misfit(real, average), statistics, parameters)


def _table(rows: Sequence[Row]) -> str:
    """Statistics, and the fingertip's values as a settings file with the strokes as comments."""
    (row,) = rows
    columns = zip(COLUMNS, zip(*row.statistics, strict=True), strict=True)
    text = f"misfit {row.misfit:.2f}\n\n{markdown(dict(columns))}\n\n```toml\n[fingertip]\n"
    for key, value in row.parameters.items():
        name = key.replace("fingertip.", "").replace("strokes.", "# strokes: ")
        text += f"{name} = {value}\n"
    return text + "```"


def _grid(args: argparse.Namespace) -> list[Task]:
    return [Task(str(args.recording.resolve()), args.check, args.simulations, args.seed)]


def _options(parser: Parser) -> None:
    parser.add_argument("--recording", type=Path, required=True, metavar="FILE",
                        help="one fingertip, columns t_s,p0,p1,...,slip")  # fmt: skip
    parser.add_argument("--check", action="store_true",
                        help="evaluate the built-in values without a search")  # fmt: skip
    parser.add_argument("--simulations", type=whole(2, 100_000), default=48, metavar="N",
                        help="recordings in the result (default: %(default)s)")  # fmt: skip
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N",
                        help="of the search (default: %(default)s)")  # fmt: skip


STUDY = Study(
    summary="the simulated fingertip fitted to a real recording",
    grid=_grid, trial=_trial, row=Row, table=_table, options=_options,
)  # fmt: skip
