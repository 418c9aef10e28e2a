"""Tables of docs/data-formats.md have the keys that the code reads and writes."""

import re
from enum import StrEnum
from itertools import pairwise
from pathlib import Path

import pytest

from detector.recordings import Metadata
from scenarios.acquire.datasets.disturbances import DisturbanceSettings
from scenarios.acquire.datasets.plan import CauseRow, DatasetConfig
from scenarios.campaign.worker import Row
from scenarios.lift.scoring import LiftOutcome, LiftResult
from scenarios.tap.scoring import TapOutcome, TapResult
from scenarios.trial.result import TrialResult

DOCS = Path(__file__).parents[2] / "docs"
TRIAL = {*TrialResult.__struct_fields__}
# heading of a table's first column -> keys
KEYS = {
    "lift and tap": TRIAL,
    "lift only": {*LiftResult.__struct_fields__} - TRIAL,
    "tap only": {*TapResult.__struct_fields__} - TRIAL,
    "metadata": {*Metadata.__struct_encode_fields__},
    "key": {*DatasetConfig.__struct_fields__},
    "key of a cause": {*CauseRow.__struct_fields__},
    "key of `disturbances`": {*DisturbanceSettings.__struct_fields__},
    "column": {*Row.__struct_fields__},
}


def first_column(page: str, heading: str) -> list[str]:
    """Words in backticks of the first column of the table with this heading."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    (start,) = (i for i, (line, below) in enumerate(pairwise(lines))
                if line.startswith(f"| {heading} |") and below.startswith("|---"))  # fmt: skip
    words = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        words += re.findall(r"`(\w+)`", line.split("|")[1])
    return words


@pytest.mark.parametrize("heading", KEYS)
def test_a_table_has_every_key_of_its_struct_once(heading: str) -> None:
    found = first_column("data-formats.md", heading)
    assert sorted(found) == sorted(KEYS[heading])


@pytest.mark.parametrize(
    ("page", "outcomes"), [("data-formats.md", LiftOutcome), ("experiments.md", TapOutcome)]
)
def test_every_outcome_is_explained(page: str, outcomes: type[StrEnum]) -> None:
    assert sorted(first_column(page, "outcome")) == sorted(outcomes)
