"""Replay: the same code with recorded input gives the same events and commands."""

from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from detector import network
from detector.decision import registered_events
from detector.network import RuntimeNetwork, StreamingNetwork
from detector.recordings import Recording
from detector.scores.evaluation import stream
from grasp.control.commands import CloseToLimit
from scenarios.lift.lift import lift
from scenarios.trial import replay_tactile as replay_module
from scenarios.trial.replay import replay_run
from scenarios.trial.replay_tactile import replay_tactile
from tests.unit.scenarios.conftest import config


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = lift.run(config(), 0, tmp_path_factory.mktemp("runs")).result
    assert result is not None
    assert result.recording is not None
    return Path(result.recording)


def test_replay_of_a_run_has_no_differences(recorded: Path) -> None:
    replay = replay_run(recorded.parent)
    assert replay.differences == []
    assert replay.complete
    assert replay.steps > 1000
    assert any("slip registered" in what for _, what in replay.events)


@pytest.fixture(scope="module")
def bounded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lift with a travel bound, which depends on the reference grasp, and a detector with
    memory."""
    settings = config("object.contact_stiffness_npm=2500")
    settings = msgspec.structs.replace(settings, detector_name="tcn")
    result = lift.run(settings, 0, tmp_path_factory.mktemp("bounded")).result
    assert result is not None and result.recording is not None
    return Path(result.recording)


def test_run_with_compiled_network_is_replayed_in_onnx_runtime(
    bounded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("detector.network.engine_of", RuntimeNetwork)
    replay = replay_run(bounded)
    assert replay.differences == [] and replay.complete


def only_at_first(self: StreamingNetwork) -> None:
    if not hasattr(self, "_started"):
        RESET(self)


RESET = StreamingNetwork.reset
INSIDE = {
    "the detector is never reset": ("detector.network.StreamingNetwork.reset", only_at_first),
    "the guard never gets the first grasp": (
        "grasp.control.guard.ForceGuard.set_first_grasp",
        lambda self, *a: None,
    ),
    "the guard lets all through": ("grasp.control.guard.ForceGuard.admit", lambda self, c, *a: c),
    "closing is not masked": (
        "grasp.control.slip_monitor.SlipMonitor.closing",
        lambda self, t_ns: None,
    ),
    "force is not measured": (
        "grasp.control.guard.ForceGuard.estimated_n",
        lambda self, c: (0.0, 0.0, 0.0),
    ),
    "the monitor is never armed": ("grasp.control.slip_monitor.SlipMonitor.arm", lambda self: None),
}


def test_every_change_inside_the_control_step_is_found(
    bounded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for what, (name, changed) in INSIDE.items():
        with monkeypatch.context() as patch:
            patch.setattr(name, changed)
            assert replay_run(bounded).differences, what


def test_recording_of_a_killed_run_is_replayed_to_its_end(recorded: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size * 2 // 3])
    replay = replay_run(cut)
    assert not replay.complete
    assert replay.differences == []
    assert replay.steps > 100


def fingertip_strokes() -> Recording:
    """Four seconds at rest with two strong strokes of 0.6 s."""
    rng = np.random.default_rng(0)
    n = 400
    slip = np.zeros(n, bool)
    slip[120:180] = slip[260:320] = True
    steps = rng.normal(0, np.where(slip, 20.0, 1.0)[:, None], (n, 6))
    counts = (-150 + np.cumsum(steps, axis=0) * 0.3 + steps).astype(np.int16)
    return Recording(np.arange(n) * 0.01, counts[:, None, :], slip, None, "made up")


def test_slip_of_one_finger_is_registered_as_by_an_evaluation() -> None:
    recording, c = fingertip_strokes(), config()
    p, _ = stream(c.make_detector(recording.fingers), recording.counts)
    events = registered_events(p, c.rule)
    assert [t for t, _ in replay_tactile(c, recording).registered] == [
        pytest.approx(recording.t_s[first]) for first, _ in events
    ]
    assert len(events) > 0


def test_every_stroke_of_a_fingertip_recording_causes_one_closing() -> None:
    replay = replay_tactile(config(), fingertip_strokes())
    assert [finger for _, finger in replay.registered] == ["A", "A"]
    sent = [(c.t_s, c.command) for c in replay.commands if isinstance(c.command, CloseToLimit)]
    assert [command.first_stage for _, command in sent] == [True, False] * 2
    closings = [t_s for t_s, command in sent if command.first_stage]
    assert 1.2 < closings[0] < 1.4
    assert 2.6 < closings[1] < 2.8


def test_lifts_that_fail_at_once_share_one_detector_and_are_few(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    unloaded = msgspec.structs.replace(fingertip_strokes(), counts=np.zeros((400, 1, 6), np.int16))
    calls = Counter[str]()
    for where, name in ((replay_module, "make_step"), (network, "read_network")):
        function = getattr(where, name)

        def counted(*args: Any, name: str = name, function: Any = function, **named: Any) -> Any:
            calls[name] += 1
            return function(*args, **named)

        monkeypatch.setattr(where, name, counted)
    replay_tactile(config(), unloaded)
    assert calls["make_step"] <= 12
    assert calls["read_network"] <= 3
