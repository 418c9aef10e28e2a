"""How a fingertip moves while it slips: auxiliary outputs on the state of a network.

The network was trained for slip alone. The outputs lie beside its weights as `NAME.heads.json` and
leave them as they are, so the probability of slip is the same without them, bit for bit.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.network_file import REINSTALL, LoadedNetwork, is_packaged
from drivers.errors import BadFile, UsageError

SECTORS = 8  # of directions
SECTOR_DEG = 360 // SECTORS
SUFFIX = ".heads.json"
CHANGES = "state1"  # that a network keeps, newest last
SUMMARY = "state0"  # all that a recurrent network keeps
FOUND = "state2"  # of a gated tcn: what all its blocks found in the latest samples, newest last
HELD = 14  # samples of it
LARGEST_BYTES = 500_000  # ours are a thirtieth of it
OUTPUTS = 2 + SECTORS  # logarithm of the speed, log-odds of turning, scores of the directions
ENERGY_SAMPLES, LEAST_ENERGY = 10, 0.1  # counts a sample: a tenth of what a taxel at rest has
COUNTS_SCALE = 130.0
REMEDY = "train it again (`python -m studies slip_types --train` in the source), or remove it"
Float32s = NDArray[np.float32]
Counts = NDArray[np.int16] | Float32s


class Motion(msgspec.Struct, frozen=True):
    """Of each fingertip, mean of the last 50 ms; meaningful while it slips."""

    speed_mps: list[float]
    direction_deg: list[int]  # one of eight, from the fingertip's x to its y
    turning: list[float]  # probability that it turns more than it slides

    @property
    def hand_mps(self) -> float:
        """Median speed of the fingers."""
        return sorted(self.speed_mps)[len(self.speed_mps) // 2]


class Dense(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One layer: outputs are ``weight`` (outputs, inputs) times inputs, and ``bias``."""

    weight: list[list[float]]
    bias: list[float]


class OutputsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Two layers with a SELU between, and where they come from."""

    format: Literal[1] = 1
    network: str  # SHA-256 of the weights file that they were trained on, whose state they read
    data_digest: str
    seed: int
    commit: str
    samples: int
    scores: dict[str, tuple[float, float, float]]  # of the split `test`, with 95 % intervals
    layers: tuple[Dense, Dense]


class AuxiliaryOutputs:
    """A file of them, ready to be asked."""

    def __init__(self, file: OutputsFile) -> None:
        self.file = file
        self.layers = [
            (np.array(layer.weight, np.float32).T.copy(), np.array(layer.bias, np.float32))
            for layer in file.layers
        ]

    def outputs(self, inputs: Float32s) -> Float32s:
        """(..., OUTPUTS) of inputs (..., width)."""
        (w1, b1), (w2, b2) = self.layers
        out: Float32s = selu(inputs @ w1 + b1) @ w2 + b2
        return out

    def motion(self, states: Mapping[str, Float32s], counts: Counts) -> Motion:
        """Of the states that the frame (fingers, taxels) led to."""
        out = self.outputs(inputs_of(states, counts)).astype(np.float64)
        return Motion(
            np.exp(out[:, 0]).tolist(),
            (SECTOR_DEG * out[:, 2:].argmax(axis=1)).tolist(),
            (0.5 * (1.0 + np.tanh(0.5 * out[:, 1]))).tolist(),
        )


def inputs_of(states: Mapping[str, Float32s], counts: Counts) -> Float32s:
    """Inputs of the first layer (n, width): a summary of the network's states (n, numbers), the
    frame (n, taxels) that led to them, and the energy of the last 100 ms of changes."""
    latest = abs(states[CHANGES][:, -ENERGY_SAMPLES * counts.shape[1] :])
    energy = np.log(latest.mean(axis=1, keepdims=True) + np.float32(LEAST_ENERGY))
    if FOUND in states:  # a gated tcn: its features of now, and the greatest of those it holds
        found = states[FOUND].reshape(len(states[FOUND]), HELD, -1)
        summary: tuple[Float32s, ...] = (found[:, -1], found.max(axis=1))
    else:
        summary = (states[SUMMARY],)
    return np.concatenate([*summary, counts / np.float32(COUNTS_SCALE), energy], axis=1)


def width_of(loaded: LoadedNetwork) -> int:
    """How many numbers that is; raises UsageError of a network that keeps no such state."""
    if not {SUMMARY, CHANGES} <= loaded.states.keys():
        raise UsageError(f"{loaded.card.name} keeps no state", "give a network that streams")
    if math.prod(loaded.states.get(FOUND, (HELD,))) % HELD:
        raise UsageError(f"{loaded.card.name} holds other samples", f"give one of {HELD} and now")
    one = {name: np.zeros((1, *shape), np.float32) for name, shape in loaded.states.items()}
    return len(inputs_of(one, np.zeros((1, loaded.taxels), np.float32))[0])


def selu(x: Float32s) -> Float32s:
    """Klambauer et al. 2017."""
    scale, alpha = np.float32(1.0507009873554805), np.float32(1.6732632423543772)
    out: Float32s = scale * np.where(x > 0, x, alpha * np.expm1(np.minimum(x, 0)))
    return out


def outputs_path(weights: Path) -> Path:
    """Where the auxiliary outputs of a weights file lie, if it has any."""
    return weights.with_name(weights.stem + SUFFIX)


def read_outputs(weights: Path, digest: str, loaded: LoadedNetwork) -> AuxiliaryOutputs | None:
    """Auxiliary outputs beside a network's weights, if it has any; raises BadFile for a damaged
    file, and for one of another network (another ``digest``)."""
    path = outputs_path(weights)
    remedy = REINSTALL if is_packaged(weights) else REMEDY
    if not path.exists():
        return None
    try:
        with path.open("rb") as opened:
            file = msgspec.json.decode(opened.read(LARGEST_BYTES), type=OutputsFile)
        made = AuxiliaryOutputs(file)
    except (OSError, ValueError, RecursionError) as error:  # also layers that are no rectangles
        raise BadFile(path, f"holds no auxiliary outputs: {error}", remedy) from None
    if file.network != digest:
        raise BadFile(path, f"is of another network than {weights.name}", remedy)
    width, hidden = width_of(loaded), len(file.layers[0].bias)
    shapes = [array.shape for layer in made.layers for array in layer]
    if shapes != [(width, hidden), (hidden,), (hidden, OUTPUTS), (OUTPUTS,)]:
        raise BadFile(path, f"does not lead from {width} to {OUTPUTS} numbers", remedy)
    return made
