"""The paper's network trained for its delay: what is learnt from, what is scored."""

import numpy as np
import pytest

pytest.importorskip("torch")

from detector.recordings import Metadata, Recording
from drivers.errors import UsageError
from scenarios.studies.signal import delay

pytestmark = pytest.mark.train


def recording(seed: int, split: str) -> Recording:
    """Strokes that are heard at once, after pauses without a sound."""
    rng = np.random.default_rng(seed)
    slip = (np.arange(800) // 80) % 2 == 1
    counts = np.where(slip[:, None], 60.0, 0.5) * rng.standard_normal((800, 6))
    metadata = Metadata(
        set="slide", split=split, surface="planar", motion="primary", speed_mps=0.05,  # type: ignore[arg-type]
        spin_radps=0.0, direction="0", seed=seed,
    )  # fmt: skip
    whole = counts.round().astype(np.int16)[:, None]
    return Recording(np.arange(800) * 0.01, whole, slip, None, "", metadata)


SPLITS = ("train", "train", "validation", "test")


@pytest.mark.parametrize("recipe", delay.RECIPES)
def test_a_short_training_hears_loud_strokes_in_time(recipe: delay.Recipe) -> None:
    recordings = [recording(k, split) for k, split in enumerate(SPLITS)]
    found = delay.measure(recordings, "toy", recipe, 60, 0)
    assert (found.data, found.recipe, found.steps) == ("toy", recipe, 60)
    assert found.slips == 4  # the first is over before anything is scored
    assert found.accuracy > 0.7
    assert found.median_ms <= found.p90_ms
    assert "| toy |" in delay.table([found])


def test_a_set_without_a_split_is_refused() -> None:
    with pytest.raises(UsageError, match="test"):
        delay.measure([recording(0, "train"), recording(1, "validation")], "toy", "dense", 1, 0)
