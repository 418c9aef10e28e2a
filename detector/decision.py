"""Decision rules: when do probabilities, sample by sample, amount to a registered slip event?"""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

MOST_LOG_ODDS = 7.0  # one sample in a thousand: no detector is calibrated beyond that
LEAST_PROBABILITY = 1.0 / (1.0 + math.exp(MOST_LOG_ODDS))


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How much evidence makes an event, and how many quiet samples end it."""

    # count samples above threshold (paper), or add up log-odds (Page 1954)
    kind: Literal["consecutive", "cusum"] = "consecutive"
    # each finger decides alone, or the mean of their log-odds does
    fusion: Literal["any", "mean"] = "any"
    consecutive: Annotated[
        int, Meta(ge=1, le=50, description="samples in a row above threshold that register slip")
    ] = 2  # the paper's
    threshold: Annotated[
        float, Meta(gt=0.0, lt=1.0, description="probability above which a sample counts")
    ] = 0.5  # the class border of the paper's two-way softmax
    drift: Annotated[
        float, Meta(ge=-5.0, le=5.0, description="cusum: log-odds a sample that are no evidence")
    ] = 0.0
    limit: Annotated[
        float, Meta(gt=0.0, le=200.0, description="cusum: summed log-odds that register slip")
    ] = 5.0  # assumed, tuned with `grasp detector tune`
    release: Annotated[
        int, Meta(ge=1, le=100, description="samples in a row below threshold that end an event")
    ] = 3  # assumed

    @property
    def unread(self) -> frozenset[str]:
        """The settings that this kind of rule has no use for."""
        return frozenset({"drift", "limit"} if self.kind == "consecutive" else {"consecutive"})


class DecisionRule:
    """When slip is registered, and on which fingers.

    ``consecutive``: after so many samples in a row above the threshold. ``cusum``: when the sum of
    log-odds beyond the drift, never below zero, exceeds the limit (Page's test). After ``release``
    samples in a row at or below the threshold on all fingers the event ends, and the sums restart.

    With fusion ``mean`` one rule decides on the mean log-odds of all fingers; the one with the
    highest probability registers.
    """

    def __init__(self, settings: RuleSettings, fingers: int) -> None:
        self.settings = settings
        self.threshold = settings.threshold
        self._mean = settings.fusion == "mean"
        self._deciding = 1 if self._mean else fingers
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.registered = False  # between registration and release
        self.interrupt()

    def interrupt(self) -> None:
        """Samples are left out here: runs and sums restart, what is registered stays so."""
        self._runs = [0] * self._deciding
        self._sums = np.zeros(self._deciding)
        self._quiet = 0

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Take (fingers,) probabilities; give which fingers (fingers,) register slip now."""
        p = mean_probability(probabilities[None])[0] if self._mean else probabilities
        above: list[bool] = (p > self.threshold).tolist()
        self._quiet = 0 if any(above) else self._quiet + 1
        registering = self._sum(p) if self.settings.kind == "cusum" else self._count(above)
        if any(registering):
            self.registered = True
        elif self._quiet >= self.settings.release:
            self.registered = False
        if not self._mean:
            return np.array(registering)
        fingers = np.zeros(len(probabilities), np.bool_)
        fingers[np.nan_to_num(probabilities, nan=-1.0).argmax()] = registering[0]
        return fingers

    def _count(self, above: list[bool]) -> list[bool]:
        self._runs = [run + 1 if high else 0 for run, high in zip(self._runs, above, strict=True)]
        return [run >= self.settings.consecutive for run in self._runs]

    def _sum(self, p: NDArray[np.float64]) -> list[bool]:
        self._sums = np.maximum(self._sums + (log_odds(p) - self.settings.drift), 0.0)
        if self._quiet >= self.settings.release:
            self._sums[:] = 0.0
        registering: list[bool] = (self._sums > self.settings.limit).tolist()
        return registering


def log_odds(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log-odds, limited to what a detector can be believed."""
    # np.clip takes three times as long for a handful of numbers
    known = np.where(np.isnan(probabilities), 0.5, probabilities)  # no number: no evidence
    p = np.minimum(np.maximum(known, LEAST_PROBABILITY), 1.0 - LEAST_PROBABILITY)
    odds: NDArray[np.float64] = np.log(p / (1.0 - p))
    return odds


def mean_probability(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability (n, 1) of the mean log-odds of (n, fingers)."""
    odds = log_odds(probabilities).mean(axis=1, keepdims=True)
    fused: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-odds))
    return fused


def registered_events(
    probabilities: NDArray[np.float64], settings: RuleSettings
) -> NDArray[np.intp]:
    """Events (m, 2) of a whole stream (n, fingers), as `DecisionRule` would register them: the
    sample that registered slip and the one that released it, n if none did."""
    return events_of(fused(probabilities, settings), settings)


def fused(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.float64]:
    """What decides of (n, fingers): each finger, or (n, 1) the mean of their log-odds."""
    return mean_probability(probabilities) if settings.fusion == "mean" else probabilities


def events_of(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.intp]:
    """`registered_events` of probabilities that are fused already, where the rule asks for it."""
    above = np.greater(probabilities, settings.threshold)
    quiet = _quiet(above, settings.release)
    if settings.kind == "cusum":
        registering = _any(cusum(probabilities, settings) > settings.limit)
    else:
        registering = _any(_run_lengths(above) >= settings.consecutive)
    starts = _first_of_each(registering, quiet)
    ends = np.append(_first_of_each(quiet, registering), len(probabilities))
    return np.column_stack([starts, ends[np.searchsorted(ends, starts)]])


def cusum(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.float64]:
    """Sums (n, fingers) of the rule `cusum`; they do not depend on its limit."""
    quiet = _quiet(np.greater(probabilities, settings.threshold), settings.release)
    evidence = log_odds(probabilities) - settings.drift
    sums = np.zeros_like(evidence)
    edges = np.flatnonzero(np.diff(quiet, prepend=True, append=True))
    for first, after in edges.reshape(-1, 2):  # stretches in which no sum restarts
        total = np.cumsum(evidence[first:after], axis=0)
        sums[first:after] = total - np.minimum(np.minimum.accumulate(total, axis=0), 0.0)
    return sums


def _any(fingers: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Samples (n,) on which any of (n, fingers) is true."""
    some: NDArray[np.bool_] = np.logical_or.reduce(fingers, axis=1)
    return some


def _quiet(above: NDArray[np.bool_], release: int) -> NDArray[np.bool_]:
    """Samples (n,) up to which all fingers have been below for long enough."""
    quiet: NDArray[np.bool_] = _run_lengths(~_any(above)[:, None])[:, 0] >= release
    return quiet


def _run_lengths(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """How many flags in a row, along the first axis, end at each place of (n, fingers)."""
    position = np.arange(1, len(flags) + 1)[:, None]
    last_off = np.maximum.accumulate(np.where(flags, 0, position), axis=0)
    lengths: NDArray[np.intp] = position - last_off
    return lengths


def _first_of_each(these: NDArray[np.bool_], others: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Where one of these (n,) comes first, or first since one of the others."""
    marked = np.flatnonzero(these | others)
    kind = these[marked]
    first = kind & ~np.concatenate([[False], kind[:-1]])
    begins: NDArray[np.intp] = marked[first]
    return begins
