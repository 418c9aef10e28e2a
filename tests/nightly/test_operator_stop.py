"""Ctrl-C, and devices that freeze or end, during a motion of real-protocol devices."""

import json
import signal
from pathlib import Path

import pytest

from tests.wire.lab import ALONE, CONFIRMED, HARDWARE, Lab, emulate, sets, started
from tests.wire.waiting import PATIENCE_S, until


def test_ctrl_c_stops_the_activation_and_leaves_the_hand_inactive(tmp_path: Path) -> None:
    with emulate("--set", "hand.activation_s=10") as endpoints:
        lab = Lab(endpoints, tmp_path)
        with lab.started("gripper", "activate", "--empty", *CONFIRMED) as run:
            until(lambda: max(lab.positions) > 20)
            run.send_signal(signal.SIGINT)
            _, err = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 130, err
        assert "the fingers have stopped; the hand is not active any more" in err
        assert not lab.hand.active and lab.ask("motion")["fingers_mps"] == 0.0
        lab.cell.close()


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_frozen_or_ended_devices_are_all_named_and_the_result_is_written(
    number: signal.Signals, tmp_path: Path
) -> None:
    with started("emulate", *sets()) as cell:
        assert cell.stdout is not None
        lab = Lab(json.loads(cell.stdout.readline()), tmp_path)
        lab.activate_hand()
        arguments = ("run", "lift", *HARDWARE, *CONFIRMED, *ALONE, "--runs", str(tmp_path / "runs"))
        with lab.started(*arguments, *sets()) as run:
            assert run.stdout is not None
            assert any("lift" in line.split() for line in run.stdout)
            cell.send_signal(number)
            _, err = run.communicate(timeout=PATIENCE_S)
        lab.cell.close()
    assert run.returncode in (3, 4), err
    (path,) = (tmp_path / "runs").glob("*/result.json")
    result = json.loads(path.read_text())
    assert result["outcome"] == "fault"
    assert "at its last status" in result["end"]["arm"]
    assert "cannot be commanded and holds by itself" in result["end"]["hand"]
