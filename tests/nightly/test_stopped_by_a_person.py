"""A person's Ctrl-C, and devices that freeze or go, in the midst of a motion at a lab."""

import json
import signal
from pathlib import Path

import pytest

from tests.wire.lab import CONFIRMED, HARDWARE, PATIENCE_S, Lab, emulate, sets, started, until


def test_activation_is_stopped_by_ctrl_c_and_the_hand_is_inactive_then(tmp_path: Path) -> None:
    with emulate("--set", "hand.activation_s=10") as endpoints:
        lab = Lab(endpoints, tmp_path)
        with lab.started("gripper", "activate", "--empty", *CONFIRMED) as run:
            until(lambda: max(lab.positions) > 20)
            run.send_signal(signal.SIGINT)
            _, said = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 130, said
        assert "the fingers have stopped; the hand is not active any more" in said
        assert not lab.hand.active and lab.ask("motion")["fingers_mps"] == 0.0
        lab.cell.close()


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_devices_that_freeze_or_go_are_all_named_and_cost_no_result(
    number: signal.Signals, tmp_path: Path
) -> None:
    with started("emulate", *sets()) as cell:
        assert cell.stdout is not None
        lab = Lab(json.loads(cell.stdout.readline()), tmp_path)
        lab.activate_hand()
        words = ("run", "lift", *HARDWARE, *CONFIRMED, "--runs", str(tmp_path / "runs"))
        with lab.started(*words, *sets()) as run:
            assert run.stdout is not None
            assert any("lift" in line.split() for line in run.stdout)
            cell.send_signal(number)
            _, said = run.communicate(timeout=PATIENCE_S)
        lab.cell.close()
    assert run.returncode in (3, 4), said
    (path,) = (tmp_path / "runs").glob("*/result.json")
    result = json.loads(path.read_text())
    assert result["outcome"] == "fault"
    assert "when last heard" in result["end"]["arm"]
    assert "cannot be told anything and holds by itself" in result["end"]["hand"]
