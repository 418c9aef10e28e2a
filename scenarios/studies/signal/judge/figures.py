"""The statistics by which pieces of recordings are set beside the real clip.

Each is a number of one piece, in rest, in slip, or of the load (the sum of all taxels) over both.
The two taxels whose increments vary most within a run count as busy. docs/fingertip.md says what
each has found wrong.
"""

from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.energy import energy_series
from detector.scores.metrics import auc
from detector.scores.quantiles import quantile
from scenarios.studies.signal.judge.pieces import Piece

BUSY, ACTIVE = 2, 3
FFT_SAMPLES = 21  # the authors' own window for vibration energy: bins 5, 10, ... Hz at 100 Hz
BINS_HZ = (5, 10, 15, 20)
CREEP_SAMPLES = 20  # of a pause, from its begin
ENERGY_WINDOW = 10
SIXTHS = 6
NOISE = 0.3  # counts: two values that differ less are alike on a logarithmic scale
Floats = NDArray[np.float64]
Group = Literal["rest", "slip", "load"]


class Statistic(msgspec.Struct, frozen=True):
    """One figure of a piece. Amplitudes are compared as logarithms, the others as they are."""

    name: str
    group: Group
    logarithmic: bool

    def scale(self, values: Floats) -> Floats:
        """Values on the scale on which widths are compared."""
        out: Floats = np.log(np.maximum(values, 0.0) + NOISE) if self.logarithmic else values
        return out


def _statistics() -> tuple[Statistic, ...]:
    of: dict[Group, tuple[str, str]] = {
        # amplitudes | correlations, shares and levels
        "rest": (
            "mean step|95 % step|10 Hz|15 Hz|20 Hz|25-50 Hz|5 Hz|creep|quietest deviation",
            "busy pair|closest pair|one component|second over first|lag 1",
        ),
        "slip": (
            "mean step|99 % step|largest step|5 Hz|10 Hz|15 Hz|20 Hz|25-50 Hz|quietest deviation",
            "three taxels|lag 1|active taxels|first half|last third|highest|lowest|AUC|repeat",
        ),
        "load": (
            "pause to pause|same direction|within a stroke|comes and goes",
            "deviation over mean",
        ),
    }
    return tuple(
        Statistic(f"{group}: {name}", group, column == 0)
        for group, columns in of.items()
        for column, names in enumerate(columns)
        for name in names.split("|")
    )


STATISTICS = _statistics()


def figures_of(piece: Piece) -> dict[str, float]:
    """Every statistic by name; nan where the piece has nothing to show."""
    out = {**_rest(piece.of("pause")), **_slip(piece), **_load(piece)}
    return {s.name: out.get(s.name, np.nan) for s in STATISTICS}


def table(pieces: Sequence[Piece]) -> dict[str, Floats]:
    """Statistics by name, (pieces,) each."""
    rows = [figures_of(p) for p in pieces]
    return {s.name: np.array([row[s.name] for row in rows]) for s in STATISTICS}


def busiest(counts: Floats, many: int) -> Floats:
    """(n, many) columns whose increments vary most, the busiest first."""
    order = np.argsort(-np.diff(counts, axis=0).std(axis=0), kind="stable")
    return counts[:, order[:many]]


def _mean(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.mean(known)) if known else np.nan


def _pair(changes: Floats) -> Floats:
    """Correlations (pairs,) of columns that change at all."""
    changes = changes[:, changes.std(axis=0) > 0.0]
    if changes.shape[1] < 2:
        return np.zeros(0)
    matrix: Floats = np.atleast_2d(np.corrcoef(changes.T))
    out: Floats = matrix[np.triu_indices(len(matrix), 1)]
    return out


def lag_one(changes: Floats) -> float:
    """Correlation of an increment with the next one, over all columns."""
    centred = changes - changes.mean(axis=0)
    power = float((centred**2).sum())
    return float((centred[1:] * centred[:-1]).sum()) / power if power else np.nan


