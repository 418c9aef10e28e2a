"""`make install` compiles all that runs need."""

import os
import re
import subprocess
import sys
from pathlib import Path

PROGRAM = "import sys; from grasp.cli.main import main; sys.exit(main(sys.argv[1:]))"
COMMANDS = (
    "run lift --rig simulated",
    "run lift --rig simulated --detector energy",
    "run lift --rig emulated --set hand.activation_s=1",
    "run tap --rig simulated --direction closing --trials 1",
    "run acquire --rig simulated --seconds 3",
)


def test_no_run_compiles_after_the_installation(tmp_path: Path) -> None:
    cache = tmp_path / "cache"

    def python(*words: str) -> tuple[set[str], str]:
        """Names of the compiled functions that are kept after the program, and its messages."""
        done = subprocess.run(
            [sys.executable, *words], cwd=Path(__file__).parents[2], check=False,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache)}, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode in (0, 1), done.stderr  # 1: a verdict, not of interest here
        return {file.name for file in cache.rglob("*.nbc")}, done.stderr

    kept, progress = python("-m", "grasp.cli.compiling")
    ready, functions = re.findall(r"(\d+) of (\d+)", progress)[-1]
    assert kept and ready == functions
    for command in COMMANDS:
        runs = ("--runs", str(tmp_path / "runs"))
        after, _ = python("-c", PROGRAM, *command.split(), *runs)
        assert after <= kept, command
