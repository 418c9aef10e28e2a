"""The paper's tables: its figures as printed, ours beside them, cells where they belong."""

import msgspec
import numpy as np

from detector.decision import RuleSettings
from detector.scores.evaluation import Streamed, evaluate_streams
from detector.scores.tables import cell_f1, cells_table, methods_table
from tests.unit.detector.scores.test_evaluation import Scripted, flags, metadata, recording


def streamed(surface: str, speed: float, right: bool) -> Streamed:
    slip = flags(200, 100, 100)
    told = msgspec.structs.replace(metadata(""), surface=surface, motion="primary", speed_mps=speed)
    made = msgspec.structs.replace(recording(slip), metadata=told)
    return Streamed(made, (slip if right else ~slip).astype(float)[:, None], np.empty(0))


def test_a_cell_holds_its_own_recordings() -> None:
    cells = cell_f1([streamed("planar", 0.05, True), streamed("sphere", 0.1, False)], threshold=0.5)
    assert cells == {("primary", 0.05, "planar"): 1.0, ("primary", 0.1, "sphere"): 0.0}
    table = cells_table("tcn", cells)
    assert "| primary 5 cm/s | 92.5 / 100.0 | 88.8 / – | 78.7 / – | 94.0 / – |" in table
    assert "| primary 10 cm/s | 95.7 / – | 84.5 / 0.0 |" in table
    assert "rotation 1 rad/s" in table


def test_confusers_are_in_no_cell() -> None:
    made = streamed("planar", 0.05, True)
    shaken = msgspec.structs.replace(made.recording, metadata=metadata("tightening"))
    assert cell_f1([msgspec.structs.replace(made, recording=shaken)], 0.5) == {}


def test_the_methods_stand_beside_the_paper_s_and_it_is_said_that_ours_are_simulated() -> None:
    class Named(Scripted):
        name = "psd"

    sheet = evaluate_streams(
        Named(np.zeros(1)), RuleSettings(), [streamed("planar", 0.05, True)], "test"
    )
    table = methods_table([sheet])
    assert "| `psd` | 57.4 / 100.0 | 57.9 / 100.0 | 57.4 / 100.0 | 57.5 / 100.0 |" in table
    assert "ours of a simulated one" in table
