"""Files of networks that differ from the packaged ones in their cards, and counts for them."""

from pathlib import Path

import msgspec
import numpy as np
import onnx
from numpy.typing import NDArray

from detector.network_file import read_network, sealed, weights_path


def write_network(folder: Path, name: str, **changes: object) -> Path:
    """A copy of the packaged network with some of its card changed."""
    packaged = weights_path(name)
    card = msgspec.structs.replace(read_network(packaged).card, format=2, **changes)
    path = folder / f"{name}-copy.onnx"
    path.write_bytes(sealed(onnx.load(packaged), card))
    return path


def walk(n: int, fingers: int = 3, seed: int = 0) -> NDArray[np.int16]:
    """Counts (n, fingers, 6) that wander and jump, within what the sensor can say."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, 3, (n, fingers, 6)) + 60 * (rng.random((n, fingers, 1)) < 0.02)
    return np.clip(np.cumsum(steps - steps.mean(0), 0), -500, 200).astype(np.int16)
