"""Whether a fault that strikes in Python, in virtual time, and the one of the same name that
strikes at the emulated device, over the wire, lead to the same: each row of the wire table of
docs/faults.md beside a run of its counterpart."""

from collections.abc import Sequence
from itertools import pairwise

import msgspec

from grasp.phases import Phase
from scenarios.studies.faults.cases import Case, Fault
from scenarios.studies.faults.page import object_of, table
from scenarios.studies.faults.run import Ended

SCENE = ("can", 0)  # of the wire table
CUT = Fault("gripper", "link", "link", "cut")
COUNTERPARTS = {  # by the title of the wire table; the nearest that there is
    "Gripper: connection cut, for good": CUT,
    "Gripper: no reply any more": CUT,
    "Gripper: fault 0x0E": Fault("gripper", "state", "gFLT", "jump"),
    "Arm: protective stop": Fault("arm", "state", "protective_stop", "jump"),
    "Arm: emergency stop": Fault("arm", "state", "protective_stop", "jump"),
    "Arm: speed slider turned to 0 %": Fault("arm", "state", "speed_fraction", "missing"),
    "Arm: connections dropped": Fault("arm", "link", "link", "cut"),
    "Arm: controller frozen for 1 s": Fault("arm", "state", "t_ns", "frozen"),
    "Fingertips: USB unplugged": Fault("fingertips", "link", "link", "cut"),
    "Fingertips: USB reads time out, for good": Fault("fingertips", "state", "finger A", "missing"),
}
CELLS = 9  # of a row of the wire table


class Row(msgspec.Struct, frozen=True):
    """Of the wire table."""

    title: str
    phase: Phase
    outcome: str
    arm: str
    object: str
    peak_n: float


def rows_of(page: str) -> list[Row]:
    """Raises ValueError where the page has none."""
    found, title = [], ""
    for line in page.splitlines():
        if line.startswith("#"):
            title = line.lstrip("# ")
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if title in COUNTERPARTS and len(cells) == CELLS and cells[0] in set(Phase):
            phase, outcome, _, _, arm, _, there, peak, _ = cells
            found.append(Row(title, Phase(phase), outcome, arm, there, float(peak)))
    if not found:
        raise ValueError("the page has no wire table")
    return found


def cases_of(rows: Sequence[Row]) -> list[Case]:
    """A run for each: the fault strikes at the first step of the phase, and stays."""
    return [
        Case(number, *SCENE, COUNTERPARTS[row.title], row.phase) for number, row in enumerate(rows)
    ]


def differs(row: Row, ended: Ended) -> str:
    """In what, but for the force."""
    stands = ended.later_arm_mps == 0.0
    here = object_of(ended)
    parts = {
        f"ends as {ended.outcome}": row.outcome != ended.outcome,
        "the arm moves": row.arm.startswith("stopped") != stands,
        f"the object: {here} for {row.object}": _short(row.object) != _short(here),
    }
    return ", ".join(text for text, is_so in parts.items() if is_so)


def _short(what: str) -> str:
    """Lying in a hand that has gripped it, or in an open one, in the air or not."""
    if what.startswith("held"):
        return "held"
    return "gripped" if what in ("on the table, gripped", "in the hand, on the table") else what


def compared(rows: Sequence[Row], every: Sequence[Ended]) -> list[str]:
    """A table in Markdown, a row for each fault of the wire table."""
    ended = {e.case.number: e for e in every}
    pairs = [(row, ended[number]) for number, row in enumerate(rows)]
    starts = [i for i, (row, _) in enumerate(pairs) if i == 0 or row.title != rows[i - 1].title]
    lines = []
    for first, after in pairwise([*starts, len(pairs)]):
        of_fault = pairs[first:after]
        apart = [f"{row.phase}: {text}" for row, e in of_fault if (text := differs(row, e))]
        forces = max(abs(row.peak_n - e.peak_n) for row, e in of_fault)
        lines.append(
            [of_fault[0][0].title, str(of_fault[0][1].case.fault),
             f"{len(of_fault) - len(apart)} of {len(of_fault)}", "; ".join(apart), f"{forces:.1f}"]
        )  # fmt: skip
    head = ("at the device, over the wire", "in Python, in virtual time", "phases alike",
            "where not", "peaks differ by at most, N")  # fmt: skip
    return table(head, lines)
