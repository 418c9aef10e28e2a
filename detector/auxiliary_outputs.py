"""Auxiliary outputs of a network: speed, direction and rotation of a slipping fingertip.

They are computed from the state of a network that was trained for slip only, and stored beside its
weights as `NAME.auxiliary.json`. The slip probability is the same with and without them.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.interface import Motion
from detector.network_file import REINSTALL, LoadedNetwork, is_packaged
from drivers.errors import BadFile, UsageError

SECTORS = 8  # directions that are distinguished
SECTOR_DEG = 360 // SECTORS
OUTPUTS_SUFFIX = ".auxiliary.json"
CHANGES_STATE = "state1"  # latest changes of the counts, newest last
HIDDEN_STATE = "state0"  # hidden state of a recurrent network
FEATURES_STATE = "state2"  # of a gated tcn: sum of the outputs of all blocks, newest last
FEATURE_SAMPLES = 14  # samples in FEATURES_STATE
MOST_FILE_BYTES = 500_000  # the packaged files have a thirtieth of it
OUTPUTS = 2 + SECTORS  # logarithm of the speed, log-odds of turning, scores of the directions
ENERGY_SAMPLES, MIN_ENERGY = 10, 0.1  # counts a sample: a tenth of the energy of a taxel at rest
COUNTS_SCALE = 130.0
SHIFT_COUNTS = np.float32(8.0)
REMEDY = "train it again (`python -m studies slip_types --train` in the source), or remove it"
Float32s = NDArray[np.float32]
Counts = NDArray[np.int16] | Float32s


class Dense(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Dense layer: ``weight`` (outputs, inputs) times inputs, plus ``bias``."""

    weight: list[list[float]]
    bias: list[float]


class OutputsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two layers with a SELU between them, and their provenance."""

    format: Literal[1] = 1
    network: str  # SHA-256 of the weights file of the network whose state they read
    data_digest: str
    seed: int
    commit: str
    samples: int
    scores: dict[str, tuple[float, float, float]]  # on the split `test`, with 95 % intervals
    layers: tuple[Dense, Dense]


class AuxiliaryOutputs:
    """Evaluates the two layers of a file."""

    def __init__(self, file: OutputsFile) -> None:
        self.file = file
        self.layers = [
            (np.array(layer.weight, np.float32).T.copy(), np.array(layer.bias, np.float32))
            for layer in file.layers
        ]

    def outputs(self, inputs: Float32s) -> Float32s:
        """Outputs (..., OUTPUTS) for inputs (..., width)."""
        (w1, b1), (w2, b2) = self.layers
        out: Float32s = selu(inputs @ w1 + b1) @ w2 + b2
        return out

    def motion(self, states: Mapping[str, Float32s], counts: Counts) -> Motion:
        """Motion from a frame (fingers, taxels) and the network's states after that frame."""
        out = self.outputs(inputs_of(states, counts)).astype(np.float64)
        return Motion(
            np.exp(out[:, 0]).tolist(),
            (SECTOR_DEG * out[:, 2:].argmax(axis=1)).tolist(),
            (0.5 * (1.0 + np.tanh(0.5 * out[:, 1]))).tolist(),
        )


def inputs_of(states: Mapping[str, Float32s], counts: Counts) -> Float32s:
    """Inputs of the first layer (n, width): a summary of the network's states (n, numbers), the
    frame (n, taxels) that caused them, its changes in the last 100 and 380 ms, and the energy of
    the last 100 ms. A mirrored network knows no direction: the changes have it."""
    changes = states[CHANGES_STATE].reshape(len(counts), -1, counts.shape[1])
    latest = changes[:, -ENERGY_SAMPLES:]
    energy = np.log(abs(latest).mean(axis=(1, 2))[:, None] + np.float32(MIN_ENERGY))
    moved = [np.arcsinh(part.sum(axis=1) / SHIFT_COUNTS) for part in (latest, changes)]
    if FEATURES_STATE in states:  # a gated tcn: latest features, and the maximum of each
        features = states[FEATURES_STATE].reshape(len(states[FEATURES_STATE]), FEATURE_SAMPLES, -1)
        summary: tuple[Float32s, ...] = (features[:, -1], features.max(axis=1))
    else:
        summary = (states[HIDDEN_STATE],)
    frame = counts / np.float32(COUNTS_SCALE)
    return np.concatenate([*summary, frame, *moved, energy], axis=1, dtype=np.float32)


def input_width(loaded: LoadedNetwork) -> int:
    """Width of the inputs of that network. Raises UsageError for a network without that state."""
    if not {HIDDEN_STATE, CHANGES_STATE} <= loaded.states.keys():
        raise UsageError(f"{loaded.card.name} has no state", "give a streaming network")
    if math.prod(loaded.states.get(FEATURES_STATE, (FEATURE_SAMPLES,))) % FEATURE_SAMPLES:
        remedy = f"give a network with {FEATURE_SAMPLES} samples in {FEATURES_STATE}"
        raise UsageError(f"{loaded.card.name} has another size of {FEATURES_STATE}", remedy)
    one = {name: np.zeros((1, *shape), np.float32) for name, shape in loaded.states.items()}
    return len(inputs_of(one, np.zeros((1, loaded.taxels), np.float32))[0])


def selu(x: Float32s) -> Float32s:
    """Scaled exponential linear unit (Klambauer et al. 2017)."""
    scale, alpha = np.float32(1.0507009873554805), np.float32(1.6732632423543772)
    out: Float32s = scale * np.where(x > 0, x, alpha * np.expm1(np.minimum(x, 0)))
    return out


def outputs_path(weights: Path) -> Path:
    """Path of the auxiliary outputs of a weights file."""
    return weights.with_name(weights.stem + OUTPUTS_SUFFIX)


def read_outputs(weights: Path, digest: str, loaded: LoadedNetwork) -> AuxiliaryOutputs | None:
    """Auxiliary outputs beside a network's weights; None without a file. Raises BadFile for a
    damaged file and for one of another network (another ``digest``)."""
    path = outputs_path(weights)
    remedy = REINSTALL if is_packaged(weights) else REMEDY
    if not path.exists():
        return None
    try:
        with path.open("rb") as opened:
            file = msgspec.json.decode(opened.read(MOST_FILE_BYTES), type=OutputsFile)
        outputs = AuxiliaryOutputs(file)
    except (OSError, ValueError, RecursionError) as error:  # ValueError: also ragged layers
        raise BadFile(path, f"holds no auxiliary outputs: {error}", remedy) from None
    if file.network != digest:
        raise BadFile(path, f"was made for other weights than {weights.name} has now", remedy)
    width, hidden = input_width(loaded), len(file.layers[0].bias)
    shapes = [array.shape for layer in outputs.layers for array in layer]
    if shapes != [(width, hidden), (hidden,), (hidden, OUTPUTS), (OUTPUTS,)]:
        raise BadFile(path, f"has not {width} inputs and {OUTPUTS} outputs", remedy)
    return outputs
