"""A run that is looked at is the run that nobody looks at; and what a page is told of it."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from grasp.recording import RunRecording
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.report.live_feed import LiveTrials
from scenarios.report.live_server import Begin, Message, Row
from scenarios.trial.run_folder import RUN_CHANNELS
from scenarios.trial.series import Bench
from tests.unit.scenarios.conftest import config


class Listener:
    """In place of the process that serves: keeps what it is handed."""

    def __init__(self, *_: object, **__: object) -> None:
        self.told: list[Message] = []
        self.lost, self.pid = 0, 0

    def show(self, message: Message) -> bool:
        self.told.append(message)
        return True

    def show_waiting(self, message: Message) -> None:
        self.show(message)

    def close(self) -> None:
        pass


@pytest.fixture
def listener(monkeypatch: pytest.MonkeyPatch) -> Listener:
    made = Listener()
    monkeypatch.setattr("scenarios.report.live_feed.ViewerProcess", lambda *_, **__: made)
    return made


def messages(runs: Path, watch: Any) -> list[Any]:
    """Of one lift, in virtual time."""
    (finished,) = lift.run_series(config(), [0], Bench(runs, watch=watch))
    assert finished.result is not None and finished.result.recording is not None
    return list(RunRecording(Path(finished.result.recording), RUN_CHANNELS))


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Of a run that nobody looks at."""
    return messages(tmp_path_factory.mktemp("alone"), None)


@pytest.mark.parametrize("fate", [None, signal.SIGSTOP])
def test_a_server_changes_no_message_of_a_run_whatever_becomes_of_it(
    fate: int | None, alone: list[Any], tmp_path: Path
) -> None:
    live = LiveTrials(config(), "a lift", 1)
    seen = 0

    def watch(*told: Any) -> None:
        nonlocal seen
        seen += 1
        if seen == 100 and fate is not None:
            os.kill(live.feed.pid, fate)
        live.watch(*told)

    assert messages(tmp_path / "watched", watch) == alone
    if fate is not None:
        os.kill(live.feed.pid, signal.SIGKILL)
    live.feed.close()


def columns(begin: Begin, row: Row) -> dict[str, list[float | None]]:
    found, place = {}, 0
    for name, width in begin.data["columns"]:
        found[name] = row.values[place : place + width]
        place += width
    assert place == len(row.values)
    return found


def test_rows_say_what_the_tick_and_the_world_said(
    listener: Listener,
) -> None:
    told = load_config("can", "simulated", "tcn").for_lift()
    live = LiveTrials(told, "a lift", 1)
    ticks: list[Any] = []

    def watch(tick: Any, truth: Any, controller: Any) -> None:
        ticks.append((tick, truth))
        live.watch(tick, truth, controller)

    list(lift.run_series(told, [0], Bench(None, watch=watch)))
    _, begin, *rows = listener.told
    assert isinstance(begin, Begin)
    by_time = {tick.t_ns * 1e-9: (tick, truth) for tick, truth in ticks}
    assert len(ticks) / 4 <= len(rows) < len(ticks) / 3
    for row in rows:
        assert isinstance(row, Row)
        found = columns(begin, row)
        tick, truth = by_time[found["t"][0]]
        assert row.phase == tick.decision.state
        unheard = tick.frame is None
        told = tick.observation.probabilities.tolist()
        assert found["felt"] == ([None] * 3 if unheard else list(tick.measured_n))
        assert found["probability"] == ([None] * 3 if unheard else told)
        assert found["true"] == list(truth.normal_n)
        assert found["slip"] == [truth.slip_distance_m]
        assert "told_speed" in found
    phases = list(dict.fromkeys(row.phase for row in rows))
    assert {"lift", "compensate", "hold", "lower.descend"} <= set(phases)
