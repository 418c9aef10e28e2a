"""Augmentation of training data: as in the paper, as in its authors' code, and ours."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Float32s = NDArray[np.float32]
Augmentation = Literal["none", "paper", "as-run", "ours"]

HALF_TURN = 3
PAPER_NOISE_COUNTS = 6.0  # 1 % of the barometers' range, -500 to 200 counts in the authors' data
AS_RUN_NOISE_COUNTS = 0.5
AS_RUN_SHARE = 0.75

# ours: properties that differ between hands and do not distinguish slip from rest
GAIN = 2.0  # sensitivity from half to double
OFFSET_COUNTS = 30.0  # standard deviation of a drift of the rest counts of a taxel
NOISE_COUNTS = 1.5  # at most
LOST_SHARE = 0.01  # of the samples, replaced by the one before
DEAD_SHARE = 0.03  # of the taxels, always 0
STUCK_SHARE = 0.02  # of the taxels, constant
SWAPPED_SHARE = 0.12  # of the fingers: two taxels exchanged


def symmetries(taxels: int) -> NDArray[np.intp]:
    """Orders (4, taxels) of two serpentine rows (the kit: 0 1 2 below, 5 4 3 above): identity, flip
    of x, flip of y, half turn. Identity only for an odd number of taxels."""
    if taxels % 2:
        return np.tile(np.arange(taxels), (4, 1))
    below, above = np.arange(taxels // 2), np.arange(taxels // 2, taxels)
    return np.array([
        [*below, *above], [*below[::-1], *above[::-1]], [*above[::-1], *below[::-1]],
        [*above, *below],
    ])  # fmt: skip


def modes(taxels: int) -> tuple[NDArray[np.float32], int]:
    """Orthonormal modes (taxels, taxels) of a pad, in columns, and how many are symmetric. These
    come first; a mirror image may change the sign of the others, not their size."""
    orders, columns = symmetries(taxels), []
    for sign_x, sign_y in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        signs = np.array([1, sign_x, sign_y, sign_x * sign_y])
        for taxel in sorted({min(order) for order in orders.T.tolist()}):
            mode = np.zeros(taxels)
            np.add.at(mode, orders[:, taxel], signs)
            if mode.any():
                columns.append(mode / np.linalg.norm(mode))
        if (sign_x, sign_y) == (1, 1):
            symmetric = len(columns)
    return np.array(columns, np.float32).T, symmetric


def augment(counts: Float32s, how: Augmentation, rng: np.random.Generator) -> Float32s:
    """Augmented copy of a batch (batch, time, taxels) in counts."""
    if how == "paper":
        turned = _turn(counts, rng.integers(0, 4, size=len(counts)))
        return _noise(turned, np.full(len(counts), PAPER_NOISE_COUNTS), rng)
    if how == "as-run":
        turned = _turn(counts, np.where(rng.random(len(counts)) < AS_RUN_SHARE, HALF_TURN, 0))
        noisy = rng.random(len(counts)) < AS_RUN_SHARE
        return _noise(turned, noisy * AS_RUN_NOISE_COUNTS, rng)
    return _ours(counts, rng) if how == "ours" else counts.copy()


def _turn(counts: Float32s, which: Any) -> Float32s:
    turned: Float32s = np.take_along_axis(
        counts, symmetries(counts.shape[2])[which][:, None, :], axis=2
    )
    return turned


def _noise(counts: Float32s, std_counts: Any, rng: np.random.Generator) -> Float32s:
    noise = rng.standard_normal(counts.shape, np.float32)
    noisy: Float32s = counts + noise * std_counts.astype(np.float32)[:, None, None]
    return noisy


def _ours(counts: Float32s, rng: np.random.Generator) -> Float32s:
    batch, time, taxels = counts.shape
    turned = _turn(counts, rng.integers(0, 4, size=batch))
    gain = np.exp(rng.uniform(-np.log(GAIN), np.log(GAIN), (batch, 1, 1)))
    offset = rng.normal(0.0, OFFSET_COUNTS, (batch, 1, taxels))
    changed = (turned * gain + offset).astype(np.float32)
    changed = _noise(changed, NOISE_COUNTS * rng.random(batch), rng)
    changed = _swapped(changed, rng)
    stuck = rng.random((batch, 1, taxels)) < STUCK_SHARE
    changed = np.where(stuck, changed[:, :1], changed)
    changed *= rng.random((batch, 1, taxels)) >= DEAD_SHARE
    lost = rng.random((batch, time)) < LOST_SHARE
    lost[:, 0] = False
    latest = np.maximum.accumulate(np.where(lost, 0, np.arange(time)), axis=1)
    repeated: Float32s = np.take_along_axis(changed, latest[:, :, None], axis=1)
    return repeated


def _swapped(counts: Float32s, rng: np.random.Generator) -> Float32s:
    batch, _, taxels = counts.shape
    rows = np.flatnonzero(rng.random(batch) < SWAPPED_SHARE)
    order = np.tile(np.arange(taxels), (batch, 1))
    pairs = rng.permuted(order[rows], axis=1)[:, :2]
    order[rows[:, None], pairs] = pairs[:, ::-1]
    swapped: Float32s = np.take_along_axis(counts, order[:, None, :], axis=2)
    return swapped
