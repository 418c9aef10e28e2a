"""Rows of the wire table beside runs in virtual time."""

from collections import Counter
from pathlib import Path

import msgspec
import pytest

from grasp.phases import Phase
from scenarios.studies.faults.run import run_scene
from scenarios.studies.faults.wired import COUNTERPARTS, cases_of, compared, rows_of
from tests.wire.scenarios.cell.staged import FAULTS, PHASES

PAGE = """# Faults on the wire

## Arm: protective stop

| phase | outcome | kind | exit | arm | hand | object | peak, N | message |
|---|---|---|---|---|---|---|---|---|
| approach | fault | device_fault | 3 | stopped | stays | on the table | 0.0 | the arm stopped |
| hold | fault | device_fault | 3 | stopped | closes | held at 58 mm | 10.2 | the arm stopped |

# What devices say is doubted

| name | what | can | delay | after | a | b | 0.0 | d |
"""
TABLE = Path(__file__).parents[5] / "docs" / "faults.md"


def test_rows_are_those_of_the_wire_table() -> None:
    rows = rows_of(PAGE)
    assert [(row.title, row.phase, row.peak_n) for row in rows] == [
        ("Arm: protective stop", Phase.APPROACH, 0.0),
        ("Arm: protective stop", Phase.HOLD, 10.2),
    ]
    with pytest.raises(ValueError, match="no wire table"):
        rows_of("# Nothing")


def test_every_fault_of_the_wire_table_has_a_counterpart() -> None:
    titles = [f"{fault.title[0].upper()}{fault.title[1:]}" for fault in FAULTS.values()]
    assert titles == list(COUNTERPARTS)
    rows = rows_of(TABLE.read_text(encoding="utf-8"))
    phases = Counter(row.title for row in rows)
    assert set(phases) <= set(COUNTERPARTS) and len(set(phases.values())) == 1


def test_a_counterpart_strikes_where_its_row_does_in_each_phase_of_the_wire_table() -> None:
    rows = [msgspec.structs.replace(rows_of(PAGE)[0], phase=phase) for phase in PHASES]
    ended = run_scene(cases_of(rows))
    assert {(e.struck_in, e.outcome) for e in ended} == {(phase, "fault") for phase in PHASES}


def test_what_differs_is_told() -> None:
    rows = rows_of(PAGE)
    ended = run_scene(cases_of(rows))
    assert "| 2 of 2 |  | 0." in compared(rows, ended)[2]
    fallen = msgspec.structs.replace(rows[1], object="on the table", peak_n=11.2)
    moves = msgspec.structs.replace(rows[0], arm="MOVES", outcome="held")
    told = compared([moves, fallen], ended)[2]
    assert "| 0 of 2 |" in told
    assert "approach: ends as fault, the arm moves" in told
    assert "hold: the object: held in the air for on the table" in told
