"""Where the paper's published recording may lie: beside the checkout, never in it."""

from pathlib import Path

import pytest

from detector.recordings import Recording, read_csv


@pytest.fixture
def felt() -> Recording:
    path = Path(__file__).parents[4] / "shared" / "data" / "takktile_felt.csv"
    if not path.exists():
        pytest.skip("the authors' recording is not here")
    return read_csv(path)
