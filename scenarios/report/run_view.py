"""View of a run for pages and terminal: what scripts need, values of the decision rule with their
limit, and figures of the verdict."""

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, cusum, fused
from drivers.interfaces import FINGER_NAMES, KIT_TAXELS
from grasp.control.guard import limit_in_words
from grasp.control.states import State
from scenarios.trial.config import TrialConfig
from scenarios.trial.foxglove import taxel_places
from scenarios.world.settings import HALF_APERTURE_M, PAD_HALF_LENGTH_M

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
# of the states, on a page's first screen
PHASE_NAMES: dict[str, str] = {
    State.START: "start", State.HOME: "arm to its start", State.SHAPE: "fingers to the object",
    State.TARE: "take rest values", State.BRACE: "B and C close", State.CLOSE: "thumb closes",
    State.SETTLE: "pads relax", State.BASELINE: "detector starts", State.LIFT: "lift",
    State.COMPENSATE: "respond to slip", State.HOLD: "hold", State.DESCEND: "lower",
    State.FEEL: "lower slowly", State.OPEN: "open", State.RETREAT: "move away",
    State.SET_DOWN: "set down", State.KEPT: "kept in the hand", State.LOST: "object lost",
    State.STOPPED: "stopped", State.FAULT: "fault",
}  # fmt: skip
LEAST_TURN_DEG = 0.1  # less is not shown


class Bound(msgspec.Struct, frozen=True):
    """Limit of a decision rule. ``probable``: it is a probability, not a sum of log-odds."""

    limit: float
    probable: bool
    label: str
    rule: str  # in words


class View(msgspec.Struct, frozen=True):
    """Which parts of a run are shown."""

    truth: bool
    motion: bool
    limit_n: float
    rule: Bound
    evidence: bool = False  # the sums of a cusum rule, for a finished run


def bound_of(settings: RuleSettings) -> Bound:
    """The limit of a decision rule."""
    probable, together = settings.kind != "cusum", settings.fusion == "mean"
    if probable:
        label = "all fingers, mean of log-odds" if together else "each finger"
    else:
        label = "summed log-odds, " + ("all fingers" if together else "each finger")
    limit = settings.threshold if probable else settings.limit
    return Bound(limit, probable, label, in_words(settings))


def decided(settings: RuleSettings, probabilities: Floats, armed: Flags, masked: Flags) -> Floats:
    """Values that the rule compared with its limit, (n, fingers) or (n, 1) for a fused rule; NaN
    where it was not applied. Input: recorded probabilities (n, fingers) and status (n,).

    A sum restarts where the slip monitor's did: when it is armed, and after every mask.
    """
    values = fused(probabilities, settings)
    # the rule does not get the sample that armed the monitor
    used = armed & np.roll(armed, 1) & ~masked
    used[:1] = False
    if settings.kind != "cusum":
        return values
    sums = np.full(values.shape, np.nan)
    edges = np.flatnonzero(np.diff(used, prepend=False, append=False))
    for first, after in edges.reshape(-1, 2):
        sums[first:after] = cusum(values[first:after], settings)
    return sums


def in_words(settings: RuleSettings) -> str:
    """The condition of the rule, in words."""
    mean = "the mean of the fingers' log-odds"
    one, odds = "a finger", "the log-odds of a finger"
    if settings.fusion == "mean":
        one, odds = f"the probability by {mean}", mean
    row = "one sample" if settings.consecutive == 1 else f"{settings.consecutive} samples in a row"
    count = f"{one} stays above {settings.threshold:g} for {row}"
    total = f"the sum of {odds}, {0.0 - settings.drift:+g} a sample, passes {settings.limit:g}"
    when = {"consecutive": count, "cusum": total, "either": f"{count}, or {total}"}[settings.kind]
    quiet = f"{settings.quiet_at:g}" if settings.quiet or settings.kind == "cusum" else "it"
    return f"slip is registered when {when}, and ends after {settings.release} below {quiet}"


def taxels_of(config: TrialConfig) -> int:
    """Number of taxels of a fingertip."""
    return len(config.fingertip.taxels_mm) or KIT_TAXELS


def page_data(
    config: TrialConfig, rule: Bound, taxels: int, grip_m: float, top_m: float
) -> dict[str, Any]:
    """What the scripts of a page need besides the samples. The 3D view's heights are relative to
    ``grip_m``, the arm's height at the start of the lift; ``top_m``: its greatest."""
    known = config.calibration
    return {
        "fingers": FINGER_NAMES,
        "taxels": taxel_places(config.fingertip.taxels_mm, taxels),
        "limit_n": config.guard.force_limit_n,
        "rule": msgspec.to_builtins(rule),
        "phase_names": PHASE_NAMES,
        "scene": {
            "object": msgspec.to_builtins(config.object),
            "half_aperture_m": HALF_APERTURE_M,
            "pad_half_m": PAD_HALF_LENGTH_M,
            "m_per_count": None if known is None else known.m_per_count,
            "grip_m": grip_m, "top_m": top_m,
        },
    }  # fmt: skip


def turned_text(turned_rad: float | None) -> str:
    """Rotation of the object in the hand, as text; empty below 0.1 degrees."""
    turned_deg = math.degrees(abs(turned_rad or 0.0))
    return f"turned {turned_deg:.1f} deg" if turned_deg >= LEAST_TURN_DEG else ""


def facts(result: Any) -> list[str]:
    """Figures of a verdict as text: latencies, slip, pauses, forces and their limit."""
    texts = []
    if (late_ms := result.detection_latency_ms) is not None:
        when = f"{late_ms:.0f} ms after" if late_ms >= 0.0 else f"{-late_ms:.0f} ms before"
        text = f"slip registered {when} its onset"
        if (reaction_ms := getattr(result, "reaction_latency_ms", None)) is not None:
            text += f", grip force rising {reaction_ms:.0f} ms after it"
        texts.append(text)
    if result.slip_distance_m is not None:
        slipped = f"the object slipped {result.slip_distance_m * 1e3:.1f} mm"
        texts.append(", ".join(filter(None, (slipped, turned_text(result.turned_rad)))))
    if (over := getattr(result, "over_least", None)) is not None:
        texts.append(f"held with {over:.1f} times the least force that carries it")
    if result.paused_s:
        texts.append(f"the arm stopped for {result.paused_s:.2f} s to respond to slip")
    if peaks_n := result.peak_force_n or result.peak_estimated_n:
        peaks = ", ".join(f"{name} {force:.1f}" for name, force in peaks_n.items())
        known = "true" if result.peak_force_n else "estimated by the fingertips"
        texts.append(f"peak force {peaks} N ({known}); commanded {result.commanded_force_n:.1f} N")
    texts.append(limit_in_words(result.force_limit_n, result.limit_mode))
    return texts + (result.grip.lines if result.grip else [])
