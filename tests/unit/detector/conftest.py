"""The authors' recording, which is not part of the repository."""

from pathlib import Path

import pytest

from detector.recordings import Recording, read_csv


@pytest.fixture
def authors_recording() -> Recording:
    path = Path(__file__).parents[4] / "shared" / "data" / "takktile_felt.csv"
    if not path.exists():
        pytest.skip("the authors' recording is not here")
    return read_csv(path)
