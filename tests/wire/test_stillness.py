"""The judge of stalls sees one, and forgets it."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.wire.stillness import LIMIT_S, StallMeter

ROOT = Path(__file__).parents[2]
STALLED = """
from tests.wire import stillness

stillness.StallMeter.worst_since_s = lambda meter, start_s: 0.2
stillness.StallMeter.wait_for_calm = lambda meter, calm_s, at_most_s: None
attempts = []


def test_fails_once():
    attempts.append(1)
    assert len(attempts) > 1
"""


def test_a_stall_is_seen_once_it_is_over_and_not_later() -> None:
    meter = StallMeter()
    try:
        start_s = time.monotonic()
        os.kill(meter.pid, signal.SIGSTOP)
        time.sleep(4 * LIMIT_S)
        os.kill(meter.pid, signal.SIGCONT)
        deadline_s = start_s + 20.0
        while not meter.worst_since_s(start_s) and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert meter.worst_since_s(start_s) >= 3 * LIMIT_S
        assert meter.worst_since_s(time.monotonic() + 1.0) == 0.0
    finally:
        meter.close()


@pytest.mark.parametrize("workers", ["0", "2"])
def test_what_ran_again_is_listed_whichever_process_ran_it(workers: str, tmp_path: Path) -> None:
    pytest.importorskip("xdist")
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_planted.py").write_text(STALLED)
    command = [sys.executable, "-m", "pytest", "-c", os.devnull, "--rootdir", str(tmp_path)]
    result = subprocess.run(
        [*command, "-n", workers, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "run again" in result.stdout
    assert "test_fails_once: everything stood still for 200 ms" in result.stdout
