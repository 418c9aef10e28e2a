"""Equality of torch networks and their ONNX export, streamed and windowed."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

torch = pytest.importorskip("torch")

from detector.compiled import CompiledNetwork  # noqa: E402
from detector.network import StreamingNetwork, run_network  # noqa: E402
from detector.network_file import NetworkCard, read_network  # noqa: E402
from detector.training.augment import symmetries  # noqa: E402
from detector.training.export import make_file  # noqa: E402
from detector.training.networks import build_network, parts_of  # noqa: E402
from detector.training.settings import ARCHITECTURES, WINDOW  # noqa: E402
from tests.unit.detector.network_files import walk  # noqa: E402

pytestmark = pytest.mark.train

STEPS, RESETS, LOST = 1000, (0, 333, 700), 500
TOLERANCE = 1e-5


def network(name: str) -> "torch.nn.Module":
    """Random weights and statistics, as after training."""
    torch.set_num_threads(1)
    torch.manual_seed(7)
    made = build_network(ARCHITECTURES[name]).eval()
    for part in parts_of(made):
        part.features.mean.fill_(-20.0)
        part.features.std.fill_(60.0)
        part.features.change_scale.fill_(2.0)
    for module in made.modules():
        if isinstance(module, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d):
            module.running_mean.uniform_(0.0, 1.0)
            module.running_var.uniform_(0.5, 2.0)
    return made


def exported(folder: Path, name: str, made: "torch.nn.Module") -> Path:
    path, arch = folder / "made.onnx", made.arch
    card = NetworkCard(
        format=2, name=name, mode="stream" if arch.streaming else "window", window=WINDOW,
        mean_counts=(0.0,) * 6, shift=-0.3, temperature=1.2,
    )  # fmt: skip
    path.write_bytes(make_file(made, card))
    return path


def probability(odds: "torch.Tensor") -> NDArray[np.float64]:
    return torch.sigmoid((odds - 0.3) / 1.2).double().numpy()  # shift and temperature of the card


def frames() -> NDArray[np.int16]:
    counts = walk(STEPS)
    counts[LOST] = counts[LOST - 1]
    return counts


def as_batch(counts: NDArray[np.int16]) -> "torch.Tensor":
    return torch.tensor(counts.astype(np.float32)).permute(1, 0, 2)


@pytest.mark.parametrize("name", ["tcn", "gru"])
def test_torch_and_stream_agree_over_a_thousand_steps(tmp_path: Path, name: str) -> None:
    made, counts = network(name), frames()
    stream = run_network(read_network(exported(tmp_path, name, made)), 3)
    assert isinstance(stream, StreamingNetwork) and isinstance(stream.engine, CompiledNetwork)
    worst = 0.0
    for first, after in pairwise([*RESETS, STEPS]):
        stream.reset()
        part = counts[first:after]
        streamed = np.array([stream.update(frame) for frame in part])
        with torch.no_grad():
            dense = probability(made(as_batch(part))).T
        worst = max(worst, np.abs(streamed - dense).max())
    assert worst < TOLERANCE


@pytest.mark.parametrize("name", ["tcn-paper", "freq-cnn-paper"])
def test_torch_and_onnx_agree_on_windows(tmp_path: Path, name: str) -> None:
    made, counts = network(name), frames()
    windowed = run_network(read_network(exported(tmp_path, name, made)), 3)
    p = np.array([windowed.update(frame) for frame in counts])
    windows = np.lib.stride_tricks.sliding_window_view(counts, WINDOW, axis=0)
    batch = torch.tensor(windows.transpose(0, 1, 3, 2).reshape(-1, WINDOW, 6).astype(np.float32))
    with torch.no_grad():
        expected = probability(made(batch, last=True)[:, 0]).reshape(-1, 3)
    assert np.abs(p[WINDOW - 1 :] - expected).max() < TOLERANCE


def parameters(made: "torch.nn.Module") -> int:
    return sum(p.numel() for p in made.parameters())


def test_the_paper_s_networks_have_the_published_numbers_of_parameters() -> None:
    assert parameters(build_network(ARCHITECTURES["tcn-paper"])) == 10_070
    cnn = build_network(ARCHITECTURES["freq-cnn-paper"])
    statistics = sum(b.numel() for n, b in cnn.named_buffers() if "running" in n)
    assert parameters(cnn) + statistics == 30_042


@pytest.mark.parametrize("name", ["tcn", "gru"])
def test_the_mirror_images_of_a_pad_have_equal_probabilities(name: str) -> None:
    made, counts = parts_of(network(name))[0], walk(200)
    with torch.no_grad():
        images = [made(as_batch(counts[:, :, order])) for order in symmetries(6)]
        other = made(as_batch(counts[:, :, [1, 0, 2, 3, 4, 5]]))
    assert all(torch.allclose(images[0], image, atol=TOLERANCE) for image in images)
    assert not torch.allclose(images[0], other, atol=100 * TOLERANCE)


def test_the_pair_averages_a_network_of_modes_with_shifts_and_one_of_taxels_without() -> None:
    made, counts = network("tcn"), as_batch(walk(200))
    modes, taxels = parts_of(made)
    with torch.no_grad():
        assert torch.allclose(made(counts), (modes(counts) + taxels(counts)) / 2, atol=TOLERANCE)
        turned = taxels(counts[:, :, symmetries(6)[3]])
        assert not torch.allclose(taxels(counts), turned, atol=100 * TOLERANCE)
    assert [part.features.inputs[0] for part in (modes, taxels)] == ["shifts", "changes"]


def test_no_output_of_the_tcn_depends_on_more_than_the_window() -> None:
    arch, made = ARCHITECTURES["tcn"], network("tcn")
    assert arch.memory == 99
    counts = as_batch(walk(200)).requires_grad_()
    made(counts)[0, -1].backward()
    touched = counts.grad[0].abs().sum(dim=1).nonzero()[:, 0]
    assert 200 - int(touched.min()) == arch.memory
