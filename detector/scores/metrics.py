"""Metrics of samples: probabilities (n,) compared with labels (n,)."""

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Labels = NDArray[np.bool_]

CALIBRATION_BINS = 10


class Confusion(msgspec.Struct, frozen=True):
    """Confusion matrix of the samples; ratios without samples are 0."""

    static_static: int
    static_slip: int  # labelled static, predicted slip
    slip_static: int
    slip_slip: int

    @property
    def static(self) -> int:
        return self.static_static + self.static_slip

    @property
    def slip(self) -> int:
        return self.slip_static + self.slip_slip

    @property
    def n(self) -> int:
        return self.static + self.slip

    @property
    def accuracy(self) -> float:
        return _ratio(self.static_static + self.slip_slip, self.n)

    @property
    def balanced_accuracy(self) -> float | None:
        """Mean recall of both classes; None if one has no sample."""
        if self.static == 0 or self.slip == 0:
            return None
        return (self.static_static / self.static + self.slip_slip / self.slip) / 2.0

    @property
    def slip_f1(self) -> float:
        return _f1(self.slip_slip, self.slip_static + self.static_slip)

    @property
    def weighted_precision(self) -> float:
        """Precision of both classes, weighted by their numbers of labels."""
        of_static = _ratio(self.static_static, self.static_static + self.slip_static)
        of_slip = _ratio(self.slip_slip, self.slip_slip + self.static_slip)
        return _ratio(self.static * of_static + self.slip * of_slip, self.n)

    @property
    def weighted_f1(self) -> float:
        """F1 of both classes, weighted by their numbers of labels (the paper's F1)."""
        static_f1 = _f1(self.static_static, self.slip_static + self.static_slip)
        return _ratio(self.static * static_f1 + self.slip * self.slip_f1, self.n)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else 0.0


def _f1(hits: int, errors: int) -> float:
    return _ratio(2 * hits, 2 * hits + errors)


def confusion(predictions: Labels, labels: Labels) -> Confusion:
    """Confusion matrix of predictions (n,) and labels (n,)."""
    cells = np.bincount(2 * labels.astype(np.intp) + predictions, minlength=4)
    a, b, c, d = cells.tolist()
    return Confusion(a, b, c, d)


class Ranking:
    """Samples grouped by equal probability, in ascending order, to compute weighted AUCs."""

    def __init__(self, probabilities: Floats, labels: Labels) -> None:
        self._group = np.unique(probabilities, return_inverse=True)[1]
        self._labels = labels

    def auc(self, weights: Floats) -> float | None:
        """Share of correctly ordered (slip, static) pairs; ties count half. None without pairs."""
        slip = np.bincount(self._group, weights * self._labels)
        static = np.bincount(self._group, weights * ~self._labels)
        pairs = slip.sum() * static.sum()
        if pairs == 0.0:
            return None
        return float((slip * (np.cumsum(static) - static / 2.0)).sum() / pairs)


def auc(probabilities: Floats, labels: Labels) -> float | None:
    """Area under the ROC curve; None if one class has no sample."""
    return Ranking(probabilities, labels).auc(np.ones(len(labels)))


def calibration_error(probabilities: Floats, labels: Labels) -> float:
    """Expected calibration error over ten equal bins of probability."""
    gap = np.bincount(_calibration_bins(probabilities), probabilities - labels)
    return float(np.abs(gap).sum() / len(labels))


def _calibration_bins(probabilities: Floats) -> NDArray[np.intp]:
    return np.minimum((probabilities * CALIBRATION_BINS).astype(np.intp), CALIBRATION_BINS - 1)
