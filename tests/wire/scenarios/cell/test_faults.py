"""Faults on real wires, at every phase of a lift: each ends in the safe state, nothing hangs."""

import subprocess
from pathlib import Path

import pytest

from grasp.phases import Phase
from scenarios.campaign.config import load_config
from tests.wire.scenarios.cell.staged import FAULTS, PHASES, Row, run

TABLE = Path(__file__).parents[4] / "docs" / "faults.md"
SAMPLE = [  # one device, one kind of trouble and one phase each; the slow test has them all
    ("gripper-fault", Phase.COMPENSATE),
    ("protective-stop", Phase.LIFT),
    ("fingertips-unplugged", Phase.GRASP),
]
TITLE = "# Faults on the wire\n"
HEAD = f"""{TITLE}
Generated, down to "What devices say is doubted", by `pytest -m slow
tests/wire/scenarios/cell/test_faults.py`: one lift each on the emulated rig, over Modbus TCP, USB
transfers and RTDE; the fault strikes at the first control step of the phase. Arm and object are
those of the emulated cell more than half a second after the run has ended, not what a driver
believes. Held heights and peaks vary a little: these runs are in wall time, with more patience than
usual for a busy machine (0.3 s for a reply, 0.2 s for a sample, 0.25 s for the arm).
The same in virtual time: `tests/unit/scenarios/lift/test_faults.py`. Safe states:
[architecture.md](architecture.md).

`not told`: the link to the gripper is lost; it holds by itself. `refuses`: the driver sends nothing
to a gripper that reports a fault, and it holds as it stands. `N mm late`: nothing reaches a frozen
controller; once it thaws it goes that far until its watchdog or our stop command ends the motion.
A speed slider at 0 is no trouble until the arm is to move: such a run ends in a later phase.
Exit codes: 3 device, 4 safety stop.
"""


BY_HAND = "# What devices say is doubted\n"
ENTRY = (
    '<!-- figure: id=faults command="pytest -m slow tests/wire/scenarios/cell/test_faults.py" '
    "detector={} commit={} code=@wired,scenarios/lift tables={} -->"
)


def document(rows: list[Row]) -> str:
    """The table, a section a fault."""
    before, _, _ = TABLE.read_text(encoding="utf-8").partition(TITLE)
    parts = [before + HEAD.rstrip()]
    for name, fault in FAULTS.items():
        parts.append(f"\n## {fault.title[0].upper()}{fault.title[1:]}\n")
        if len(parts) == 2:  # one entry for all (scripts/figures.py)
            parts.append(
                ENTRY.format(load_config("can", "emulated").detector_name, _commit(), len(FAULTS))
            )
        parts.append("| phase | outcome | kind | exit | arm | hand | object | peak, N | message |")
        parts.append("|---|---|---|---|---|---|---|---|---|")
        parts += [_line(row) for row in rows if row.fault == name]
    return "\n".join(parts) + "\n\n" + by_hand()


def by_hand() -> str:
    """What the page has from there on is not generated."""
    _, mark, rest = TABLE.read_text(encoding="utf-8").partition(BY_HAND)
    return mark + rest


def _line(row: Row) -> str:
    cells = [row.phase, row.outcome, row.kind, str(row.code), row.arm, row.hand, row.object]
    mark = " **" + "; ".join(row.problems) + "**" if row.problems else ""
    return f"| {' | '.join(cells)} | {row.peak_n:.1f} | {_anonymous(row.message)}{mark} |"


def _commit() -> str:
    command = ("git", "rev-parse", "--short=7", "HEAD")
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _anonymous(message: str) -> str:
    """Without the loopback address that this run happened to have."""
    words = ("ADDRESS" if word.startswith("127.") else word for word in message.split())
    return " ".join(words)


@pytest.mark.parametrize(("fault", "phase"), SAMPLE, ids=str)
def test_fault_ends_in_the_safe_state(fault: str, phase: Phase, monkeypatch) -> None:
    row = run(fault, phase, monkeypatch)
    assert not row.problems, row


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_every_fault_in_every_phase(monkeypatch) -> None:
    rows = []
    for fault in FAULTS:
        for phase in PHASES:
            rows.append(run(fault, phase, monkeypatch))
            print(rows[-1], flush=True)  # so that a failure leaves what there is
            TABLE.write_text(document(rows), encoding="utf-8")
    assert not [row for row in rows if row.problems]
