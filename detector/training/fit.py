"""The training loop: one thread, with checkpoints to resume from.

All random numbers of a step depend on the seed and the step's number, so a resumed training ends
with the same weights as an uninterrupted one.
"""

import math
import time
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from detector.recordings import Recording, write_whole
from detector.training.augment import augment
from detector.training.networks import build_network, odds_of, parts_of
from detector.training.sequences import (
    Batch,
    FingerSequences,
    Windows,
    finger_sequences,
    random_crops,
    statistics,
)
from detector.training.settings import WINDOW, TrainSettings, of_layout
from detector.training.validation import Score, score
from drivers.errors import BadFile

CHECKPOINT_S = 30.0
CLIP_NORM = 1.0  # of the gradient; the authors'
RESTART = "--force in place of --resume starts from the beginning"


class Training:
    """Training of one network on one set of recordings, by `run`."""

    def __init__(
        self,
        name: str,
        settings: TrainSettings,
        train: Sequence[Recording],
        validation: Sequence[Recording],
        data_digest: str,
    ) -> None:
        torch.set_num_threads(1)
        torch.manual_seed(settings.seed % 2**31)
        self.name, self.settings, self.data_digest = name, settings, data_digest
        self._validation = validation
        self._fingers = finger_sequences(train, settings.label, settings.evenness)
        self.arch = of_layout(name, self._fingers.taxels)
        self.statistics = statistics(self._fingers, per_taxel=not self.arch.streaming)
        self.network = build_network(self.arch)
        for part in parts_of(self.network):
            part.features.mean.copy_(torch.tensor(self.statistics.mean))
            part.features.std.copy_(torch.tensor(self.statistics.std))
            part.features.change_scale.fill_(self.statistics.change_scale)
        self._optimiser = torch.optim.Adam(self.network.parameters(), settings.learning_rate)
        self._batches = _Batches(settings, self._fingers)
        self._slip_weight = 1.0 / self._fingers.slip_share - 1.0
        self.shift = -math.log(self._slip_weight)  # to the true share, since classes are balanced
        self.step, self._spent_s, self._waited = 0, 0.0, 0
        self.best: Score | None = None
        self._best_weights: dict[str, torch.Tensor] = {}

    @property
    def minutes(self) -> float:
        """Processor time, minutes, including the runs before it was resumed."""
        return self._spent_s / 60.0

    @property
    def stalled(self) -> bool:
        """Whether ``patience`` validations in a row have not improved."""
        return self._waited >= self.settings.patience

    def run(
        self, minutes: float, checkpoint: Path | None, report: Callable[[float, Score | None], None]
    ) -> None:
        """Train until all steps are done, the time is up or validation no longer improves.

        Ctrl-C leaves a checkpoint. At the end the network has its best weights. ``report`` gets the
        loss of each step, and the score if a validation followed it.
        """
        every = max(1, self.settings.steps // self.settings.validations)
        saved_s = self._spent_s
        self.network.train()
        try:
            while self.step < self.settings.steps and not self.stalled:
                before_s = time.process_time()
                loss = self._learn()
                due = self.step % every == 0 or self.step == self.settings.steps
                out_of_time = self._spent_s > minutes * 60.0
                validated = self._validate() if due or out_of_time else None
                self._spent_s += time.process_time() - before_s
                report(loss, validated)
                if checkpoint is not None and self._spent_s - saved_s > CHECKPOINT_S:
                    self.save(checkpoint)
                    saved_s = self._spent_s
                if out_of_time:
                    break
        finally:
            if checkpoint is not None:
                self.save(checkpoint)
        if not self._best_weights:  # interrupted in the last validation, then resumed
            self._validate()
        self.network.load_state_dict(self._best_weights)

    def _learn(self) -> float:
        """Make one step; returns its loss."""
        s = self.settings
        rng = np.random.default_rng([s.seed, self.step])
        torch.manual_seed(int(rng.integers(2**31)))
        batch = self._batches.batch(self.step)
        counts = torch.from_numpy(augment(batch.counts, s.augmentation, rng))
        labels, weights = torch.from_numpy(batch.labels), torch.from_numpy(batch.weights)
        if s.balance == "weights":
            weights = weights * torch.where(labels > 0, self._slip_weight, 1.0)
        for group in self._optimiser.param_groups:
            group["lr"] = self._rate()
        self._optimiser.zero_grad()
        parts, total = parts_of(self.network), 0.0
        for part in parts:  # each learns as if alone
            odds = _fused(part(counts, last=not s.dense), batch.hands)
            each = nn.functional.binary_cross_entropy_with_logits(odds, labels, reduction="none")
            loss = (each * weights).sum() / weights.sum()
            loss.backward()
            nn.utils.clip_grad_norm_(part.parameters(), CLIP_NORM)
            total += float(loss.detach())
        self._optimiser.step()
        self.step += 1
        return total / len(parts)

    def _rate(self) -> float:
        s = self.settings
        cosine = 0.5 * (1.0 + math.cos(math.pi * self.step / s.steps))
        return s.learning_rate * (s.final_rate + (1.0 - s.final_rate) * cosine)

    def _validate(self) -> Score:
        s, odds = self.settings, odds_of(self.network, self.arch, self._validation)
        latest = score(odds, self._validation, s.label, self.shift)
        if latest.better_than(self.best):
            self.best, self._waited = latest, 0
            self._best_weights = {k: v.clone() for k, v in self.network.state_dict().items()}
        else:
            self._waited += 1
        return latest

    def save(self, path: Path) -> None:
        """Write a checkpoint for `resume` atomically. Raises OSError with the file's name."""
        best = msgspec.structs.asdict(self.best) if self.best else None
        state = {
            "identity": self._identity(), "step": self.step, "spent_s": self._spent_s,
            "waited": self._waited, "best": best, "network": self.network.state_dict(),
            "best_weights": self._best_weights, "optimiser": self._optimiser.state_dict(),
        }  # fmt: skip
        written = BytesIO()  # on a full disk, torch reports a position instead of the disk
        torch.save(state, written)
        write_whole(path, written.getvalue())

    def resume(self, path: Path) -> None:
        """Continue from a checkpoint. Raises BadFile.

        Only tensors and plain values are read (``weights_only``): code in a file is never executed.
        """
        try:
            stored = torch.load(path, weights_only=True)
        except FileNotFoundError:
            raise BadFile(path, "no such file", "omit --resume to start a new training") from None
        except Exception as error:  # torch raises many kinds for damage
            raise BadFile(path, f"cannot be read ({type(error).__name__})", RESTART) from None
        identity = stored.get("identity") if isinstance(stored, dict) else None
        if identity != self._identity():
            remedy = f"give the settings and data it was started with, or {RESTART}"
            raise BadFile(path, "is of other settings, data or another network", remedy)
        self.network.load_state_dict(stored["network"])
        self._optimiser.load_state_dict(stored["optimiser"])
        self._best_weights = stored["best_weights"]
        self.step, self._spent_s, self._waited = (stored[k] for k in ("step", "spent_s", "waited"))
        self.best = msgspec.convert(stored["best"], Score | None)

    def _identity(self) -> str:
        settings = msgspec.json.encode([self.arch, self.settings]).decode()
        return f"{self.name} {self.data_digest} {settings}"


def _fused(odds: torch.Tensor, hands: NDArray[np.intp]) -> torch.Tensor:
    """Log-odds (batch, time) with those of each finger replaced by the mean over its hand."""
    of = torch.from_numpy(hands)
    sums = odds.new_zeros(int(hands[-1]) + 1, odds.shape[1]).index_add(0, of, odds)
    return (sums / torch.bincount(of)[:, None])[of]


class _Batches:
    """Batches by step: random crops for streaming networks, epochs of windows for the others."""

    def __init__(self, settings: TrainSettings, fingers: FingerSequences) -> None:
        self._settings, self._fingers = settings, fingers
        self._windows = None if settings.dense else Windows(fingers, WINDOW)
        self._epoch = -1
        self._chosen = np.empty(0, np.intp)

    def batch(self, step: int) -> Batch:
        s = self._settings
        if self._windows is None:
            rng = np.random.default_rng([s.seed, step, 1])
            sizes = s.batch, s.crop, s.warm
            return random_crops(self._fingers, rng, *sizes, s.fresh, s.near_impacts)
        slip = int(self._windows.labels.sum())
        rest = len(self._windows.labels) - slip
        n = 2 * min(slip, rest) if s.balance == "undersample" else slip + rest
        epoch, at = divmod(step, max(1, n // s.batch))
        if epoch != self._epoch:
            self._chosen = self._windows.epoch(np.random.default_rng([s.seed, epoch, 2]), s.balance)
            self._epoch = epoch
        return self._windows.take(self._chosen[at * s.batch : (at + 1) * s.batch])
