"""What a decision rule went by, sample by sample, beside the bound that it had to pass."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, cusum, fused


class Bound(msgspec.Struct, frozen=True):
    """What a rule goes by: ``limit`` is what registers slip. ``probable``: of probabilities."""

    limit: float
    probable: bool
    label: str
    rule: str  # in words


class Decided(Bound, frozen=True, kw_only=True):
    """``values`` (n, k) of k fingers, or of all together; NaN where nothing was decided."""

    values: NDArray[np.float64]


def bound_of(settings: RuleSettings) -> Bound:
    """Of a rule, whatever it is shown."""
    probable = settings.kind == "consecutive"
    limit = settings.threshold if probable else settings.limit
    return Bound(limit, probable, _label(probable, settings.fusion == "mean"), in_words(settings))


def decided(
    settings: RuleSettings,
    probabilities: NDArray[np.float64],
    armed: NDArray[np.bool_],
    masked: NDArray[np.bool_],
) -> Decided:
    """Of probabilities (n, fingers) and the status (n,) after each, as recorded.

    A sum begins anew wherever the slip monitor's did: when it is armed, and after every mask.
    """
    probable = settings.kind == "consecutive"
    values = fused(probabilities, settings)
    # the sample that armed the monitor was not shown to the rule
    shown = armed & np.roll(armed, 1) & ~masked
    shown[:1] = False
    if not probable:
        sums = np.full(values.shape, np.nan)
        edges = np.flatnonzero(np.diff(shown, prepend=False, append=False))
        for first, after in edges.reshape(-1, 2):
            sums[first:after] = cusum(values[first:after], settings)
        values = sums
    return Decided(**msgspec.structs.asdict(bound_of(settings)), values=values)


def _label(probable: bool, together: bool) -> str:
    if probable:
        return "all fingers, mean of log-odds" if together else "each finger"
    return "summed log-odds, " + ("all fingers" if together else "each finger")


def in_words(settings: RuleSettings) -> str:
    """When that rule registers slip."""
    together = settings.fusion == "mean"
    who = "the mean of the fingers' log-odds" if together else "a finger"
    if settings.kind == "cusum":
        return (
            f"slip is registered when the summed log-odds of {who} pass {settings.limit:g} "
            f"(less {settings.drift:g} a sample)"
        )
    row = "one sample" if settings.consecutive == 1 else f"{settings.consecutive} samples in a row"
    who = f"the probability by {who}" if together else who
    return (
        f"slip is registered when {who} stays above {settings.threshold:g} for {row}, and ends "
        f"after {settings.release} below it"
    )
