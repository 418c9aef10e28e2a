"""Commands import only what they use: an import that is not needed delays every start."""

import subprocess
import sys
from pathlib import Path

import pytest

# what takes 10 ms and more to import
SLOW = {
    "asyncio", "importlib.metadata", "jinja2", "mcap", "numba", "onnxruntime", "pymodbus", "rich",
    "serial", "sqlite3", "ssl", "usb", "websockets",
}  # fmt: skip
RUN = {"importlib.metadata", "mcap", "numba", "sqlite3"}  # used by a simulated run
PROGRAM = """
import sys
from grasp.cli.main import main
code = main(sys.argv[1:])
print("imported", *sys.modules)
sys.exit(code)
"""


def imported(*words: str, code: int = 0) -> set[str]:
    """The slow modules that a command imports."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=100,
        check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    return {*done.stdout.splitlines()[-1].split()} & SLOW


def test_settings_import_nothing_slow() -> None:
    assert imported("config") == set()


@pytest.mark.parametrize("wrong", [["--object", "nosuch"], ["--set", "slip=1"], ["--dry-run"]])
def test_wrong_input_is_refused_before_anything_slow_is_imported(wrong: list[str]) -> None:
    assert imported("run", "lift", *wrong, code=2) == set()


def test_a_simulated_run_imports_nothing_of_real_devices_or_pages(tmp_path: Path) -> None:
    assert imported("run", "lift", "--rig", "simulated", "--runs", str(tmp_path)) <= RUN
