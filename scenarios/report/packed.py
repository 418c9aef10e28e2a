"""Columns of numbers in little text: whole steps, differences, deflated, base64.

`page/data.js` reads it back. A run of 20 s has some fifty numbers a sample: 0.6 MB as JSON, a
tenth of that so.
"""

import base64
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

MISSING = -(2**31)  # no number


class Column(msgspec.Struct, frozen=True):
    """Values (n,) or (n, width), NaN where there is none, kept to the nearest ``step``."""

    values: NDArray[np.float64]
    step: float


def pack(columns: Mapping[str, Column]) -> dict[str, Any]:
    """What `unpack()` of `page/data.js` takes; all columns are equally long."""
    flat = {name: column.values.reshape(len(column.values), -1) for name, column in columns.items()}
    steps = [_differences(flat[name], columns[name].step) for name in columns]
    content = b"".join(values.tobytes() for values in steps)
    return {
        "rows": len(next(iter(flat.values()))),
        "columns": [[name, flat[name].shape[1], columns[name].step] for name in columns],
        "deflated": base64.b64encode(zlib.compress(content, 9)).decode(),
    }


def _differences(values: NDArray[np.float64], step: float) -> NDArray[np.int32]:
    """(width, n) little-endian; 32 bits wrap around here as they do where they are added up."""
    whole = np.clip(np.round(values / step), MISSING + 1, -MISSING - 1)
    counts = np.where(np.isnan(whole), MISSING, whole).astype(np.int64).T
    return np.diff(counts, axis=1, prepend=0).astype(np.uint32).astype("<u4").view("<i4")


def thinned(n: int, most: int, peaks: Sequence[NDArray[np.float64]]) -> NDArray[np.intp]:
    """Which of n samples to show, at most about ``most``: all, or of each stretch the first one and
    the largest of each of ``peaks`` (n,), so that no peak is lost."""
    if n <= most:
        return np.arange(n)
    stretches = np.array_split(np.arange(n), max(1, most // (1 + len(peaks))))
    kept = {int(stretch[0]) for stretch in stretches} | {n - 1}
    for values in peaks:
        known = np.nan_to_num(values, nan=-np.inf)
        kept |= {int(stretch[known[stretch].argmax()]) for stretch in stretches}
    return np.array(sorted(kept))
