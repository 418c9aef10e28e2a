"""Export of a trained network to its weights file.

The graph of a windowed network is the network itself. That of a streaming network is one step that
takes a frame, the frame before it and the state. Its output is the calibrated probability.
"""

import math
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from detector.network_file import FORMAT, Mode, NetworkCard, read_network, with_checksum
from detector.recordings import Recording, write_whole
from detector.training.fit import Training
from detector.training.networks import (
    Averaged,
    Features,
    GatedTcn,
    SlipGru,
    log_odds,
    odds_of,
    parts_of,
)
from detector.training.settings import SHIFT_MEAN, WINDOW, shift_taps
from detector.training.validation import calibration, likelihood
from drivers.interfaces import FINGERS

THRESHOLD = 0.5  # of a calibrated probability: the more likely class
OPSET = 17
# the only operator that this exporter does not know
torch.onnx.register_custom_op_symbolic("aten::asinh", lambda g, x: g.op("Asinh", x), OPSET)  # type: ignore[attr-defined]


def export(training: Training, validation: list[Recording], path: Path, commit: str) -> NetworkCard:
    """Calibrate the network on the validation recordings of the paper's kind (on all if there are
    none) and write ``path``. Returns the card read back from the file."""
    slides = [r for r in validation if r.metadata is None or r.metadata.set == "slide"]
    s, scored = training.settings, slides or validation
    z = np.concatenate([o.ravel() for o in odds_of(training.network, training.arch, scored)])
    y = np.concatenate([np.repeat(r.label(s.label), r.fingers) for r in scored])
    temperature, shift = calibration(z, y)
    calibrated = (z + shift) / temperature
    figures = {"loss": likelihood(calibrated, y), "accuracy": float(((calibrated > 0) == y).mean())}
    if training.best is not None and math.isfinite(training.best.delay_ms):
        figures["mean_delay_ms_within_budget"] = training.best.delay_ms
    mode: Mode = "stream" if training.arch.streaming else "window"
    before = training.arch.memory - 1 if training.arch.family == "tcn" else 0
    card = NetworkCard(
        format=FORMAT, name=training.name, mode=mode,
        window=before if mode == "stream" else WINDOW, threshold=THRESHOLD,
        parameters=sum(p.numel() for p in training.network.parameters()),
        mean_counts=training.statistics.mean, std_counts=training.statistics.std,
        change_scale_counts=training.statistics.change_scale, temperature=temperature, shift=shift,
        data_digest=training.data_digest, label=s.label, augmentation=s.augmentation,
        balance=s.balance, seed=s.seed, commit=commit, steps=training.step,
        training_minutes=round(training.minutes, 2), validation=figures,
    )  # fmt: skip
    write_whole(path, make_file(training.network, card))
    return read_network(path).card


def make_file(network: nn.Module, card: NetworkCard) -> bytes:
    """Content of the weights file of a network with that card."""
    written = BytesIO()
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # the newer exporter needs another package
        step = _step_of(network)
        inputs = {name: torch.zeros(FINGERS, *shape) for name, shape in step.inputs.items()}
        outputs = ["probability", *(f"next_{name}" for name in inputs if name.startswith("state"))]
        torch.onnx.export(
            _Calibrated(step, card.shift, card.temperature).eval(), tuple(inputs.values()), written,  # type: ignore[arg-type]
            input_names=list(inputs), output_names=outputs, opset_version=OPSET, dynamo=False,
            dynamic_axes={name: {0: "fingers"} for name in (*inputs, *outputs)},
        )  # fmt: skip
    return with_checksum(onnx.load_from_string(written.getvalue()), card)


class _Calibrated(nn.Module):
    """A step that outputs the calibrated probability instead of log-odds."""

    def __init__(self, step: "_Step", shift: float, temperature: float) -> None:
        super().__init__()
        self.step, self.shift, self.temperature = step, shift, temperature

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        odds, *states = self.step(*inputs)
        return torch.sigmoid((odds + self.shift) / self.temperature), *states


class _Window(nn.Module):
    """Log-odds of the last sample of a window."""

    def __init__(self, network: Any) -> None:
        super().__init__()
        self.network, arch = network, network.arch
        self.inputs = {"counts": (WINDOW, arch.taxels)}

    def forward(self, counts: Tensor) -> tuple[Tensor]:
        return (self.network(counts)[:, -1],)


