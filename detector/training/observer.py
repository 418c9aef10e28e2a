"""A classifier without limits of size or cost, told when something happened: what an ideal observer
would say, as nearly as such a one comes. No detector: it runs nowhere but in a study."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Floats = NDArray[np.float64]
MEMBERS = 3  # of an ensemble, their log-probabilities averaged
WIDTH, BATCH, EPOCHS = 96, 256, 30
LEARNING_RATE, WEIGHT_DECAY = 3e-3, 1e-2
UNHEARD, DROPOUT = 0.1, 0.3  # of the inputs, of what is inside


def held_out(
    features: Floats, classes: NDArray[np.intp], groups: NDArray[np.intp], folds: int, seed: int = 0
) -> Floats:
    """Log-probabilities (n, classes) of each row of features (n, d) by an ensemble that has learnt
    from the rows of other groups (n,) alone: those of the other folds."""
    torch.set_num_threads(1)
    fold = groups % folds
    told = np.zeros((len(features), int(classes.max()) + 1))
    for k in range(folds):
        learnt, asked = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        middle, spread = features[learnt].mean(axis=0), features[learnt].std(axis=0) + 1e-6
        inputs = torch.tensor((features - middle) / spread, dtype=torch.float32)
        labels = torch.tensor(classes)
        for member in range(MEMBERS):
            network = _fitted(inputs[learnt], labels[learnt], told.shape[1], seed + member)
            with torch.no_grad():
                said = torch.log_softmax(network(inputs[asked]), dim=1)
            told[asked] += said.numpy() / MEMBERS
    return told


def _fitted(inputs: Tensor, labels: Tensor, classes: int, seed: int) -> nn.Module:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network = nn.Sequential(
        nn.Dropout(UNHEARD),
        nn.Linear(inputs.shape[1], WIDTH), nn.GELU(), nn.Dropout(DROPOUT),
        nn.Linear(WIDTH, WIDTH), nn.GELU(), nn.Dropout(DROPOUT),
        nn.Linear(WIDTH, classes),
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
            loss = nn.functional.cross_entropy(network(inputs[rows]), labels[rows])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            pace.step()
    return network.eval()