def spectrum(counts: Floats) -> Floats:
    """(10,) mean |FFT21| / 20 at 5 to 50 Hz over all windows and columns; nan if too short."""
    if len(counts) < FFT_SAMPLES:
        return np.full(FFT_SAMPLES // 2, np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(counts, FFT_SAMPLES, axis=0)
    amplitude: Floats = np.abs(np.fft.rfft(windows, axis=-1))[..., 1:] / (FFT_SAMPLES - 1)
    out: Floats = amplitude.mean(axis=(0, 1))
    return out


def _lines(group: str, runs: Sequence[Floats]) -> dict[str, float]:
    """The spectrum's figures, mean over runs."""
    rows = np.array([spectrum(busiest(run, BUSY)) for run in runs])
    rows = rows[np.isfinite(rows).all(axis=1)] if len(rows) else rows
    if not len(rows):
        return {}
    mean = rows.mean(axis=0)
    out = {f"{group}: {hz} Hz": float(mean[k]) for k, hz in enumerate(BINS_HZ)}
    out[f"{group}: 25-50 Hz"] = float(mean[len(BINS_HZ) :].mean())
    return out


def _rest(pauses: Sequence[Floats]) -> dict[str, float]:
    if not pauses:
        return {}
    found: dict[str, list[float]] = {}

    def note(name: str, value: float) -> None:
        found.setdefault(f"rest: {name}", []).append(value)

    steps = np.concatenate([np.abs(np.diff(run, axis=0)) for run in pauses])
    for run in pauses:
        changes = np.diff(run, axis=0)
        busy = np.diff(busiest(run, BUSY), axis=0)
        pairs = _pair(changes)
        spread = np.linalg.svd(changes - changes.mean(axis=0), compute_uv=False) ** 2
        note("busy pair", float(_pair(busy)[0]) if len(_pair(busy)) else np.nan)
        note("closest pair", float(pairs.max()) if len(pairs) else np.nan)
        note("one component", float(spread[0] / spread.sum()) if spread.sum() else np.nan)
        size = float(np.sqrt((busy**2).mean()))
        second = float(np.sqrt((np.diff(busy, axis=0) ** 2).mean()))
        note("second over first", second / size if size else np.nan)
        note("lag 1", lag_one(busy))
        begin = run[:CREEP_SAMPLES]
        note("creep", float(np.abs(begin[-5:].mean(axis=0) - begin[:5].mean(axis=0)).max()))
        note("quietest deviation", float(run.std(axis=0).min()))
    out = {name: _mean(values) for name, values in found.items()}
    out["rest: mean step"] = float(steps.mean())
    out["rest: 95 % step"] = quantile(np.sort(steps, axis=None), 0.95)
    return out | _lines("rest", pauses)


def _slip(piece: Piece) -> dict[str, float]:
    strokes = piece.of("stroke")
    if not strokes:
        return {}
    steps = np.concatenate([np.abs(np.diff(run, axis=0)) for run in strokes])
    busy = np.sort(np.concatenate([np.abs(np.diff(busiest(r, BUSY), axis=0)) for r in strokes]))
    sixths = np.mean([_sixths(run) for run in strokes], axis=0)
    variance = np.sort(np.mean([run.var(axis=0) for run in strokes], axis=0))[::-1]
    out = {
        "mean step": float(steps.mean()),
        "99 % step": quantile(np.sort(busy, axis=None), 0.99),
        "largest step": float(busy.max()),
        "quietest deviation": _mean([float(run.std(axis=0).min()) for run in strokes]),
        "three taxels": float(variance[:ACTIVE].sum() / variance.sum()),
        "lag 1": _mean([lag_one(np.diff(busiest(run, BUSY), axis=0)) for run in strokes]),
        # of levels, not of increments: do they rise and fall together within a stroke?
        "active taxels": _mean([float(_pair(busiest(run, ACTIVE)).mean()) for run in strokes]),
        "first half": float(sixths[: SIXTHS // 2].sum()),
        "last third": float(sixths[-2:].sum()),
        "highest": quantile(np.sort(piece.counts.max(axis=1)), 0.99),
        "lowest": quantile(np.sort(piece.counts.min(axis=1)), 0.01),
        "AUC": _contrast(piece),
        "repeat": _repeat(strokes),
    }
    return {f"slip: {k}": v for k, v in out.items()} | _lines("slip", strokes)


def _sixths(run: Floats) -> Floats:
    """(6,) share of the squared increments in each sixth of a stroke."""
    energy = (np.diff(run, axis=0) ** 2).sum(axis=1)
    parts = np.array([part.sum() for part in np.array_split(energy, SIXTHS)])
    out: Floats = parts / max(parts.sum(), 1e-9)
    return out


def _repeat(strokes: Sequence[Floats]) -> float:
    """Correlation of the changes in strokes of equal direction, which follow each other by two."""
    values = []
    for first, again in zip(strokes, strokes[2:], strict=False):
        n = min(len(first), len(again))
        a, b = np.diff(first[:n], axis=0), np.diff(again[:n], axis=0)
        smooth = [_running(x, 5) for x in (a, b)]
        values.append(float(np.corrcoef(smooth[0].ravel(), smooth[1].ravel())[0, 1]))
    return _mean(values)


def _running(x: Floats, many: int) -> Floats:
    total = np.cumsum(x, axis=0)
    out: Floats = total[many:] - total[:-many]
    return out


def _contrast(piece: Piece) -> float:
    """AUC of the mean absolute change over 0.1 s for the label."""
    energy = energy_series(piece.counts[:, None, :].astype(np.int16), ENERGY_WINDOW)
    value = auc(energy[ENERGY_WINDOW:, 0], piece.slip[ENERGY_WINDOW:])
    return np.nan if value is None else value


def pause_changes(piece: Piece) -> Floats:
    """Absolute changes of the load from each pause to the next, counts."""
    out: Floats = np.abs(np.diff([run.sum(axis=1).mean() for run in piece.of("pause")]))
    return out


def _load(piece: Piece) -> dict[str, float]:
    pauses = np.array([run.mean(axis=0) for run in piece.of("pause")])
    strokes = piece.of("stroke")
    if len(pauses) < 2 or not strokes:
        return {}
    total = pauses.sum(axis=1)
    out = {
        "pause to pause": float(np.median(pause_changes(piece))),
        "within a stroke": _mean([float(run.sum(axis=1).std()) for run in strokes]),
        "deviation over mean": float(total.std() / max(abs(total.mean()), 1.0)),
        # of the taxel that stands highest in any pause: is it there in all of them?
        "comes and goes": float(np.ptp(pauses[:, int(pauses.max(axis=0).argmax())])),
    }
    if len(total) > 2:
        out["same direction"] = float(np.median(np.abs(total[2:] - total[:-2])))
    return {f"load: {k}": v for k, v in out.items()}
