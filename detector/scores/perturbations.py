"""Recordings as another fingertip, or a broken one, would have made them.

Each is a pure function of counts, an amount and a generator; times and labels stay as they are,
but for `rate`. What is wrong is wrong from the first sample on, at every finger; a taxel that is
dead, stuck or swapped is one of the first finger, the one that is pressed most.
"""

from collections.abc import Callable, Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import COUNTS_LIMIT, Recording
from drivers.interfaces import PERIOD_S

NOISE_COUNTS = 0.65  # rms of a taxel of a run, before rounding (`fingertip.noise_counts`)
COUNTS_PER_K = 1.6  # of the barometer, as the simulation has it
RAIL_COUNTS = -450  # code 0, from the middle of the rest codes: no pressure takes a taxel further
WARM_S, WARMS_S = 4.0, 1.0  # between steps of temperature, and how long each takes
MIN_S = 60.0
Counts = NDArray[np.int16]  # (n, fingers, taxels)
Floats = NDArray[np.float64]


def gain(counts: Counts, factor: float, rng: np.random.Generator) -> Floats:
    """Another sensitivity; a taxel at its rail stays there."""
    changed: Floats = np.maximum(counts * factor, np.minimum(counts, RAIL_COUNTS))
    return changed


def noise(counts: Counts, factor: float, rng: np.random.Generator) -> Floats:
    """The board's noise so many times as large."""
    added = NOISE_COUNTS * np.sqrt(max(factor**2 - 1.0, 0.0))
    noisy: Floats = counts + added * rng.standard_normal(counts.shape)
    return noisy


def lost(counts: Counts, share: float, rng: np.random.Generator) -> Floats:
    """So many samples lost, each of which repeats the one before, as the driver does."""
    gone = rng.random(len(counts)) < share
    gone[0] = False
    latest = np.maximum.accumulate(np.where(gone, 0, np.arange(len(counts))))
    return counts[latest].astype(np.float64)


def temperature(counts: Counts, step_k: float, rng: np.random.Generator) -> Floats:
    """Warmer by so much and back again, every few seconds, within one second each."""
    t_s = np.arange(len(counts)) * PERIOD_S
    turn, into_s = np.divmod(t_s, WARM_S)
    towards = np.minimum(into_s / WARMS_S, 1.0)
    warm: Floats = np.where(turn % 2 == 0, towards, 1.0 - towards) * step_k * COUNTS_PER_K
    return counts + warm[:, None, None]


def drift(counts: Counts, per_min: float, rng: np.random.Generator) -> Floats:
    """Rest counts that wander steadily, each taxel's up or down."""
    way = rng.choice([-1.0, 1.0], counts.shape[1:])
    t_s = np.arange(len(counts)) * PERIOD_S
    drifted: Floats = counts + (t_s * per_min / MIN_S)[:, None, None] * way
    return drifted


def dead(counts: Counts, taxels: float, rng: np.random.Generator) -> Floats:
    """So many taxels read rest."""
    changed = counts.astype(np.float64)
    changed[:, 0, _pressed_most(counts)[: int(taxels)]] = 0.0
    return changed


def stuck(counts: Counts, taxels: float, rng: np.random.Generator) -> Floats:
    """So many taxels read what they do half of the time."""
    changed = counts.astype(np.float64)
    which = _pressed_most(counts)[: int(taxels)]
    changed[:, 0, which] = np.median(counts[:, 0, which], axis=0)
    return changed


def swapped(counts: Counts, taxels: float, rng: np.random.Generator) -> Floats:
    """So many taxels, pressed most, stand where those stand that are pressed least."""
    order = _pressed_most(counts)
    moved, to = order[: int(taxels)], order[::-1][: int(taxels)]
    changed = counts.astype(np.float64)
    changed[:, 0, moved], changed[:, 0, to] = counts[:, 0, to], counts[:, 0, moved]
    return changed


def _pressed_most(counts: Counts) -> NDArray[np.intp]:
    """Taxels of the first finger, the one with the largest pressure in the mean first."""
    order: NDArray[np.intp] = np.argsort(counts[:, 0].mean(axis=0), kind="stable")
    return order


PERTURBATIONS: Mapping[str, Callable[[Counts, float, np.random.Generator], Floats]] = {
    "gain": gain, "noise": noise, "lost": lost, "temperature": temperature, "drift": drift,
    "dead": dead, "stuck": stuck, "swapped": swapped,
}  # fmt: skip
RATE = "rate"


def perturbed(recording: Recording, kind: str, amount: float, seed: int = 0) -> Recording:
    """The recording with one thing wrong: a name of `PERTURBATIONS`, or `rate`, samples a second.

    Equal seeds give equal recordings. Raises KeyError for an unknown name.
    """
    if kind == RATE:
        return at_rate(recording, amount)
    changed = PERTURBATIONS[kind](recording.counts, amount, np.random.default_rng(seed))
    return msgspec.structs.replace(recording, counts=_counts(changed))


def _counts(values: Floats) -> Counts:
    return np.clip(np.rint(values), -COUNTS_LIMIT, COUNTS_LIMIT).astype(np.int16)


def at_rate(recording: Recording, hertz: float) -> Recording:
    """As sampled so often: counts on the straight line between two samples, which takes some of
    their noise away; the rest of each sample is that of the latest one before."""
    t_s = recording.t_s
    new_s = np.arange(t_s[0], t_s[-1], 1.0 / hertz)
    before = np.searchsorted(t_s, new_s, side="right") - 1
    after = np.minimum(before + 1, len(t_s) - 1)
    part = (new_s - t_s[before]) / np.maximum(t_s[after] - t_s[before], 1e-9)
    first, second = (recording.counts[k].astype(np.float64) for k in (before, after))
    changed = {
        name: value[before]
        for name in recording.__struct_fields__
        if isinstance(value := getattr(recording, name), np.ndarray)
    }
    changed |= {
        "t_s": new_s,
        "counts": _counts(first + (second - first) * part[:, None, None]),
    }
    return msgspec.structs.replace(recording, **changed)
