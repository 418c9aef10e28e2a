"""What `page/view.html` shows of a run, whether it is over or still goes on: the scene, and what
the decision rule went by beside the bound that it had to pass."""

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, cusum, fused
from drivers.interfaces import KIT_TAXELS
from scenarios.trial.config import TrialConfig


class Bound(msgspec.Struct, frozen=True):
    """What a rule goes by: ``limit`` is what registers slip. ``probable``: of probabilities."""

    limit: float
    probable: bool
    label: str
    rule: str  # in words


class Decided(Bound, frozen=True, kw_only=True):
    """``values`` (n, k) of k fingers, or of all together; NaN where nothing was decided."""

    values: NDArray[np.float64]


class View(msgspec.Struct, frozen=True):
    """What there is to be shown."""

    truth: bool
    motion: bool
    limit_n: float
    rule: Bound
    evidence: bool = False  # sums of a rule, for a run that is over


def bound_of(settings: RuleSettings) -> Bound:
    """Of a rule, whatever it is shown."""
    probable, together = settings.kind == "consecutive", settings.fusion == "mean"
    if probable:
        label = "all fingers, mean of log-odds" if together else "each finger"
    else:
        label = "summed log-odds, " + ("all fingers" if together else "each finger")
    limit = settings.threshold if probable else settings.limit
    return Bound(limit, probable, label, in_words(settings))


def decided(
    settings: RuleSettings,
    probabilities: NDArray[np.float64],
    armed: NDArray[np.bool_],
    masked: NDArray[np.bool_],
) -> Decided:
    """Of probabilities (n, fingers) and the status (n,) after each, as recorded.

    A sum begins anew wherever the slip monitor's did: when it is armed, and after every mask.
    """
    bound = bound_of(settings)
    values = fused(probabilities, settings)
    # the sample that armed the monitor was not shown to the rule
    shown = armed & np.roll(armed, 1) & ~masked
    shown[:1] = False
    if not bound.probable:
        sums = np.full(values.shape, np.nan)
        edges = np.flatnonzero(np.diff(shown, prepend=False, append=False))
        for first, after in edges.reshape(-1, 2):
            sums[first:after] = cusum(values[first:after], settings)
        values = sums
    return Decided(**msgspec.structs.asdict(bound), values=values)


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


def taxels_of(config: TrialConfig) -> int:
    """How many a fingertip has."""
    return len(config.fingertip.taxels_mm) or KIT_TAXELS


def scene(config: TrialConfig, grip_m: float, top_m: float) -> dict[str, Any]:
    """Of the side view, in metres; heights count from ``grip_m``, the arm's when a lift begins."""
    known = config.calibration
    return {
        "object": msgspec.to_builtins(config.object),
        "half_aperture_m": config.contact.half_aperture_m,
        "pad_half_m": config.contact.pad_half_length_m,
        "m_per_count": None if known is None else known.m_per_count,
        "grip_m": grip_m,
        "top_m": top_m,
    }
