"""What `make` does where a campaign has found something: the page tells of it all the same."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
ASKED = {
    "faults": ["scripts/faults.py run --stale --jobs 3", "scripts/faults.py page",
               "-m pytest -s -m slow tests/wire/scenarios/chaos"],
    "mutants": [f"scripts/mutants.py {verb}"
                for verb in ("run", "sample --seed 17", "twice", "page")],
}  # fmt: skip


@pytest.mark.parametrize("target", ASKED)
def test_a_page_is_written_and_all_is_run_though_something_fell(
    target: str, tmp_path: Path
) -> None:
    python, said = tmp_path / "python", tmp_path / "said"
    python.write_text(f'#!/bin/sh\necho "$*" >>{said}\ncase "$2" in run) exit 1; esac\n')
    python.chmod(0o755)
    alone = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ("make", "-o", "install-dev", target, f"BIN={tmp_path}", "JOBS=3")
    made = subprocess.run(command, cwd=ROOT, env=alone, capture_output=True, text=True, check=False)
    assert said.read_text().splitlines() == ASKED[target]
    assert made.returncode == 2, made.stderr  # make's own, of a command that failed
