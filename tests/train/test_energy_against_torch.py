"""The energy detector compared with torch's average pooling."""

import numpy as np
import pytest

from detector.energy import STEEPNESS, EnergyDetector, EnergySettings

torch = pytest.importorskip("torch")

pytestmark = pytest.mark.train


@pytest.mark.parametrize("window", [1, 3, 10, 25])
def test_the_streamed_energy_is_torch_s_average_pool_of_absolute_changes(window: int) -> None:
    torch.set_num_threads(1)
    counts = np.random.default_rng(window).integers(-500, 200, (400, 3, 6)).astype(np.int16)
    settings = EnergySettings(window=window, threshold_counts=120.0)
    detector = EnergyDetector(settings, 3)
    streamed, energies = [], []
    for frame in counts:
        streamed.append(detector.update(frame))
        energies.append(detector.energy_counts)

    series = torch.from_numpy(counts).to(torch.float64).permute(1, 2, 0)  # (fingers, 6, n)
    changes = torch.diff(series, dim=2).abs()
    changes = torch.nn.functional.pad(changes, (window, 0))  # no change before the first frame
    pooled = torch.nn.functional.avg_pool1d(changes, window, stride=1).mean(dim=1)  # (fingers, n)
    odds = STEEPNESS * torch.log(pooled / settings.threshold_counts)
    assert np.abs(np.array(energies).T - pooled.numpy()).max() < 1e-9
    assert np.abs(np.array(streamed).T - torch.sigmoid(odds).numpy()).max() < 1e-9
