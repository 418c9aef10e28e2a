"""One sheet of figures for a detector and a decision rule on a labelled recording."""

from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings, registered_events
from detector.energy import EnergyDetector
from detector.events import EventSettings, Quantiles, event_metrics, quantiles
from detector.interface import SlipDetector
from detector.metrics import (
    Confusion,
    EdgeBin,
    Floats,
    accuracy_by_edge,
    auc,
    auc_interval,
    calibration_error,
    confusion,
    edge_distance_ms,
)
from detector.recordings import Recording

WARM_UP_SAMPLES = 100  # the paper's window: what comes earlier no detector has to know


class Evaluation(msgspec.Struct, frozen=True):
    """Figures of samples, of events (see `EventMetrics`) and of cost; None where undefined."""

    detector: str
    data: str
    n_samples: int
    accuracy: float
    weighted_f1: float
    slip_f1: float
    balanced_accuracy: float | None
    auc: float | None
    event_recall: float | None
    event_precision: float | None
    false_events_per_min: float | None
    delay_ms: Quantiles | None
    delay_mm: Quantiles | None  # needs the sliding speed
    release_delay_ms: Quantiles | None
    ece: float
    compute_us: Quantiles | None  # one update of all fingers; needs a clock
    auc_interval: tuple[float, float] | None  # 95 %
    threshold: float  # on the probability, of `accuracy` and its kin
    threshold_counts: float | None  # the same in counts, for the energy detector
    by_edge_distance: tuple[EdgeBin, ...]
    confusion: Confusion
    true_events: int
    missed_events: int
    registered_events: int
    false_events: int


def stream(
    detector: SlipDetector,
    counts: NDArray[np.int16],
    clock_ns: Callable[[], int] | None = None,
) -> tuple[Floats, Floats]:
    """Reset, then feed frames (n, fingers, 6) one by one.

    Gives probabilities (n, fingers), and microseconds of each update (n,), none without a clock.
    """
    detector.reset()
    probabilities, spent_us = [], []
    for frame in counts:
        before = clock_ns() if clock_ns else 0
        probabilities.append(detector.update(frame))
        if clock_ns:
            spent_us.append((clock_ns() - before) * 1e-3)
    return np.array(probabilities), np.array(spent_us)


def evaluate_recording(
    detector: SlipDetector,
    rule: RuleSettings,
    recording: Recording,
    *,
    first_sample: int = WARM_UP_SAMPLES,
    events: EventSettings = EventSettings(),  # noqa: B008 (frozen)
    speed_mps: Floats | None = None,
    clock_ns: Callable[[], int] | None = None,
) -> Evaluation:
    """Stream a recording through detector and rule; score it from ``first_sample`` on.

    The recording has one label for all fingers, so the finger that is surest speaks for a sample.
    Samples are judged at the detector's own threshold, events at the rule's. ``speed_mps`` (n,) is
    the true sliding speed, where known. Raises ValueError if nothing is left to score.
    """
    if not 0 <= first_sample < len(recording.t_s):
        raise ValueError(f"no sample left: {len(recording.t_s)} in all, first {first_sample}")
    probabilities, spent_us = stream(detector, recording.counts, clock_ns)
    happened = event_metrics(
        registered_events(probabilities, rule), recording.slip, recording.t_s, events,
        first_sample=first_sample, speed_mps=speed_mps,
    )  # fmt: skip
    p = probabilities.max(axis=1)[first_sample:]
    labels = recording.slip[first_sample:]
    verdicts = p > detector.threshold
    cells = confusion(verdicts, labels)
    distance_ms = edge_distance_ms(recording.t_s, recording.slip)[first_sample:]
    return Evaluation(
        **msgspec.structs.asdict(happened),
        detector=detector.name,
        data=recording.source,
        n_samples=cells.n,
        accuracy=cells.accuracy,
        weighted_f1=cells.weighted_f1,
        slip_f1=cells.slip_f1,
        balanced_accuracy=cells.balanced_accuracy,
        auc=auc(p, labels),
        ece=calibration_error(p, labels),
        compute_us=quantiles(spent_us),
        auc_interval=auc_interval(p, labels),
        threshold=detector.threshold,
        threshold_counts=_threshold_counts(detector),
        by_edge_distance=accuracy_by_edge(verdicts, labels, distance_ms),
        confusion=cells,
    )


def _threshold_counts(detector: SlipDetector) -> float | None:
    return detector.settings.threshold_counts if isinstance(detector, EnergyDetector) else None
