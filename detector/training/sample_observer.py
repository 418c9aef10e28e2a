"""What could be known of every sample by who hears all that came before it: an ensemble without
limits of size or cost on the counts and on what detectors said. No detector: it runs nowhere but in
a study, and it is told of no event when it came, as a detector is not."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from detector.decision import log_odds
from detector.recordings import Recording
from detector.scores.evaluation import Streamed
from detector.training.sequences import targets

Floats = NDArray[np.float32]
NEAR, LAGGED = 3, (6, 12, 25, 50)  # samples: a level of late, and those it is held against
SHAKEN = (2, 4, 8, 16, 32, 64)  # samples over which changes are averaged
SAID = (5, 15)  # samples over which the most and the mean of what was said are taken
MEMBERS, WIDTH, BATCH, EPOCHS = 2, 96, 256, 10
LEARNING_RATE, WEIGHT_DECAY, UNHEARD = 3e-3, 1e-2, 0.1


def features(recording: Recording, said: Sequence[Streamed], ahead: int = 0) -> Floats:
    """What is known at every sample, (n, d), or so many samples later.

    Of every taxel how it stands against its own past, and how it was shaken; the same of fingers
    and of the hand; what detectors said, of late too.
    """
    counts = recording.counts.astype(np.float64)  # (n, fingers, taxels)
    level = {w: _mean(counts, w) for w in (NEAR, *LAGGED)}
    late = [level[NEAR] - _later(level[w], NEAR) for w in LAGGED]
    change = np.abs(np.diff(counts, axis=0, prepend=counts[:1]))
    every = np.stack([*late, *(_mean(change, w) for w in SHAKEN)], axis=3)
    n = len(counts)
    strength = np.sqrt((every**2).sum(axis=2))  # (n, fingers, kinds)
    sums = np.stack([v.sum(axis=2) for v in (*late, level[NEAR])], axis=2)
    of_fingers = [np.log1p(strength), np.arcsinh(sums / 4.0), *map(_of_late, said)]
    each = np.concatenate(of_fingers, axis=2)
    pooled = [each.mean(axis=1), each.max(axis=1), each.min(axis=1)] if counts.shape[1] > 1 else []
    told = [np.arcsinh(every / 4.0).reshape(n, -1), each.reshape(n, -1), *pooled]
    known = np.concatenate(told, axis=1).astype(np.float32)
    return known[np.minimum(np.arange(n) + ahead, n - 1)]


def fused_features(said: Streamed) -> Floats:
    """What a head for a hand knows of what its fingers' network said, (n, d): of the surest finger,
    the next and the last, now and of late."""
    each = np.sort(_of_late(said), axis=1)
    return each.reshape(len(each), -1).astype(np.float32)


def _of_late(streamed: Streamed) -> NDArray[np.float64]:
    odds = log_odds(streamed.probabilities)
    past = [_later(odds, k) for k in range(1, max(SAID))]
    most = [np.max([odds, *past[: w - 1]], axis=0) for w in SAID]
    return np.stack([odds, *most, *(_mean(odds, w) for w in SAID)], axis=2)


def _mean(values: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Of the last so many; the first stands for what came before it."""
    total = np.cumsum(np.concatenate([np.repeat(values[:1], samples, axis=0), values]), axis=0)
    found: NDArray[np.float64] = (total[samples:] - total[:-samples]) / samples
    return found


def _later(values: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    return np.concatenate([np.repeat(values[:1], samples, axis=0), values[:-samples]])


def held_out(
    recordings: Sequence[Recording], known: Sequence[Floats], folds: int, every: int = 1,
    seed: int = 0,
) -> list[NDArray[np.float64]]:  # fmt: skip
    """Probability of slip (n, 1) at every sample of each recording, by an ensemble that has learnt
    from the recordings of the other folds alone: every so many of their samples, labelled as
    networks learn them (`targets`)."""
    torch.set_num_threads(1)
    learnt = [targets(r, "slip") for r in recordings]
    found: list[NDArray[np.float64]] = [np.empty(0)] * len(recordings)
    for fold in range(folds):
        taught = [i for i in range(len(recordings)) if i % folds != fold]
        x, y, weight = (
            torch.tensor(np.concatenate([part[::every] for part in column]), dtype=torch.float32)
            for column in (
                [known[i] for i in taught], [learnt[i][0] for i in taught],
                [learnt[i][1] for i in taught],
            )
        )  # fmt: skip
        middle, spread = x.mean(dim=0), x.std(dim=0) + 1e-6
        x = (x - middle) / spread
        networks = [_fitted(x, y, weight, seed + k) for k in range(MEMBERS)]
        for i in range(fold, len(recordings), folds):
            asked = (torch.tensor(known[i]) - middle) / spread
            with torch.no_grad():
                odds = torch.stack([network(asked)[:, 0] for network in networks]).mean(dim=0)
            found[i] = torch.sigmoid(odds).double().numpy()[:, None]
    return found


def _fitted(
    inputs: torch.Tensor, labels: torch.Tensor, weight: torch.Tensor, seed: int
) -> nn.Module:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network = nn.Sequential(
        nn.Dropout(UNHEARD),
        nn.Linear(inputs.shape[1], WIDTH), nn.GELU(), nn.Dropout(UNHEARD),
        nn.Linear(WIDTH, WIDTH), nn.GELU(), nn.Dropout(UNHEARD),
        nn.Linear(WIDTH, 1),
    )  # fmt: skip
    batches = max(1, len(inputs) // BATCH)
    optimiser = torch.optim.AdamW(
        network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY, foreach=False
    )
    pace = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, LEARNING_RATE, total_steps=EPOCHS * batches
    )
    for _ in range(EPOCHS):
        for rows in np.array_split(rng.permutation(len(inputs)), batches):
            loss = nn.functional.binary_cross_entropy_with_logits(
                network(inputs[rows])[:, 0], labels[rows], weight[rows]
            )
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            pace.step()
    return network.eval()
