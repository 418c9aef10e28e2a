"""Decision rules that turn slip probabilities, sample by sample, into registered slip events."""

import math
from operator import or_
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

MAX_LOG_ODDS = 7.0  # an error in a thousand samples: no detector is calibrated beyond that
MAX_LIMIT = 200.0
MIN_PROBABILITY = 1.0 / (1.0 + math.exp(MAX_LOG_ODDS))
UNUSED = {"consecutive": {"drift", "limit"}, "cusum": {"consecutive"}, "either": set[str]()}


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Evidence that starts a slip event, and quiet samples that end it."""

    kind: Annotated[
        Literal["consecutive", "cusum", "either"],
        Meta(description="count samples above threshold (paper), sum log-odds (Page), or either"),
    ] = "consecutive"
    fusion: Annotated[
        Literal["any", "mean"],
        Meta(description="each finger decides alone, or the mean of their log-odds decides"),
    ] = "any"
    consecutive: Annotated[
        int, Meta(ge=1, le=50, description="samples in a row above threshold that register slip")
    ] = 2  # the paper's
    threshold: Annotated[
        float, Meta(gt=0.0, lt=1.0, description="probability above which a sample counts as slip")
    ] = 0.5  # the class border of the paper's two-way softmax
    drift: Annotated[
        float,
        Meta(ge=-5.0, le=5.0, description="sum: subtracted from the log-odds of every sample"),
    ] = 0.0
    limit: Annotated[
        float, Meta(gt=0.0, le=MAX_LIMIT, description="sum: total that registers slip")
    ] = 5.0  # assumed, tuned with `grasp detector tune`
    release: Annotated[
        int,
        Meta(ge=1, le=100, description="samples in a row at or below quiet that end a slip event"),
    ] = 3  # assumed
    quiet: Annotated[
        float, Meta(ge=0.0, lt=1.0, description="probability for release; 0: the threshold")
    ] = 0.0  # lower than the threshold, so that an event lasts as long as the slip

    @property
    def quiet_at(self) -> float:
        """Probability at or below which a sample is quiet."""
        return min(self.quiet, self.threshold) if self.quiet else self.threshold

    @property
    def unused(self) -> frozenset[str]:
        """Settings that this kind of rule does not use."""
        return frozenset(UNUSED[self.kind])


class DecisionRule:
    """Registers slip events, and on which fingers.

    ``consecutive``: an event starts after so many samples in a row above the threshold. ``cusum``:
    it starts when the sum of log-odds minus drift, never below zero, exceeds the limit (Page's
    test). ``either``: by any of the two; the sum finds slip of low probability that lasts. It ends
    after ``release`` samples in a row at or below ``quiet`` on all fingers; sums then restart.

    With fusion ``mean`` the rule uses the mean log-odds of all fingers, and the event is assigned
    to the finger with the highest probability.
    """

    def __init__(self, settings: RuleSettings, fingers: int) -> None:
        self.settings = settings
        self.threshold, self._quiet_at = settings.threshold, settings.quiet_at
        self._mean = settings.fusion == "mean"
        self._deciding = 1 if self._mean else fingers
        self.reset()

    def reset(self) -> None:
        """Clear all state."""
        self.registered = False  # True from registration to release
        self.interrupt()

    def interrupt(self) -> None:
        """Restart runs and sums after a gap in the samples; a registered event continues."""
        self._runs = [0] * self._deciding
        self._sums = [0.0] * self._deciding
        self._quiet = 0

    def update(self, probabilities: list[float]) -> list[bool]:
        """Take a probability of each finger; return whether each finger registers slip now."""
        p = [_mean_probability(probabilities)] if self._mean else probabilities
        above = [each > self.threshold for each in p]
        self._quiet = 0 if any(each > self._quiet_at for each in p) else self._quiet + 1
        registering = [False] * len(p) if self.settings.kind == "cusum" else self._count(above)
        if self.settings.kind != "consecutive":
            registering = list(map(or_, registering, self._sum(p)))
        if any(registering):
            self.registered = True
        elif self._quiet >= self.settings.release:
            self.registered = False
        if not self._mean:
            return registering
        fingers = [False] * len(probabilities)
        fingers[highest(probabilities)] = registering[0]
        return fingers

    def _count(self, above: list[bool]) -> list[bool]:
        self._runs = [run + 1 if high else 0 for run, high in zip(self._runs, above, strict=True)]
        return [run >= self.settings.consecutive for run in self._runs]

    def _sum(self, p: list[float]) -> list[bool]:
        drift, again = self.settings.drift, self._quiet >= self.settings.release
        self._sums = [
            0.0 if again else max(total + (_log_odds(each) - drift), 0.0)
            for total, each in zip(self._sums, p, strict=True)
        ]
        return [total > self.settings.limit for total in self._sums]


def highest(values: list[float]) -> int:
    """Index of the highest value, the first of equal ones; NaN is the lowest."""
    known = [-math.inf if math.isnan(each) else each for each in values]
    return known.index(max(known))


# of one sample: numpy takes fifty times as long for a handful of numbers
def _log_odds(probability: float) -> float:
    """`log_odds` of one number."""
    if math.isnan(probability):
        return 0.0
    p = min(max(probability, MIN_PROBABILITY), 1.0 - MIN_PROBABILITY)
    return math.log(p / (1.0 - p))


def _mean_probability(probabilities: list[float]) -> float:
    """`fused` of one sample, by the mean log-odds."""
    odds = sum(map(_log_odds, probabilities)) / len(probabilities)
    return 1.0 / (1.0 + math.exp(-odds))


def log_odds(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log-odds, limited to +-MAX_LOG_ODDS; 0 for NaN."""
    known = np.where(np.isnan(probabilities), 0.5, probabilities)
    p = np.clip(known, MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
    odds: NDArray[np.float64] = np.log(p / (1.0 - p))
    return odds


def registered_events(
    probabilities: NDArray[np.float64], settings: RuleSettings
) -> NDArray[np.intp]:
    """Events (m, 2) that `DecisionRule` registers in a whole stream (n, fingers): the sample of
    registration and the sample of release, n if it was never released."""
    return events_of(fused(probabilities, settings), settings)


def fused(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.float64]:
    """Probabilities that the rule compares: (n, fingers), or (n, 1) for the mean log-odds."""
    if settings.fusion != "mean":
        return probabilities
    odds = log_odds(probabilities).mean(axis=1, keepdims=True)
    mean: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-odds))
    return mean


