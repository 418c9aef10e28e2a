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


def made(target: str, folder: Path, code: int) -> tuple[list[str], int]:
    """What was asked for where the first command ends with this, and make's exit code."""
    python, said = folder / "python", folder / "said"
    python.write_text(f'#!/bin/sh\necho "$*" >>{said}\ncase "$2" in run) exit {code}; esac\n')
    python.chmod(0o755)
    alone = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ("make", "-o", "install-dev", target, f"BIN={folder}", "JOBS=3")
    done = subprocess.run(command, cwd=ROOT, env=alone, capture_output=True, text=True, check=False)
    return said.read_text().splitlines(), done.returncode


@pytest.mark.parametrize("target", ASKED)
def test_a_page_is_written_and_all_is_run_though_something_fell(
    target: str, tmp_path: Path
) -> None:
    # make's own exit code, of a command that failed
    assert made(target, tmp_path, 1) == (ASKED[target], 2)


@pytest.mark.parametrize("target", ASKED)
@pytest.mark.parametrize("code", [130, 143])
def test_no_page_is_written_of_what_was_broken_off(target: str, code: int, tmp_path: Path) -> None:
    assert made(target, tmp_path, code) == (ASKED[target][:1], 2)
