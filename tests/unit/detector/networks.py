"""Networks with random weights, made without torch."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from detector.network_file import FORMAT, Mode, NetworkCard
from detector.training.architecture import ARCHITECTURES, Architecture
from detector.training.graph import Weights, make_model

COUNTS = (0.0,) * 6


def card(name: str, mode: Mode, window: int, **changes: object) -> NetworkCard:
    fields: dict[str, object] = {
        "format": FORMAT, "name": name, "mode": mode, "window": window, "threshold": 0.5,
        "parameters": 1, "mean_counts": COUNTS, "std_counts": COUNTS, "change_scale_counts": 1.0,
        "temperature": 1.2, "shift": -0.3, "data_digest": "none", "label": "slip",
        "augmentation": "none", "balance": "weights", "seed": 0, "commit": "", "steps": 0,
        "training_minutes": 0.0, "validation": {},
    }  # fmt: skip
    return NetworkCard(**(fields | changes))  # type: ignore[arg-type]


def random_weights(arch: Architecture, seed: int = 0) -> Weights:
    """As torch names and shapes them."""
    rng = np.random.default_rng(seed)
    found: Weights = {}

    def layer(name: str, *shape: int) -> None:
        found[f"{name}.weight"] = rng.normal(0, 0.4, shape).astype(np.float32)
        found[f"{name}.bias"] = rng.normal(0, 0.2, shape[:1]).astype(np.float32)

    def norm(name: str, width: int) -> None:
        found[f"{name}.weight"] = rng.uniform(0.5, 1.5, width).astype(np.float32)
        found[f"{name}.bias"] = rng.normal(0, 0.2, width).astype(np.float32)

    found["features.mean"] = np.full(6, -20.0, np.float32)
    found["features.std"] = np.full(6, 80.0, np.float32)
    found["features.change_scale"] = np.array(2.0, np.float32)
    width = 6 * len(arch.inputs)
    if arch.family == "gru":
        for k, n in (("ih", width), ("hh", arch.channels)):
            found[f"gru.weight_{k}_l0"] = rng.normal(0, 0.3, (96, n)).astype(np.float32)
            found[f"gru.bias_{k}_l0"] = rng.normal(0, 0.2, 96).astype(np.float32)
        layer("out", arch.outputs, arch.channels)
        return found
    if arch.gated:
        layer("enter", arch.channels, width)
        for i in range(len(arch.dilations)):
            layer(f"blocks.{i}.conv", 2 * arch.channels, arch.kernel * arch.channels)
        layer("out", arch.outputs, 2 * arch.channels)
        return found
    layer("blocks.0.skip", arch.channels, width, 1)
    for i in range(len(arch.dilations)):
        for half, n in (("first", width if i == 0 else arch.channels), ("second", arch.channels)):
            layer(f"blocks.{i}.{half}.conv", arch.channels, n, arch.kernel)
            norm(f"blocks.{i}.{half}.norm", arch.channels)
    for i, n in ((1, arch.channels), (2, arch.head)):
        layer(f"head.dense{i}", arch.head, n)
        norm(f"head.norm{i}", arch.head)
    layer("head.out", arch.outputs, arch.head)
    return found


def write_network(folder: Path, name: str, mode: Mode, **changes: object) -> Path:
    """A file of the named architecture with random weights."""
    arch = ARCHITECTURES[name]
    path = folder / f"{name}-{mode}.onnx"
    model = make_model(arch, mode, random_weights(arch), card(name, mode, 100, **changes))
    path.write_bytes(model)
    return path


def walk(n: int, fingers: int = 3, seed: int = 0) -> NDArray[np.int16]:
    """Counts (n, fingers, 6) that wander and jump, within what the sensor can say."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, 3, (n, fingers, 6)) + 60 * (rng.random((n, fingers, 1)) < 0.02)
    return np.clip(np.cumsum(steps - steps.mean(0), 0), -500, 200).astype(np.int16)
