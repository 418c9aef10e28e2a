"""Decision rules: when do probabilities, sample by sample, amount to a registered slip event?"""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How many samples make an event, and how many end it."""

    consecutive: Annotated[
        int,
        Meta(ge=1, le=50, description="consecutive samples above threshold on one finger that "
             "register slip (paper: 2)"),
    ] = 2  # fmt: skip
    threshold: Annotated[
        float,
        Meta(gt=0.0, lt=1.0, description="probability above which a sample counts; the class "
             "border of the paper's two-way softmax"),
    ] = 0.5  # fmt: skip
    fingers: Annotated[
        int,
        Meta(ge=1, le=3, description="how many fingers must agree; the paper does not say: assumed "
             "1, any finger"),
    ] = 1  # fmt: skip
    release: Annotated[
        int,
        Meta(ge=1, le=100, description="consecutive samples below threshold on all fingers that "
             "end an event; assumed"),
    ] = 3  # fmt: skip


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


def registered_events(
    probabilities: NDArray[np.float64], settings: RuleSettings
) -> NDArray[np.intp]:
    """Events (m, 2) of a whole stream (n, fingers), as `ConsecutiveRule` would register them.

    Each row is the sample that registered slip and the one that released it, n if none did.
    """
    registering, quiet = _markers(probabilities, settings.threshold, settings)
    starts = _first_of_each(registering, quiet)
    ends = np.append(_first_of_each(quiet, registering), len(probabilities))
    return np.column_stack([starts, ends[np.searchsorted(ends, starts)]])


def event_starts(
    values: NDArray[np.float64], threshold: float, settings: RuleSettings
) -> NDArray[np.intp]:
    """Samples that register an event, values (n, fingers) and threshold being of any unit."""
    return _first_of_each(*_markers(values, threshold, settings))


def _markers(
    values: NDArray[np.float64], threshold: float, settings: RuleSettings
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples (n,) on which some finger has been above for long enough, and all have been below."""
    above: NDArray[np.bool_] = np.greater(values, threshold)
    agreeing = (_run_lengths(above) >= settings.consecutive).sum(axis=1)
    registering = agreeing >= min(settings.fingers, values.shape[1])
    below = ~np.logical_or.reduce(above, axis=1, keepdims=True)
    quiet = _run_lengths(below)[:, 0] >= settings.release
    return registering, quiet


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
