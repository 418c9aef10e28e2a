"""A recorded lift, and modified copies of it."""

import base64
import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp.run.recording import RunRecorder, RunRecording
from scenarios.lift.lift import lift
from scenarios.trial.run_folder import RESULT, RUN_CHANNELS
from tests.unit.scenarios.conftest import config

Message = tuple[str, int, Any]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a lift."""
    result = lift.run(config(), 0, tmp_path_factory.mktemp("runs")).result
    assert result is not None and result.recording is not None
    return Path(result.recording).parent


def changed(
    run: Path,
    out: Path,
    change: Callable[[Message], Message | None] = lambda message: message,
    settings: Callable[[dict[str, Any]], None] = lambda settings: None,
) -> Path:
    """A copy of a run's folder with changed messages (None omits one) and settings."""
    recording = RunRecording(run / "recording.mcap", RUN_CHANNELS)
    table = json.loads(recording.metadata["config"])
    settings(table)
    metadata = {**recording.metadata, "config": json.dumps(table)}
    out.mkdir()
    with RunRecorder(out / "recording.mcap", RUN_CHANNELS, metadata) as writer:
        for message in recording:
            kept = change(message)
            if kept is not None:
                writer.write(*kept)
    assert writer.failure is None
    (out / RESULT).write_bytes((run / RESULT).read_bytes())
    return out


def data_of(page: str) -> dict[str, Any]:
    """Input of the scripts of a page."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def unpacked(packed: dict[str, Any]) -> dict[str, NDArray[np.float64]]:
    """Columns (n, width), as `unpack()` of the page's `data.js` reads them."""
    values = np.frombuffer(zlib.decompress(base64.b64decode(packed["deflated"])), "<f4")
    columns, place = {}, 0
    for name, width in packed["columns"]:
        part = values[place : place + width * packed["rows"]].reshape(width, -1)
        place += part.size
        columns[name] = part.T.astype(np.float64)
    assert place == len(values)
    return columns