def events_of(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.intp]:
    """`registered_events` for the result of `fused`."""
    above = np.greater(probabilities, settings.threshold)
    quiet = _quiet(np.greater(probabilities, settings.quiet_at), settings.release)
    registering = np.zeros(len(probabilities), np.bool_)
    if settings.kind != "cusum":
        registering |= _any(_run_lengths(above) >= settings.consecutive)
    if settings.kind != "consecutive":
        registering |= _any(cusum(probabilities, settings) > settings.limit)
    starts = _first_of_each(registering, quiet)
    ends = np.append(_first_of_each(quiet, registering), len(probabilities))
    return np.column_stack([starts, ends[np.searchsorted(ends, starts)]])


def cusum(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.float64]:
    """Sums (n, fingers) of the rule `cusum`, independent of its limit."""
    quiet = _quiet(np.greater(probabilities, settings.quiet_at), settings.release)
    evidence = log_odds(probabilities) - settings.drift
    sums = np.zeros_like(evidence)
    edges = np.flatnonzero(np.diff(quiet, prepend=True, append=True))
    for first, after in edges.reshape(-1, 2):  # intervals without a restart
        total = np.cumsum(evidence[first:after], axis=0)
        sums[first:after] = total - np.minimum(np.minimum.accumulate(total, axis=0), 0.0)
    return sums


def _any(fingers: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Samples (n,) in which any of (n, fingers) is true."""
    some: NDArray[np.bool_] = np.logical_or.reduce(fingers, axis=1)
    return some


def _quiet(above: NDArray[np.bool_], release: int) -> NDArray[np.bool_]:
    """Samples (n,) that end a run of at least ``release`` samples below on all fingers."""
    quiet: NDArray[np.bool_] = _run_lengths(~_any(above)[:, None])[:, 0] >= release
    return quiet


def _run_lengths(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Length of the run of True that ends at each sample of (n, fingers)."""
    position = np.arange(1, len(flags) + 1)[:, None]
    last_off = np.maximum.accumulate(np.where(flags, 0, position), axis=0)
    lengths: NDArray[np.intp] = position - last_off
    return lengths


def _first_of_each(these: NDArray[np.bool_], others: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Indices of the first True in ``these`` (n,), and of the first after each of ``others``."""
    marked = np.flatnonzero(these | others)
    kind = these[marked]
    first = kind & ~np.concatenate([[False], kind[:-1]])
    starts: NDArray[np.intp] = marked[first]
    return starts