class _FrameFeatures(nn.Module):
    """Features of one frame; ``state1`` has the changes that determine the shift."""

    def __init__(self, features: Features) -> None:
        super().__init__()
        self.features = features
        taps, taxels = torch.tensor(shift_taps()), features.taxels
        self.kept = (len(taps) - 1) * taxels
        self.matrix = torch.kron(taps[:, None], torch.eye(taxels)) / SHIFT_MEAN

    def forward(self, counts: Tensor, previous: Tensor, kept: Tensor) -> tuple[Tensor, Tensor]:
        """Features (fingers, width), and the next state."""
        changes = counts - previous
        latest = torch.cat([kept, changes], dim=1)
        scaled = self.features.scaled(counts, changes, lambda: latest @ self.matrix)
        return scaled, latest[:, self.features.taxels :]


class _GruStep(nn.Module):
    """Step of a `SlipGru`; ``state0`` is the hidden state of the recurrent layer."""

    def __init__(self, network: SlipGru) -> None:
        super().__init__()
        self.network, self.features = network, _FrameFeatures(network.features)
        frame = (network.arch.taxels,)
        self.inputs = {
            "counts": frame, "previous": frame,
            "state0": (network.arch.channels,), "state1": (self.features.kept,),
        }  # fmt: skip

    def forward(
        self, counts: Tensor, previous: Tensor, state0: Tensor, state1: Tensor
    ) -> tuple[Tensor, ...]:
        x, state1 = self.features(counts, previous, state1)
        hidden = self.network.gru(x[:, None], state0[None])[1][0]
        return log_odds(self.network.out(hidden)), hidden, state1


class _GatedStep(nn.Module):
    """Step of a `GatedTcn`. ``state0`` has the past inputs of every block, ``state2`` the latest
    sums of their outputs, the newest last."""

    def __init__(self, network: GatedTcn) -> None:
        super().__init__()
        self.network, self.features = network, _FrameFeatures(network.features)
        arch = network.arch
        n, self.width = arch.channels, arch.channels * len(arch.dilations)
        length = (arch.kernel - 1) * max(arch.dilations)
        frame = (arch.taxels,)
        self.inputs = {
            "counts": frame, "previous": frame, "state0": (length * self.width,),
            "state1": (self.features.kept,), "state2": ((arch.held - 1) * n,),
        }  # fmt: skip
        age = torch.arange(arch.kernel - 1, 0, -1)  # samples over the dilation; the oldest first
        self.taps = [
            ((length - age * dilation)[:, None] * self.width + i * n + torch.arange(n)).ravel()
            for i, dilation in enumerate(arch.dilations)
        ]

    def forward(
        self, counts: Tensor, previous: Tensor, state0: Tensor, state1: Tensor, state2: Tensor
    ) -> tuple[Tensor, ...]:
        arch = self.network.arch
        x, state1 = self.features(counts, previous, state1)
        x = self.network.enter(x)
        blocks: Any = self.network.blocks
        halves = [arch.channels, arch.channels]
        inputs: list[Tensor] = [x]  # of the blocks
        total: Any = None
        for taps, block in zip(self.taps, blocks, strict=True):
            taken = torch.cat([state0[:, taps], inputs[-1]], dim=1)
            value, gate = block.conv(taken).split(halves, dim=1)
            output = torch.tanh(value) * torch.sigmoid(gate)
            total = output if total is None else total + output
            inputs.append(x + total)
        latest = torch.cat([state2, total], dim=1)
        maximum = latest.reshape(-1, arch.held, arch.channels).amax(dim=1)
        odds = log_odds(self.network.out(torch.cat([total, maximum], dim=1)))
        next0 = torch.cat([state0[:, self.width :], *inputs[:-1]], dim=1)
        return odds, next0, state1, latest[:, arch.channels :]


class _AveragedStep(nn.Module):
    """Step of two `Averaged` networks. They share the frames and ``state1``; ``state3`` and
    ``state4`` are ``state0`` and ``state2`` of the second."""

    def __init__(self, network: Averaged) -> None:
        super().__init__()
        self.one, self.other = (_GatedStep(part) for part in parts_of(network))
        own = self.other.inputs
        self.inputs = self.one.inputs | {"state3": own["state0"], "state4": own["state2"]}

    def forward(
        self, counts: Tensor, previous: Tensor, state0: Tensor, state1: Tensor, state2: Tensor,
        state3: Tensor, state4: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        one, *nexts = self.one(counts, previous, state0, state1, state2)
        other, next3, _, next4 = self.other(counts, previous, state3, state1, state4)
        return (one + other) / 2.0, *nexts, next3, next4


_Step = _Window | _GruStep | _GatedStep | _AveragedStep


def _step_of(network: nn.Module) -> _Step:
    if isinstance(network, Averaged):
        return _AveragedStep(network)
    if isinstance(network, GatedTcn):
        return _GatedStep(network)
    return _GruStep(network) if isinstance(network, SlipGru) else _Window(network)
