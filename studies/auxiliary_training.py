"""Training of auxiliary outputs on the state of an unchanged network, in one thread."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from detector.auxiliary_outputs import OUTPUTS, Dense, OutputsFile

WIDTH, BATCH = 32, 1024
LEARNING_RATE, FINAL_RATE, WEIGHT_DECAY = 3e-3, 1e-5, 1e-5
SPEED_SCALE = 0.5  # of the logarithm: the loss of larger errors is linear, not quadratic
SLIDES_TO_TURNS = 6.0  # weight of rotations, because they are that much rarer


class OutputTargets(msgspec.Struct, frozen=True, eq=False):
    """Inputs and targets of one data set."""

    inputs: NDArray[np.float32]  # (n, width)
    log_speed: NDArray[np.float64]  # (n,)
    turning: NDArray[np.bool_]  # (n,)
    sector: NDArray[np.intp]  # (n,)


def train_outputs(
    sets: Sequence[OutputTargets],
    seed: int,
    steps: int,
    network: str,
    data_digest: str,
    commit: str,
) -> OutputsFile:
    """Outputs of the network with that digest, without scores; all sets have equal weight."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    inputs = np.concatenate([each.inputs for each in sets])
    middle, spread = inputs.mean(axis=0), inputs.std(axis=0) + 1e-3
    x = torch.tensor((inputs - middle) / spread)
    speed, turning, sector = (
        torch.tensor(np.concatenate(each))
        for each in (
            [s.log_speed.astype(np.float32) for s in sets],
            [s.turning.astype(np.float32) for s in sets],
            [s.sector for s in sets],
        )
    )
    of_set = np.split(np.arange(len(inputs)), np.cumsum([len(s.inputs) for s in sets])[:-1])
    outputs = nn.Sequential(nn.Linear(inputs.shape[1], WIDTH), nn.SELU(), nn.Linear(WIDTH, OUTPUTS))
    optimiser = torch.optim.Adam(outputs.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    for step in range(steps):
        cosine = 0.5 + 0.5 * math.cos(math.pi * step / steps)
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * cosine + FINAL_RATE
        some = [of[rng.integers(0, len(of), BATCH // len(sets))] for of in of_set]
        rows = torch.tensor(np.concatenate(some))
        loss = _loss(outputs(x[rows]), speed[rows], turning[rows], sector[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return OutputsFile(
        network=network, data_digest=data_digest, seed=seed,
        commit=commit, samples=len(inputs), scores={}, layers=_layers(outputs, middle, spread),
    )  # fmt: skip


def _loss(out: Tensor, speed: Tensor, turning: Tensor, sector: Tensor) -> Tensor:
    """Sum of the losses of speed, kind of motion and direction; rotations have no direction."""
    of_speed = nn.functional.smooth_l1_loss(out[:, 0], speed, beta=SPEED_SCALE)
    of_kind = nn.functional.binary_cross_entropy_with_logits(
        out[:, 1], turning, pos_weight=torch.tensor(SLIDES_TO_TURNS)
    )
    each = nn.functional.cross_entropy(out[:, 2:], sector, reduction="none")
    loss: Tensor = of_speed + of_kind + (each * (1.0 - turning)).mean()
    return loss


def _layers(
    outputs: nn.Sequential, middle: NDArray[np.float32], spread: NDArray[np.float32]
) -> tuple[Dense, Dense]:
    """Layers for the file; the first takes inputs that are not standardised."""
    w1, b1, w2, b2 = (p.detach().numpy().astype(np.float64) for p in outputs.parameters())
    scaled = w1 / spread
    b2[1] -= math.log(SLIDES_TO_TURNS)  # undo the weight of rotations
    return _dense(scaled, b1 - scaled @ middle), _dense(w2, b2)


def _dense(weight: NDArray[np.float64], bias: NDArray[np.float64]) -> Dense:
    """Layer rounded to the digits of 32-bit numbers."""
    rows = [[float(f"{x:.7g}") for x in row] for row in (*weight.tolist(), bias.tolist())]
    return Dense(rows[:-1], rows[-1])
