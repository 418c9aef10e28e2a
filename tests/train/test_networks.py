"""Torch and ONNX compute the same, windowed and streamed, through resets and a lost frame."""

from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

torch = pytest.importorskip("torch")

from detector.network import run_network  # noqa: E402
from detector.network_file import Mode, read_network  # noqa: E402
from detector.training.architecture import ARCHITECTURES  # noqa: E402
from detector.training.graph import make_model  # noqa: E402
from detector.training.networks import build, parameter_count  # noqa: E402
from tests.unit.detector.networks import card, walk  # noqa: E402

pytestmark = pytest.mark.train

STEPS, RESETS, LOST = 1000, (0, 333, 700), 500
TOLERANCE = 1e-5


def network(name: str, **changes: object) -> "torch.nn.Module":
    """Random weights and statistics, as after training."""
    torch.set_num_threads(1)
    torch.manual_seed(7)
    made = build(msgspec.structs.replace(ARCHITECTURES[name], **changes)).eval()
    made.features.mean.fill_(-20.0)
    made.features.std.fill_(60.0)
    made.features.change_scale.fill_(2.0)
    for module in made.modules():
        if isinstance(module, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d):
            module.running_mean.uniform_(0.0, 1.0)
            module.running_var.uniform_(0.5, 2.0)
    return made


def exported(folder: Path, name: str, mode: Mode, made: "torch.nn.Module") -> Path:
    weights = {k: v.numpy() for k, v in made.state_dict().items()}
    path = folder / f"{mode}.onnx"
    arch = made.arch
    path.write_bytes(make_model(arch, mode, weights, card(name, mode, arch.window)))
    return path


def probability(odds: "torch.Tensor") -> NDArray[np.float64]:
    return torch.sigmoid((odds - 0.3) / 1.2).double().numpy()  # shift and temperature of `card`


def frames() -> NDArray[np.int16]:
    counts = walk(STEPS)
    counts[LOST] = counts[LOST - 1]
    return counts


def as_batch(counts: NDArray[np.int16]) -> "torch.Tensor":
    return torch.tensor(counts.astype(np.float32)).permute(1, 0, 2)


@pytest.mark.parametrize("name", ["tcn", "gru"])
def test_torch_window_and_stream_agree_over_a_thousand_steps(tmp_path: Path, name: str) -> None:
    made, counts = network(name), frames()
    stream = run_network(read_network(exported(tmp_path, name, "stream", made)), 3)
    window = read_network(exported(tmp_path, name, "window", made)).session
    bounds = [*RESETS, STEPS]
    worst_torch = worst_window = 0.0
    for first, after in pairwise(bounds):
        stream.reset()
        part = counts[first:after]
        streamed = np.array([stream.update(frame) for frame in part])
        with torch.no_grad():
            dense = probability(made(as_batch(part))).T
        worst_torch = max(worst_torch, np.abs(streamed - dense).max())
        # all since the reset is a window too; for the tcn the last hundred samples are enough
        memory = 100 if name == "tcn" else after - first
        for i in range(0, len(part), 7):
            seen = part[max(0, i + 1 - memory) : i + 1].astype(np.float32).transpose(1, 0, 2)
            (p,) = window.run(["probability"], {"counts": seen})
            worst_window = max(worst_window, np.abs(p - streamed[i]).max())
    assert worst_torch < TOLERANCE
    assert worst_window < TOLERANCE


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("tcn-paper", {}), ("tcn-paper", {"window": 30}), ("tcn-paper", {"norm": False}),
        ("freq-cnn-paper", {}),
    ],
)  # fmt: skip
def test_torch_and_onnx_agree_on_windows(
    tmp_path: Path, name: str, changes: dict[str, object]
) -> None:
    made, counts = network(name, **changes), frames()
    windowed = run_network(read_network(exported(tmp_path, name, "window", made)), 3)
    p = np.array([windowed.update(frame) for frame in counts])
    samples = made.arch.window
    windows = np.lib.stride_tricks.sliding_window_view(counts, samples, axis=0)
    batch = torch.tensor(windows.transpose(0, 1, 3, 2).reshape(-1, samples, 6).astype(np.float32))
    with torch.no_grad():
        expected = probability(made(batch, last=True)[:, 0]).reshape(-1, 3)
    assert np.abs(p[samples - 1 :] - expected).max() < TOLERANCE


def test_the_paper_s_networks_have_the_parameters_their_authors_counted() -> None:
    assert parameter_count(build(ARCHITECTURES["tcn-paper"])) == 10_070
    cnn = build(ARCHITECTURES["freq-cnn-paper"])
    statistics = sum(b.numel() for n, b in cnn.named_buffers() if "running" in n)
    assert parameter_count(cnn) + statistics == 30_042


def test_no_output_of_the_tcn_depends_on_more_than_the_window() -> None:
    arch, made = ARCHITECTURES["tcn"], network("tcn")
    assert arch.memory == 99
    counts = as_batch(walk(200)).requires_grad_()
    made(counts)[0, -1].backward()
    touched = counts.grad[0].abs().sum(dim=1).nonzero()[:, 0]
    assert 200 - int(touched.min()) == arch.memory
