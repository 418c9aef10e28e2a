"""What kind of slip: small heads on the state of a network that was trained for slip alone.

They lie beside its weights as `NAME.heads.json` and leave them as they are, so that the probability
of slip is what it is without them, bit for bit. A network that has none goes on as before.
"""

import math
import os
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.motion import SECTOR_DEG, SECTORS, Motion
from detector.network_file import REINSTALL, LoadedNetwork, is_packaged
from drivers.errors import BadFile, UsageError

FORMAT = 1
SUFFIX = ".heads.json"
WITH_HEADS = ("gru", "tcn")  # of the packaged networks
CHANGES = "state1"  # that a network keeps, newest last
SUMMARY = "state0"  # all that a recurrent network makes of what it felt
FOUND = "state2"  # of a gated tcn: what all its blocks found in the latest samples, newest last
HELD = 14  # samples of it; its head hears the next one as well
LARGEST_BYTES = 500_000  # ours are a thirtieth of it
OUTPUTS = 2 + SECTORS  # logarithm of the speed, log-odds of turning, scores of the directions
ENERGY_SAMPLES, LEAST_ENERGY = 10, 0.1  # counts a sample: a tenth of what a taxel at rest has
COUNTS_SCALE = 130.0
REMEDY = "train it again (`python -m studies slip_types --train` in the source), or remove it"
Float32s = NDArray[np.float32]
Counts = NDArray[np.int16] | Float32s
Scores = dict[str, tuple[float, float, float]]


class Dense(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One layer: outputs are ``weight`` (outputs, inputs) times inputs, and ``bias``."""

    weight: list[list[float]]
    bias: list[float]


class Heads(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A file of heads: two layers with a SELU between, and where they come from.

    ``network``: SHA-256 of the weights file that they were trained on, whose state they read.
    ``scores``: on the split `test`, each with its 95 % interval over recordings.
    """

    format: Annotated[int, Meta(ge=FORMAT, le=FORMAT)]
    network: str
    data_digest: str
    seed: int
    commit: str
    samples: int
    scores: Scores
    layers: tuple[Dense, Dense]


class Teller:
    """Heads, ready to be asked."""

    def __init__(self, heads: Heads) -> None:
        self.heads = heads
        self._layers = [
            (np.array(layer.weight, np.float32).T.copy(), np.array(layer.bias, np.float32))
            for layer in heads.layers
        ]

    def outputs(self, inputs: Float32s) -> Float32s:
        """(..., OUTPUTS) of inputs (..., width)."""
        (w1, b1), (w2, b2) = self._layers
        out: Float32s = selu(inputs @ w1 + b1) @ w2 + b2
        return out

    def tell(self, states: Mapping[str, Float32s], counts: Counts) -> Motion:
        """Of the states that the frame (fingers, taxels) led to."""
        out = self.outputs(inputs_of(states, counts)).astype(np.float64)
        return Motion(
            np.exp(out[:, 0]).tolist(),
            (SECTOR_DEG * out[:, 2:].argmax(axis=1)).tolist(),
            (0.5 * (1.0 + np.tanh(0.5 * out[:, 1]))).tolist(),
        )


def inputs_of(states: Mapping[str, Float32s], counts: Counts) -> Float32s:
    """What heads are given (n, width): what the network made of what it felt, of its states
    (n, numbers); the frame that led to them, (n, taxels) counts; and of the changes that it keeps
    the energy of the last 100 ms."""
    latest = abs(states[CHANGES][:, -ENERGY_SAMPLES * counts.shape[1] :])
    energy = np.log(latest.mean(axis=1, keepdims=True) + np.float32(LEAST_ENERGY))
    return np.concatenate([*made_of(states), counts / np.float32(COUNTS_SCALE), energy], axis=1)


def made_of(states: Mapping[str, Float32s]) -> tuple[Float32s, ...]:
    """What a network made of what it felt, (n, numbers) each: a recurrent one its state; a gated
    tcn its features of now and the greatest of those that its head holds, as that head hears."""
    if FOUND not in states:
        return (states[SUMMARY],)
    found = states[FOUND].reshape(len(states[FOUND]), HELD, -1)
    return found[:, -1], found.max(axis=1)


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


def heads_path(weights: Path) -> Path:
    """Where the heads of a weights file lie, if it has any."""
    return weights.with_name(weights.stem + SUFFIX)


def read_heads(weights: Path, digest: str, loaded: LoadedNetwork) -> Teller | None:
    """Heads beside a network's weights; None where it has none.

    Raises BadFile for what is none, for heads of another network (another ``digest``), and where
    those of a packaged network have gone.
    """
    path = heads_path(weights)
    packaged = is_packaged(weights)
    remedy = REINSTALL if packaged else REMEDY
    if not os.path.lexists(path):
        if packaged and weights.stem in WITH_HEADS:
            raise BadFile(path, "is missing", remedy)
        return None
    try:
        if path.is_fifo():
            raise OSError("a named pipe, which may have no writer")
        content = path.read_bytes()[: LARGEST_BYTES + 1]
        heads = msgspec.json.decode(content, type=Heads)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadFile(path, f"holds no heads: {error}", remedy) from None
    if heads.network != digest:
        raise BadFile(path, f"is of another network than {weights.name}", remedy)
    if not _fits(heads, width_of(loaded)):
        raise BadFile(path, f"do not lead from {width_of(loaded)} to {OUTPUTS} numbers", remedy)
    return Teller(heads)


def _fits(heads: Heads, inputs: int) -> bool:
    """Whether the layers lead from so many inputs to the outputs, by numbers."""
    first, last = heads.layers
    sizes = (inputs, len(first.bias), OUTPUTS)
    for layer, (width, out) in zip((first, last), pairwise(sizes), strict=True):
        rows = [*layer.weight, layer.bias]
        if len(layer.weight) != out or len(layer.bias) != out:
            return False
        if any(len(row) != width for row in layer.weight):
            return False
        if not all(math.isfinite(x) for row in rows for x in row):
            return False
    return True
