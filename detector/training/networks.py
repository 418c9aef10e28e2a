"""Networks in torch: counts (batch, time, taxels) to log-odds of slip (batch, time).

`SlipTcn` and `FrequencyCnn` (after Meier et al. 2016) are those of Grover, Nadeau, Grebe and Kelly
2022, as in their code. `GatedTcn` and `SlipGru` are ours.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from detector.recordings import Recording
from detector.training.augment import modes
from detector.training.settings import (
    NORM_EPS,
    SHIFT_MEAN,
    SHIFT_SCALE_COUNTS,
    WINDOW,
    Architecture,
    Input,
    shift_taps,
)

WINDOWS_AT_ONCE = 512


class Features(nn.Module):
    """Standardised counts, changes from sample to sample, and shifts from a lagged mean; both are
    scaled by ``asinh``: linear for the noise of a taxel at rest, logarithmic for slip. If
    ``mirrored``, of the pad's modes, without the sign of those that a mirror image turns."""

    mean: Tensor  # (taxels,) counts
    std: Tensor  # (taxels,) counts
    change_scale: Tensor  # () counts a sample

    def __init__(self, inputs: tuple[Input, ...], taxels: int, mirrored: bool) -> None:
        super().__init__()
        self.inputs, self.taxels, self.mirrored = inputs, taxels, mirrored
        matrix, self.symmetric = modes(taxels)
        self.modes = torch.from_numpy(matrix)
        self.register_buffer("mean", torch.zeros(taxels))
        self.register_buffer("std", torch.ones(taxels))
        self.register_buffer("change_scale", torch.ones(()))

    @property
    def width(self) -> int:
        return len(self.inputs) * self.taxels

    def forward(self, counts: Tensor) -> Tensor:
        """Features (batch, time, width) of (batch, time, taxels); the first change is 0."""
        changes = torch.diff(counts, dim=1, prepend=counts[:, :1])
        return self.scaled(counts, changes, lambda: shifts(changes))

    def scaled(self, counts: Tensor, changes: Tensor, shifts: Callable[[], Tensor]) -> Tensor:
        """Scaled features (..., width) from counts, changes and shifts (..., taxels)."""
        parts = {
            "counts": lambda: self._sized((counts - self.mean) / self.std),
            "changes": lambda: torch.asinh(self._sized(changes) / self.change_scale),
            "shifts": lambda: torch.asinh(self._sized(shifts()) / SHIFT_SCALE_COUNTS),
        }
        return torch.cat([parts[name]() for name in self.inputs], dim=-1)

    def _sized(self, x: Tensor) -> Tensor:
        if not self.mirrored:
            return x
        symmetric, others = x @ self.modes[:, : self.symmetric], x @ self.modes[:, self.symmetric :]
        return torch.cat([symmetric, others.abs()], dim=-1)


def shifts(changes: Tensor) -> Tensor:
    """Difference of each sample to its lagged mean, counts, from changes (batch, time, taxels)."""
    batch, time, taxels = changes.shape
    taps = changes.new_tensor(shift_taps())
    series = changes.transpose(1, 2).reshape(batch * taxels, 1, time)
    padded = nn.functional.pad(series, (len(taps) - 1, 0))
    summed = nn.functional.conv1d(padded, taps[None, None])
    return summed.reshape(batch, taxels, time).transpose(1, 2) / SHIFT_MEAN


def layer_norm(width: int) -> nn.LayerNorm:
    return nn.LayerNorm(width, eps=NORM_EPS)


class CausalConv(nn.Module):
    """Convolution, layer norm over channels, SELU, channel dropout: half a residual block."""

    def __init__(self, width: int, arch: Architecture) -> None:
        super().__init__()
        self.conv = nn.Conv1d(width, arch.channels, arch.kernel)
        self.norm = layer_norm(arch.channels)
        self.drop = nn.Dropout1d(arch.dropout)
        nn.init.kaiming_normal_(self.conv.weight, nonlinearity="relu")
        nn.init.zeros_(self.conv.bias)  # type: ignore[arg-type]

    def forward(self, x: Tensor, dilation: int) -> Tensor:
        """(batch, width, time) to (batch, channels, time), padded with zeros at the start."""
        conv = self.conv
        padded = nn.functional.pad(x, ((conv.kernel_size[0] - 1) * dilation, 0))
        y = nn.functional.conv1d(padded, conv.weight, conv.bias, dilation=dilation)
        y = self.norm(y.transpose(1, 2)).transpose(1, 2)
        return self.drop(nn.functional.selu(y))


