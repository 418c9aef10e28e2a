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

    kind: Annotated[
        Literal["consecutive", "cusum"],
        Meta(description="count samples above threshold (paper), or add up log-odds (Page 1954)"),
    ] = "consecutive"
    fusion: Annotated[
        Literal["any", "mean"],
        Meta(description="each finger decides alone, or the mean of their log-odds does"),
    ] = "any"
    consecutive: Annotated[
        int,
        Meta(ge=1, le=50, description="consecutive samples above threshold, of one finger or "
             "of the mean, that register slip (paper: 2)"),
    ] = 2  # fmt: skip
    threshold: Annotated[
        float,
        Meta(gt=0.0, lt=1.0, description="probability above which a sample counts, of a finger or "
             "of the mean; 0.5: the class border of the paper's two-way softmax"),
    ] = 0.5  # fmt: skip
    fingers: Annotated[
        int,
        Meta(ge=1, le=3, description="fusion any: how many fingers must agree; the paper does not "
             "say: assumed 1"),
    ] = 1  # fmt: skip
    drift: Annotated[
        float,
        Meta(ge=-5.0, le=5.0, description="cusum: log-odds a sample that count as no evidence; 0: "
             "those of even odds"),
    ] = 0.0  # fmt: skip
    limit: Annotated[
        float,
        Meta(gt=0.0, le=200.0, description="cusum: summed log-odds, of one finger or of the mean, "
             "that register slip; assumed, tuned with `grasp detector tune`"),
    ] = 5.0  # fmt: skip
    release: Annotated[
        int,
        Meta(ge=1, le=100, description="consecutive samples below threshold, on all fingers or "
             "of the mean, that end an event; assumed"),
    ] = 3  # fmt: skip

    @property
    def unread(self) -> frozenset[str]:
        """The settings that this kind of rule has no use for."""
        of_kind = {"drift", "limit"} if self.kind == "consecutive" else {"consecutive"}
        return frozenset(of_kind | ({"fingers"} if self.fusion == "mean" else set()))


class ConsecutiveRule:
    """So many samples in a row register slip on a finger; ``release`` quiet ones on all end it.

    A probability equal to the threshold is not above it.
    """

    def __init__(self, settings: RuleSettings, fingers: int) -> None:
        self.settings = settings
        self.threshold = settings.threshold
        self._fingers = fingers
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.registered = False  # between registration and release
        self.interrupt()

    def interrupt(self) -> None:
        """Samples are left out here: no run of them goes on, but what is registered stays so."""
        self._runs = [0] * self._fingers
        self._quiet = 0

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Take (fingers,) probabilities; tell which fingers (fingers,) register slip now."""
        values: list[float] = probabilities.tolist()
        self._runs = [
            run + 1 if p > self.threshold else 0 for run, p in zip(self._runs, values, strict=True)
        ]
        self._quiet = 0 if any(self._runs) else self._quiet + 1
        registering = [run >= self.settings.consecutive for run in self._runs]
        if sum(registering) < min(self.settings.fingers, self._fingers):
            registering = [False] * self._fingers
        if any(registering):
            self.registered = True
        elif self._quiet >= self.settings.release:
            self.registered = False
        return np.array(registering)


class CusumRule:
    """Adds up log-odds beyond the drift, never below zero, and registers above the limit.

    For calibrated probabilities this is Page's test, the quickest at a given rate of false alarms.
    After ``release`` samples in a row at or below threshold on all fingers the sums begin anew.
    """

    def __init__(self, settings: RuleSettings, fingers: int) -> None:
        self.settings = settings
        self.threshold = settings.threshold
        self._fingers = fingers
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.registered = False
        self.interrupt()

    def interrupt(self) -> None:
        """Samples are left out here: the sums begin anew, what is registered stays so."""
        self._sums = np.zeros(self._fingers)
        self._quiet = 0

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Take (fingers,) probabilities; tell which fingers (fingers,) register slip now."""
        evidence = log_odds(probabilities) - self.settings.drift
        self._sums = np.maximum(self._sums + evidence, 0.0)
        self._quiet = 0 if (probabilities > self.threshold).any() else self._quiet + 1
        if self._quiet >= self.settings.release:
            self._sums[:] = 0.0
            self.registered = False
        registering = self._sums > self.settings.limit
        if registering.sum() < min(self.settings.fingers, self._fingers):
            registering[:] = False
        self.registered = self.registered or bool(registering.any())
        return registering


