"""Network files with changed cards, and random counts as inputs."""

from pathlib import Path

import msgspec
import numpy as np
import onnx
from numpy.typing import NDArray

from detector.network_file import read_network, weights_path, with_checksum


def write_network(folder: Path, name: str, **changes: object) -> Path:
    """A copy of the packaged network with some of its card changed."""
    packaged = weights_path(name)
    card = msgspec.structs.replace(read_network(packaged).card, format=2, **changes)
    path = folder / f"{name}-copy.onnx"
    path.write_bytes(with_checksum(onnx.load(packaged), card))
    return path


def walk(n: int, fingers: int = 3, seed: int = 0) -> NDArray[np.int16]:
    """Random counts (n, fingers, 6) with drift and jumps, within the range of the sensor."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, 3, (n, fingers, 6)) + 60 * (rng.random((n, fingers, 1)) < 0.02)
    return np.clip(np.cumsum(steps - steps.mean(0), 0), -500, 200).astype(np.int16)
