"""The paper's tables: its figures as printed, ours beside them, cells where they belong."""

import msgspec
import numpy as np
import pytest

from detector.decision import RuleSettings
from detector.scores.cells import (
    LEAST_RECORDINGS,
    ROWS,
    SURFACES,
    Key,
    cell_table,
    weighted_f1,
)
from detector.scores.evaluation import Streamed, evaluate_streams
from detector.scores.metrics import confusion
from detector.scores.tables import (
    cells_table,
    confusions_table,
    methods_table,
    variances_table,
)
from detector.scores.variance import variance_of
from drivers.errors import UsageError
from tests.unit.detector.scores.test_evaluation import Scripted, flags, metadata, recording

RULE = RuleSettings()


def streamed(key: Key, wrong: int) -> Streamed:
    """Two hundred samples, half of them slip; so many of those scored are told wrongly."""
    slip = flags(150, 50)
    motion, speed, surface = key
    told = msgspec.structs.replace(
        metadata(""),
        surface=surface,
        motion=motion,
        speed_mps=speed,  # type: ignore[arg-type]
    )
    made = msgspec.structs.replace(recording(slip), metadata=told)
    said = slip.astype(float)
    said[100 : 100 + wrong] = 1.0
    return Streamed(made, said[:, None], np.empty(0))


def every_cell(wrong_in: dict[Key, int], spread: int = 0) -> list[Streamed]:
    """As many recordings a cell as are needed, their errors spread around those asked for."""
    keys = [(*row, surface) for row in ROWS for surface in SURFACES]
    return [
        streamed(key, wrong_in.get(key, 10) + spread * (k - LEAST_RECORDINGS // 2))
        for key in keys
        for k in range(LEAST_RECORDINGS)
    ]


def verdicts(streams: list[Streamed]) -> dict[str, str]:
    found = cell_table("tcn-paper", 0.5, RULE, streams)
    return {s.text: s.verdict for s in found.statements}


PLANAR = "planar is better than sphere and cylinder along y"
CYLINDERS = "a cylinder is better along x than along y"
FASTER = "faster is better"
OBLIQUE = "oblique is better than primary"
ROTATION = "rotation is worst"


def test_every_statement_holds_where_the_cells_are_as_the_paper_has_them() -> None:
    wrong = {}
    for motion, speed in ROWS:
        for surface, worse in zip(SURFACES, (0, 8, 8, 4), strict=True):
            slow = {0.05: 6, 0.075: 3}.get(speed, 0)
            turned = {"rotation": 12, "primary": 2}.get(motion, 0)
            wrong[(motion, speed, surface)] = 10 + worse + slow + turned
    assert set(verdicts(every_cell(wrong)).values()) == {"holds"}


def test_a_statement_that_the_cells_contradict_does_not_hold() -> None:
    wrong = {
        (*row, surface): 2 if row[0] == "rotation" else 20 for row in ROWS for surface in SURFACES
    }
    assert verdicts(every_cell(wrong))[ROTATION] == "does not"
    wrong = {(*row, surface): 30 if row[1] == 0.1 else 10 for row in ROWS for surface in SURFACES}
    assert verdicts(every_cell(wrong))[FASTER] == "does not"


def test_of_two_differences_one_that_is_not_resolved_leaves_the_statement_open() -> None:
    wrong = {(*row, "sphere"): 30 for row in ROWS}  # planar and the cylinders are alike
    found = cell_table("tcn-paper", 0.5, RULE, every_cell(wrong, spread=2))
    planar = found.statements[0]
    assert planar.verdict == "not resolved"
    assert planar.differences["planar - sphere"].interval[0] > 0.0
    low, high = planar.differences["planar - cylinder-y"].interval
    assert low < 0.0 < high


def test_what_is_alike_is_not_resolved() -> None:
    assert set(verdicts(every_cell({}, spread=2)).values()) == {"not resolved"}


def test_means_weigh_cells_alike_and_intervals_hold_the_figure() -> None:
    found = cell_table("tcn-paper", 0.5, RULE, every_cell({("primary", 0.05, "planar"): 40}, 2))
    first = [c.f1.value for c in found.cells[:4]]
    assert found.of_rows[0].value == pytest.approx(np.mean(first))
    planar = [c.f1.value for c in found.cells if c.surface == "planar"]
    assert found.of_surfaces[0].value == pytest.approx(np.mean(planar))
    for e in (*found.of_rows, *(c.f1 for c in found.cells)):
        assert e.interval[0] <= e.value <= e.interval[1]


def test_f1_of_counts_is_that_of_the_confusion() -> None:
    rng = np.random.default_rng(0)
    labels, said = rng.random(300) < 0.3, rng.random(300) < 0.5
    c = confusion(said, labels)
    counts = np.array([c.static_static, c.static_slip, c.slip_static, c.slip_slip])
    assert weighted_f1(counts) == pytest.approx(c.weighted_f1)


def test_a_cell_with_too_few_recordings_is_refused() -> None:
    with pytest.raises(UsageError, match="1 of 28 cells"):
        cell_table("tcn-paper", 0.5, RULE, every_cell({})[1:])


def test_the_table_has_theirs_beside_ours_the_delays_and_the_statements() -> None:
    table = cells_table(
        cell_table("tcn-paper", 0.5, RULE, every_cell({("primary", 0.05, "planar"): 0}))
    )
    assert "| primary 5 cm/s | 92.5 / 100.0 [100.0, 100.0] | 88.8 / 89." in table
    assert "| mean | 94.0 / " in table
    assert "| rotation 1 rad/s |" in table
    assert "0 of 5 |" in table  # none of a cell's slips was missed
    # their delay at 50, 90 and 99 of a hundred: the rule takes two samples
    assert "| 10 / 10 / 10; 0 of 5 |" in table
    assert f"| {ROTATION} | **holds** |" in table  # one cell is better, and none of rotation


def test_the_methods_stand_beside_the_paper_s_and_it_is_said_that_ours_are_simulated() -> None:
    class Named(Scripted):
        name = "psd"

    made = streamed(("primary", 0.05, "planar"), 0)
    sheet = evaluate_streams(Named(np.zeros(1)), RULE, [made], "test")
    table = methods_table([sheet])
    assert "| `psd` | 57.4 / 100.0 | 57.9 / 100.0 | 57.4 / 100.0 | 57.5 / 100.0 |" in table
    assert "ours of a simulated one" in table
    assert "| `psd` | 50 (100.0) | 0 (0.0) | 0 (0.0) | 50 (100.0) |" in confusions_table([sheet])


def test_variance_is_within_a_label_and_compared_over_the_same_draws() -> None:
    rng = np.random.default_rng(0)
    quiet, loud = [], []
    for _ in range(12):
        made = streamed(("primary", 0.05, "planar"), 0)
        noise = rng.normal(0.0, 1.0, (200, 1))
        quiet.append(msgspec.structs.replace(made, probabilities=0.5 + 0.05 * noise))
        loud.append(msgspec.structs.replace(made, probabilities=0.5 + 0.10 * noise))
    found = [variance_of(n, RULE, s) for n, s in (("tcn-paper", quiet), ("freq-cnn-paper", loud))]
    p = np.concatenate([s.probabilities[100:, 0] for s in quiet])
    labels = np.concatenate([s.labels[100:] for s in quiet])
    expected = (p[labels].var() + p[~labels].var()) / 2
    assert found[0].estimate.value == pytest.approx(expected)
    low, high = (found[1].drawn - found[0].drawn).estimate.interval
    assert 0.0 < low < 3 * expected < high
    assert "| `freq-cnn-paper` | 0.0" in variances_table(found)
