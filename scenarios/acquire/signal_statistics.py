"""What a fingertip's signal is like, in numbers, of one labelled recording.

Arrays in, numbers out, so that a real clip and a simulated one are judged alike. The three taxels
that vary most count as loaded, the one that varies least as idle.
"""

import numpy as np
from numpy.typing import NDArray

from detector.energy import energy_series
from detector.scores.metrics import auc, edge_distance_ms
from detector.scores.quantiles import quantile

LOADED, IDLE = 3, 1
ENERGY_WINDOW = 10  # samples: energy is the mean absolute change over 100 ms
FFT_SAMPLES = 21  # the authors' own window for vibration energy
FFT_HZ = tuple(range(5, 55, 5))  # its bins at 100 Hz, by their rounded names
PLATEAU_COUNTS, PLATEAU_SAMPLES = -380, 3
PRESSED_COUNTS = -40
CREEP_SAMPLES = 35  # after a stop
EDGE_BINS_MS = ((0.0, 50.0), (50.0, 100.0), (100.0, 200.0), (200.0, np.inf))
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def signal_statistics(t_s: Floats, counts: NDArray[np.int16], slip: Bools) -> dict[str, float]:
    """Named figures of one fingertip's recording: (n,) times, (n, taxels) counts, (n,) labels.

    Units are counts unless the name says otherwise; nan where the recording has nothing to show.
    """
    p = counts.astype(np.float64)
    order = np.argsort(p.std(axis=0))
    loaded = p[:, np.sort(order[-LOADED:])]
    changes = np.diff(loaded, axis=0)
    sliding, static = slip[1:] & slip[:-1], ~slip[1:] & ~slip[:-1]
    idle = np.diff(p[:, order[:IDLE]], axis=0)[static]
    out = {"idle noise": _rms(idle) / np.sqrt(2)}
    for name, rows in (("static", changes[static]), ("slip", changes[sliding])):
        out[f"increment rms {name}"] = _rms(rows)
        out[f"increment median {name}"] = _quantile(np.abs(rows), 0.5)
        out[f"increment p95 {name}"] = _quantile(np.abs(rows), 0.95)
    quiet = out["increment rms static"]
    out["increment ratio"] = out["increment rms slip"] / quiet if quiet else np.nan
    out["deviation in slip"] = float(loaded[slip].std(axis=0).mean()) if slip.any() else np.nan
    for name, label in (("static", False), ("slip", True)):
        spectrum = _spectrum(loaded, slip == label)
        out.update({f"{f} Hz {name}": float(a) for f, a in zip(FFT_HZ, spectrum, strict=True)})
    out["highest excursion"] = _quantile(p.max(axis=1), 0.99)
    out["share saturated"] = _saturated(p)
    out["creep after a stop per s"] = _creep(t_s, loaded, slip)
    out["correlation static"] = _correlation(changes[static])
    out["correlation slip"] = _correlation(changes[sliding])
    out.update(_contrast(t_s, counts, slip))
    return out


def _rms(x: Floats) -> float:
    return float(np.sqrt((x**2).mean())) if x.size else np.nan


def _quantile(x: Floats, share: float) -> float:
    return quantile(np.sort(x, axis=None), share) if x.size else np.nan


def _spectrum(loaded: Floats, chosen: Bools) -> Floats:
    """(10,) mean |FFT21|/20 over loaded taxels and all windows that lie within one label."""
    whole = np.convolve(chosen, np.ones(FFT_SAMPLES), "valid") == FFT_SAMPLES
    if not whole.any():
        return np.full(len(FFT_HZ), np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(loaded, FFT_SAMPLES, axis=0)[whole]
    amplitude = np.abs(np.fft.rfft(windows, axis=-1))[..., 1:] / (FFT_SAMPLES - 1)
    out: Floats = amplitude.mean(axis=(0, 1))
    return out


def _saturated(p: Floats) -> float:
    """Share of samples with some taxel in a plateau far below rest: equal to within a count."""
    windows = np.lib.stride_tricks.sliding_window_view(p, PLATEAU_SAMPLES, axis=0)
    low, high = windows.min(axis=-1), windows.max(axis=-1)
    flat: Bools = (high - low <= 1) & (high < PLATEAU_COUNTS)
    return float(flat.any(axis=1).mean())


def _creep(t_s: Floats, loaded: Floats, slip: Bools) -> float:
    """Mean speed, counts/s, at which the most pressed taxel rises towards zero after a stop."""
    speeds = []
    for stop in np.flatnonzero(slip[:-1] & ~slip[1:]) + 1:
        end = stop + CREEP_SAMPLES
        after = slip[stop:end]
        if after.any():
            end = stop + int(np.argmax(after))
        if end - stop >= CREEP_SAMPLES // 2 and end <= len(t_s):
            taxel = int(np.argmin(loaded[stop:end].mean(axis=0)))
            if loaded[stop:end, taxel].mean() < PRESSED_COUNTS:
                speeds.append(_slope(t_s[stop:end], loaded[stop:end, taxel]))
    return float(np.mean(speeds)) if speeds else np.nan


def _slope(x: Floats, y: Floats) -> float:
    """Of the line that fits y (n,) over x (n,) best."""
    away = x - x.mean()
    return float((away * y).sum() / (away**2).sum())


def _correlation(changes: Floats) -> float:
    """Mean correlation of increments over all pairs of loaded taxels."""
    if len(changes) < 3 or (changes.std(axis=0) == 0.0).any():
        return np.nan
    matrix = np.atleast_2d(np.corrcoef(changes.T))
    pairs = matrix[np.triu_indices(changes.shape[1], 1)]
    return float(pairs.mean())


def _contrast(t_s: Floats, counts: NDArray[np.int16], slip: Bools) -> dict[str, float]:
    """AUC of energy for slip against static, overall and by distance to the label's edge."""
    energy = energy_series(counts[:, None, :], ENERGY_WINDOW)[ENERGY_WINDOW:, 0]
    labels = slip[ENERGY_WINDOW:]
    away = edge_distance_ms(t_s, slip)[ENERGY_WINDOW:]
    out = {"AUC of energy": _auc(energy, labels)}
    for low, high in EDGE_BINS_MS:
        chosen = (away >= low) & (away < high)
        name = f"AUC {low:g}-{high:g} ms" if np.isfinite(high) else f"AUC over {low:g} ms"
        out[name] = _auc(energy[chosen], labels[chosen])
    return out


def _auc(energy: Floats, labels: Bools) -> float:
    value = auc(energy, labels)
    return np.nan if value is None else value
