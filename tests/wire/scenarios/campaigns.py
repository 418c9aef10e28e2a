"""A campaign as a user runs it: a command in a process of its own."""

import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.wire.waiting import PATIENCE_S

GRASP = [sys.executable, "-c", "import sys; from grasp.cli.main import main; sys.exit(main())"]
# the others repeat with the seed
MACHINE_COLUMNS = ("versions", "wall_s", "cpu_s", "timing")


def campaign_file(folder: Path, repetitions: int) -> Path:
    path = folder / "small.toml"
    path.write_text(
        f'name = "small"\nobjects = ["can", "ball"]\nrepetitions = {repetitions}\n'
        'recordings = "none"\n'
        'settings = ["controller.hold_s=0.2", "controller.lift_height_m=0.05"]\n'
    )
    return path


def started(*words: str, before: Sequence[str] = ()) -> subprocess.Popen[str]:
    """The command, in a process group of its own, as a shell would start it; ``before`` it what is
    to begin it."""
    return subprocess.Popen(
        [*before, *GRASP, "campaign", "run", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0,
    )  # fmt: skip


def finished(*words: str) -> tuple[int, str, str]:
    process = started(*words)
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, out, err


def rows(path: Path) -> list[dict[str, Any]]:
    """All rows, without what the machine decides."""
    if not path.exists():
        return []
    db = sqlite3.connect(path)
    try:
        db.row_factory = sqlite3.Row
        found = [dict(row) for row in db.execute("SELECT * FROM trials ORDER BY trial")]
    except sqlite3.OperationalError:  # not yet created
        return []
    finally:
        db.close()
    return [{k: v for k, v in row.items() if k not in MACHINE_COLUMNS} for row in found]


def workers_of(pid: int) -> list[int]:
    """Processes of the group that the command began, without the command."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        alive, group = fields[0] != "Z", int(fields[2])
        if group == pid and alive and int(path.parent.name) != pid:
            found.append(int(path.parent.name))
    return found


def interrupt(process: subprocess.Popen[str]) -> None:
    """Ctrl-C: the whole group gets the signal."""
    os.killpg(process.pid, signal.SIGINT)