class Block(nn.Module):
    """Residual block: two convolutions of one dilation, and a skip connection."""

    def __init__(self, width: int, arch: Architecture) -> None:
        super().__init__()
        self.first = CausalConv(width, arch)
        self.second = CausalConv(arch.channels, arch)
        self.skip = nn.Conv1d(width, arch.channels, 1) if width != arch.channels else None

    def forward(self, x: Tensor, dilation: int) -> Tensor:
        skipped = x if self.skip is None else self.skip(x)
        return nn.functional.selu(skipped + self.second(self.first(x, dilation), dilation))


class Head(nn.Module):
    """Two dense layers with layer norm, SELU and dropout, then the output layer."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.dense1 = nn.Linear(arch.channels, arch.head)
        self.dense2 = nn.Linear(arch.head, arch.head)
        self.norm1, self.norm2 = (layer_norm(arch.head) for _ in range(2))
        self.out = nn.Linear(arch.head, arch.outputs)
        self.drop = nn.Dropout(arch.dropout)

    def forward(self, x: Tensor) -> Tensor:
        """(..., width) to log-odds (...)."""
        x = self.drop(nn.functional.selu(self.norm1(self.dense1(x))))
        x = self.drop(nn.functional.selu(self.norm2(self.dense2(x))))
        return log_odds(self.out(x))


class SlipTcn(nn.Module):
    """Temporal convolutional network of the paper, as in the authors' code (docs/detectors.md)."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.arch = arch
        self.features = Features(arch.inputs, arch.taxels, arch.mirrored)
        widths = [self.features.width] + [arch.channels] * (len(arch.dilations) - 1)
        self.blocks = nn.ModuleList(Block(width, arch) for width in widths)
        self.head = Head(arch)

    def forward(self, counts: Tensor, last: bool = False) -> Tensor:
        """Log-odds (batch, time), or (batch, 1) of the last step."""
        x = self.features(counts).transpose(1, 2)
        every = 1  # samples from one column of x to the next
        for block, dilation in zip(self.blocks, self.arch.dilations, strict=True):
            step = dilation // every if last else 1
            if step > 1:  # the last step depends on these samples only
                x, every = x[:, :, (x.shape[2] - 1) % step :: step], dilation
            x = block(x, dilation // every)
        x = x.transpose(1, 2)
        return self.head(x[:, -1:] if last else x)


class GatedBlock(nn.Module):
    """Gated convolution (WaveNet, van den Oord et al. 2016) as one matrix product, which is several
    times faster than torch's dilated convolution for so few channels."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.kernel = arch.kernel
        self.conv = nn.Linear(arch.kernel * arch.channels, 2 * arch.channels)

    def forward(self, x: Tensor, dilation: int) -> Tensor:
        """Output (batch, time, channels), between -1 and 1; padded with zeros at the start."""
        padded = nn.functional.pad(x, (0, 0, (self.kernel - 1) * dilation, 0))
        taps = [padded[:, i * dilation :][:, : x.shape[1]] for i in range(self.kernel)]
        value, gate = self.conv(torch.cat(taps, dim=2)).chunk(2, dim=2)
        return torch.tanh(value) * torch.sigmoid(gate)


class GatedTcn(nn.Module):
    """Gated temporal convolutions without layer norm, which would remove the signal's amplitude.
    A linear head takes the sum of all blocks: its latest value and its maximum over ``held``."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.arch = arch
        self.features = Features(arch.inputs, arch.taxels, arch.mirrored)
        self.enter = nn.Linear(self.features.width, arch.channels)
        self.blocks = nn.ModuleList(GatedBlock(arch) for _ in arch.dilations)
        self.out = nn.Linear(2 * arch.channels, arch.outputs)

    def forward(self, counts: Tensor, last: bool = False) -> Tensor:
        """Log-odds (batch, time), or (batch, 1) of the last step."""
        x = self.enter(self.features(counts))
        total = torch.zeros_like(x)
        for block, dilation in zip(self.blocks, self.arch.dilations, strict=True):
            total = total + block(x + total, dilation)
        both = torch.cat([total, greatest(total, self.arch.held)], dim=2)
        return log_odds(self.out(both[:, -1:] if last else both))


class Averaged(nn.Module):
    """Mean of the log-odds of networks with different inputs, each trained by its own loss."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.arch = arch
        self.parts = nn.ModuleList(map(build_network, arch.parts))

    def forward(self, counts: Tensor, last: bool = False) -> Tensor:
        """Log-odds (batch, time), or (batch, 1) of the last step."""
        return torch.stack([part(counts, last) for part in self.parts]).mean(dim=0)


def greatest(x: Tensor, samples: int) -> Tensor:
    """Running maximum over samples of (batch, time, channels), padded with zeros at the start."""
    padded = nn.functional.pad(x, (0, 0, samples - 1, 0)).transpose(1, 2)
    return nn.functional.max_pool1d(padded, samples, stride=1).transpose(1, 2)


class SlipGru(nn.Module):
    """Gated recurrent layer and a linear output."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.arch = arch
        self.features = Features(arch.inputs, arch.taxels, arch.mirrored)
        self.gru = nn.GRU(self.features.width, arch.channels, batch_first=True)
        self.drop = nn.Dropout(arch.dropout)
        self.out = nn.Linear(arch.channels, arch.outputs)

    def forward(self, counts: Tensor, last: bool = False) -> Tensor:
        hidden, _ = self.gru(self.features(counts))
        return log_odds(self.out(self.drop(hidden[:, -1:] if last else hidden)))


class FrequencyCnn(nn.Module):
    """Convolutions over an image of spectra, (2, 3) taxels by 51 frequencies as channels."""

    def __init__(self, arch: Architecture) -> None:
        super().__init__()
        self.arch = arch
        self.features = Features(arch.inputs, arch.taxels, arch.mirrored)
        self.conv1, self.norm1 = nn.Conv2d(WINDOW // 2 + 1, 50, 3, padding=1), nn.BatchNorm2d(50)
        self.conv2, self.norm2 = nn.Conv2d(50, 20, 2), nn.BatchNorm2d(20)
        self.dense1, self.norm3 = nn.Linear(40, 40), nn.BatchNorm1d(40)
        self.dense2, self.norm4 = nn.Linear(40, 20), nn.BatchNorm1d(20)
        self.out = nn.Linear(20, arch.outputs)
        self.drop2d, self.drop = nn.Dropout2d(arch.dropout), nn.Dropout(arch.dropout)
        samples = torch.arange(WINDOW, dtype=torch.float64)
        angle = 2.0 * math.pi / WINDOW * torch.outer(samples, samples[: WINDOW // 2 + 1])
        self.cosines, self.sines = angle.cos().float(), angle.sin().float()

    def image(self, counts: Tensor) -> Tensor:
        """Amplitudes (batch, 51, 2, 3) of a window (batch, 100, 6).

        As in the authors' code, the reshape keeps the order in memory, so that a "taxel" is 16 2/3
        samples of all six. With one series per taxel the network does not learn.
        """
        series = self.features(counts).reshape(-1, 2, 3, WINDOW)
        real, imaginary = series @ self.cosines, series @ self.sines
        return (real * real + imaginary * imaginary).sqrt().permute(0, 3, 1, 2)

    def forward(self, counts: Tensor, last: bool = True) -> Tensor:
        """Log-odds (batch, 1) of windows (batch, 100, 6)."""
        x = self.drop2d(self.norm1(nn.functional.relu(self.conv1(self.image(counts)))))
        x = self.drop2d(self.norm2(nn.functional.relu(self.conv2(x))))
        x = self.drop(nn.functional.relu(self.norm3(self.dense1(x.flatten(1)))))
        x = self.drop(nn.functional.relu(self.norm4(self.dense2(x))))
        return log_odds(self.out(x))[:, None]


def log_odds(scores: Tensor) -> Tensor:
    """Log-odds from scores: (..., 1) unchanged, (..., 2) as their difference (softmax)."""
    return scores[..., 0] if scores.shape[-1] == 1 else scores[..., 1] - scores[..., 0]


def build_network(arch: Architecture) -> nn.Module:
    """Network with random weights."""
    if arch.parts:
        return Averaged(arch)
    tcn = GatedTcn if arch.gated else SlipTcn
    return {"tcn": tcn, "gru": SlipGru, "freq-cnn": FrequencyCnn}[arch.family](arch)


def parts_of(network: nn.Module) -> list[Any]:
    """The networks that are averaged; the network itself if it is none."""
    return list(network.parts) if isinstance(network, Averaged) else [network]


def odds_of(
    network: nn.Module, arch: Architecture, recordings: Sequence[Recording]
) -> list[NDArray[np.float64]]:
    """Log-odds (n, fingers) of whole recordings, each after a reset, equal to the streamed ones."""
    network.eval()
    results = []
    with torch.inference_mode():
        for recording in recordings:
            counts = torch.from_numpy(recording.counts.astype(np.float32)).permute(1, 0, 2)
            odds = network(counts) if arch.streaming else _windowed(network, counts)
            results.append(odds.T.double().numpy())
    network.train()
    return results


def _windowed(network: nn.Module, counts: torch.Tensor) -> torch.Tensor:
    """(fingers, n) from (fingers, n, taxels); the first frame is repeated before the start."""
    before = counts[:, :1].expand(-1, WINDOW - 1, -1)
    windows = torch.cat([before, counts], dim=1).unfold(1, WINDOW, 1).transpose(2, 3)
    flat = windows.reshape(-1, WINDOW, windows.shape[3])
    parts = [network(part, last=True)[:, 0] for part in flat.split(WINDOWS_AT_ONCE)]
    return torch.cat(parts).reshape(len(counts), -1)
