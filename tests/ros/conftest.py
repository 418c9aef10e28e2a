"""Two lifts to export."""

from pathlib import Path

import pytest

from scenarios.lift.lift import lift
from tests.unit.scenarios.conftest import config


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of lifts with the seeds 0 and 1."""
    found = []
    for seed in (0, 1):
        result = lift.run(config(), seed, tmp_path_factory.mktemp("runs")).result
        assert result is not None and result.recording is not None
        found.append(Path(result.recording).parent)
    return found
