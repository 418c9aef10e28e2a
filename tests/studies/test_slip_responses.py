"""Responses to slip: an arm that stops saves slip, false alarms come at their rate."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.interfaces import PERIOD_NS
from grasp.run.clock import VirtualClock
from studies import runner
from studies.slip_responses import STUDY, FalseAlarms


class Quiet:
    def reset(self) -> None: ...

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        return np.full(3, 0.25)


def test_false_alarms_come_at_their_rate_and_last_a_tenth_of_a_second() -> None:
    clock = VirtualClock(lambda now_ns: None)
    detector = FalseAlarms(Quiet(), clock, a_minute=60.0, seed=1)
    probabilities = []
    for _ in range(6000):
        clock.sleep_until_ns(clock.now_ns + PERIOD_NS)
        probabilities.append(detector.update(np.zeros((3, 5), np.int16))[0])
    assert set(probabilities) == {0.25, 1.0}
    started = detector.between(0, clock.now_ns)
    assert started == pytest.approx(60, abs=25)
    assert 5 * started < probabilities.count(1.0) <= 10 * started


def test_stopping_the_arm_reduces_slip_and_a_pull_in_the_air_is_harder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "--objects can --seeds 1 --first-seed 9000 --detector gru --jobs 1 --scenes easy"
    few = ["--policies", "close", "stop_and_close", "--out", str(tmp_path)]
    assert runner.main("x", STUDY, [*words.split(), *few]) == 0
    assert "| as configured | stop_and_close | 1 of 1 |" in capsys.readouterr().out
    stored = (tmp_path / "rows.jsonl").read_text().splitlines()[1:]
    rows = [runner.json.loads(line)["row"] for line in stored]
    close, stop = sorted(rows, key=lambda row: row["policy"])
    assert stop["slip_mm"] < 0.6 * close["slip_mm"]
    assert stop["force_n"] == pytest.approx(close["force_n"], abs=0.1)
    assert stop["paused_s"] > 0.0 == close["paused_s"]