class FusedRule:
    """One rule for all fingers, on the mean of their log-odds; the surest finger registers."""

    def __init__(self, settings: RuleSettings) -> None:
        self._rule = _one_rule(settings, 1)
        self.threshold = settings.threshold

    @property
    def registered(self) -> bool:
        return self._rule.registered

    def reset(self) -> None:
        """Forget everything."""
        self._rule.reset()

    def interrupt(self) -> None:
        """Samples are left out here."""
        self._rule.interrupt()

    def update(self, probabilities: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Take (fingers,) probabilities; tell which fingers (fingers,) register slip now."""
        registering = np.zeros(len(probabilities), np.bool_)
        fused = mean_probability(probabilities[None])[0]
        surest = np.nan_to_num(probabilities, nan=-1.0).argmax()
        registering[surest] = self._rule.update(fused)[0]
        return registering


Rule = ConsecutiveRule | CusumRule | FusedRule


def make_rule(settings: RuleSettings, fingers: int) -> Rule:
    """The rule that the settings name, reset, for so many fingers."""
    return FusedRule(settings) if settings.fusion == "mean" else _one_rule(settings, fingers)


def _one_rule(settings: RuleSettings, fingers: int) -> ConsecutiveRule | CusumRule:
    kind = CusumRule if settings.kind == "cusum" else ConsecutiveRule
    return kind(settings, fingers)


def log_odds(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log-odds, limited to what a detector can be believed."""
    # np.clip takes three times as long for a handful of numbers
    told = np.where(np.isnan(probabilities), 0.5, probabilities)  # no number tells nothing
    p = np.minimum(np.maximum(told, LEAST_PROBABILITY), 1.0 - LEAST_PROBABILITY)
    odds: NDArray[np.float64] = np.log(p / (1.0 - p))
    return odds


def mean_probability(probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probability (n, 1) of the mean log-odds of (n, fingers)."""
    fused: NDArray[np.float64] = 1.0 / (
        1.0 + np.exp(-log_odds(probabilities).mean(axis=1, keepdims=True))
    )
    return fused


def registered_events(
    probabilities: NDArray[np.float64], settings: RuleSettings
) -> NDArray[np.intp]:
    """Events (m, 2) of a whole stream (n, fingers), as `make_rule`'s rule would register them.

    Each row is the sample that registered slip and the one that released it, n if none did.
    """
    return events_of(fused(probabilities, settings), settings)


def fused(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.float64]:
    """What decides of (n, fingers): each finger, or (n, 1) the mean of their log-odds."""
    return mean_probability(probabilities) if settings.fusion == "mean" else probabilities


def events_of(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.intp]:
    """`registered_events` of probabilities that are fused already, where the rule asks for it."""
    if settings.kind == "cusum":
        quiet = _quiet(np.greater(probabilities, settings.threshold), settings.release)
        sums = cusum(probabilities, settings)
        registering = _agreeing(sums > settings.limit, settings)
    else:
        registering, quiet = _markers(probabilities, settings.threshold, settings)
    starts = _first_of_each(registering, quiet)
    ends = np.append(_first_of_each(quiet, registering), len(probabilities))
    return np.column_stack([starts, ends[np.searchsorted(ends, starts)]])


def cusum(probabilities: NDArray[np.float64], settings: RuleSettings) -> NDArray[np.float64]:
    """Sums (n, fingers) of `CusumRule`; they do not depend on its limit."""
    quiet = _quiet(np.greater(probabilities, settings.threshold), settings.release)
    evidence = log_odds(probabilities) - settings.drift
    sums = np.zeros_like(evidence)
    edges = np.flatnonzero(np.diff(quiet, prepend=True, append=True))
    for first, after in edges.reshape(-1, 2):  # stretches in which nothing begins anew
        total = np.cumsum(evidence[first:after], axis=0)
        sums[first:after] = total - np.minimum(np.minimum.accumulate(total, axis=0), 0.0)
    return sums


def event_starts(
    values: NDArray[np.float64], threshold: float, settings: RuleSettings
) -> NDArray[np.intp]:
    """Samples that register an event of the consecutive kind; values (n, fingers) of any unit."""
    return _first_of_each(*_markers(values, threshold, settings))


def _markers(
    values: NDArray[np.float64], threshold: float, settings: RuleSettings
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples (n,) on which some finger has been above for long enough, and all have been below."""
    above: NDArray[np.bool_] = np.greater(values, threshold)
    registering = _agreeing(_run_lengths(above) >= settings.consecutive, settings)
    return registering, _quiet(above, settings.release)


def _agreeing(registering: NDArray[np.bool_], settings: RuleSettings) -> NDArray[np.bool_]:
    """Samples (n,) on which as many of the fingers (n, fingers) register as must agree."""
    enough: NDArray[np.bool_] = registering.sum(axis=1) >= min(
        settings.fingers, registering.shape[1]
    )
    return enough


def _quiet(above: NDArray[np.bool_], release: int) -> NDArray[np.bool_]:
    """Samples (n,) up to which all fingers have been below for long enough."""
    below = ~np.logical_or.reduce(above, axis=1, keepdims=True)
    quiet: NDArray[np.bool_] = _run_lengths(below)[:, 0] >= release
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
