"""A live page does not change a run, and gets the recorded values."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from grasp.run.recording import RunRecording
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.report.live_feed import LiveTrials
from scenarios.report.live_server import Begin, Message, Row
from scenarios.trial.experiment import TrialContext
from scenarios.trial.run_folder import RUN_CHANNELS
from scenarios.trial.series import run_series
from tests.unit.scenarios.conftest import config


class FakeServer:
    """A stub for the server process that keeps all messages."""

    def __init__(self, *_: object, **__: object) -> None:
        self.messages: list[Message] = []
        self.lost, self.pid = 0, 0

    def show(self, message: Message) -> bool:
        self.messages.append(message)
        return True

    def show_waiting(self, message: Message) -> None:
        self.show(message)

    def close(self) -> None:
        pass


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> FakeServer:
    made = FakeServer()
    monkeypatch.setattr("scenarios.report.live_feed.ViewerProcess", lambda *_, **__: made)
    return made


def messages(runs: Path, watch: Any) -> list[Any]:
    """Recorded messages of one lift in virtual time."""
    (finished,) = run_series(lift, config(), [0], TrialContext(runs, watch=watch))
    assert finished.result is not None and finished.result.recording is not None
    return list(RunRecording(Path(finished.result.recording), RUN_CHANNELS))


@pytest.fixture(scope="module")
def unobserved(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Recorded messages of a run without a live page."""
    return messages(tmp_path_factory.mktemp("unobserved"), None)


@pytest.mark.parametrize("fate", [None, signal.SIGSTOP])
def test_server_changes_no_message_of_a_run_even_if_it_stops(
    fate: int | None, unobserved: list[Any], tmp_path: Path
) -> None:
    live = LiveTrials(config(), "a lift", 1)
    ticks = 0

    def watch(*args: Any) -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 100 and fate is not None:
            os.kill(live.feed.pid, fate)
        live.watch(*args)

    assert messages(tmp_path / "watched", watch) == unobserved
    if fate is not None:
        os.kill(live.feed.pid, signal.SIGKILL)
    live.feed.close()


def test_rows_have_the_values_of_tick_and_truth(server: FakeServer) -> None:
    settings = load_config("can", "simulated", "tcn").for_lift()
    live = LiveTrials(settings, "a lift", 1)
    ticks: list[Any] = []

    def watch(tick: Any, truth: Any, controller: Any) -> None:
        ticks.append((tick, truth))
        live.watch(tick, truth, controller)

    list(run_series(lift, settings, [0], TrialContext(None, watch=watch)))
    _, begin, *rows = server.messages
    assert isinstance(begin, Begin)
    assert isinstance(rows[0], Row)
    widths = [len(values) for values in rows[0].values.values()]
    by_time = {tick.t_ns * 1e-9: (tick, truth) for tick, truth in ticks}
    assert len(ticks) / 4 <= len(rows) < len(ticks) / 3
    for row in rows:
        assert isinstance(row, Row)
        found = {name: list(values) for name, values in row.values.items()}
        assert list(map(len, found.values())) == widths
        tick, truth = by_time[found["t"][0]]
        assert row.phase == tick.decision.state
        missing = tick.frame is None
        probabilities = tick.observation.probabilities.tolist()
        assert found["estimated"] == ([None] * 3 if missing else list(tick.estimated_n))
        assert found["probability"] == ([None] * 3 if missing else probabilities)
        assert found["true"] == list(truth.normal_n)
        assert found["slip"] == [truth.slip_distance_m]
        assert "reported_speed" in found
    phases = list(dict.fromkeys(row.phase for row in rows))
    assert {"lift", "compensate", "hold", "lower.descend"} <= set(phases)
