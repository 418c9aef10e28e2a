"""Ctrl-C during the import of the program's modules ends it with exit code 130."""

import subprocess
import sys
from pathlib import Path

import pytest

# imports as a program does; strikes itself at the import of a number or a name
INTERRUPTED_AT = """
import os, signal, sys

class Strike:
    left = {place!r}

    def find_spec(self, name, path=None, target=None):
        if isinstance(self.left, int):
            self.left -= 1
        if self.left == 0 or self.left == name:
            Strike.left = -1
            os.kill(os.getpid(), signal.SIGINT)

{before}
sys.meta_path.insert(0, Strike())
from grasp.cli.entry import main
code = main()
print("left", Strike.left)
sys.exit(code)
"""
ENTRY = "import grasp.cli.entry"  # before this module runs, Ctrl-C has Python's handler


def interrupted_at(place: int | str, runs: Path) -> "subprocess.CompletedProcess[str]":
    words = ("run", "lift", "--rig", "simulated", "--pace", "max", "--runs", str(runs))
    return subprocess.run(
        [sys.executable, "-c", INTERRUPTED_AT.format(place=place, before=ENTRY), *words],
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip


@pytest.mark.parametrize(
    "place",
    [1, 150, "numpy._core.multiarray"],
)  # fmt: skip
def test_ctrl_c_at_any_import_ends_with_130_and_no_traceback(
    place: int | str, tmp_path: Path
) -> None:
    done = interrupted_at(place, tmp_path / "runs")
    assert "left" not in done.stdout or "left -1" in done.stdout  # the signal was raised
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr and "ignored" not in done.stderr
    assert "damaged" not in done.stderr
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").glob("*/recording*"))


def test_after_the_command_ctrl_c_changes_no_exit_code() -> None:
    code = (
        "import signal, sys; from grasp.cli.entry import main, _quit\n"
        "assert signal.getsignal(signal.SIGINT) is _quit\n"
        "sys.argv = ['grasp', 'runs', '--runs', '/nowhere']; assert main() == 0\n"
        "assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
