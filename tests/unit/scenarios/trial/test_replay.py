"""Replay: the same code on recorded input gives the same events and commands."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.network import StreamingNetwork
from detector.recordings import Recording
from drivers.errors import BadFile
from grasp.commands import CloseFast
from grasp.controller_settings import ControllerSettings
from grasp.guard import THUMB_ALONE
from grasp.messages import CONTROL, MOTION
from grasp.recording import RunRecorder, RunRecording
from grasp.step import HEARD
from scenarios.lift import lift
from scenarios.trial.replay import replay_run
from scenarios.trial.replay_tactile import replay_tactile
from scenarios.trial.run_folder import RUN_CHANNELS
from tests.unit.scenarios.conftest import config


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = lift.run(config(), 0, tmp_path_factory.mktemp("runs")).result
    assert result is not None
    assert result.recording is not None
    return Path(result.recording)


def copy_changed(source: Path, out: Path, topic: str, at: int, **values: object) -> Path:
    """A copy of a recording in which one message differs."""
    recording = RunRecording.open(source, RUN_CHANNELS)
    seen = 0
    with RunRecorder(out, RUN_CHANNELS, recording.metadata) as writer:
        for name, t_ns, message in recording:
            if name == topic:
                seen += 1
                if seen == at:
                    message = msgspec.structs.replace(message, **values)  # noqa: PLW2901
            writer.write(name, t_ns, message)
    assert writer.failure is None
    return out


def test_replay_of_a_run_does_what_the_run_did(recorded: Path) -> None:
    replay = replay_run(recorded.parent)
    assert replay.differences == []
    assert replay.complete
    assert replay.steps > 1000
    assert any("slip registered" in what for _, what in replay.events)


def test_folder_and_file_are_both_accepted(recorded: Path) -> None:
    assert replay_run(recorded).steps == replay_run(recorded.parent).steps


@pytest.fixture(scope="module")
def bounded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lift that closes by position too, so that the anchor matters; its detector has a memory."""
    settings = config("guard.travel_bound=true")
    settings = msgspec.structs.replace(settings, detector_name="tcn")
    result = lift.run(settings, 0, tmp_path_factory.mktemp("bounded")).result
    assert result is not None and result.recording is not None
    return Path(result.recording)


def test_kind_of_slip_is_recorded_while_it_is_heard_and_plays_no_part_in_a_replay(
    bounded: Path, tmp_path: Path
) -> None:
    recording = RunRecording.open(bounded, RUN_CHANNELS)
    heard = [t_ns for t_ns, message in recording.of(CONTROL) if max(message.probabilities) > HEARD]
    assert len(heard) > 10
    assert [t_ns for t_ns, _ in recording.of(MOTION)] == heard
    before_heads = tmp_path / "older.mcap"
    with RunRecorder(before_heads, RUN_CHANNELS, recording.metadata) as writer:
        for topic, t_ns, message in recording:
            if topic != MOTION:
                writer.write(topic, t_ns, message)
    for path in (bounded, before_heads):
        assert replay_run(path).differences == []


def only_at_first(self: StreamingNetwork) -> None:
    if not hasattr(self, "_turn"):
        RESET(self)


RESET = StreamingNetwork.reset
INSIDE = {
    "the detector is reset no more": ("detector.network.StreamingNetwork.reset", only_at_first),
    "the guard is never anchored": ("grasp.guard.ForceGuard.anchor", lambda self, *a: None),
    "the guard lets all through": ("grasp.guard.ForceGuard.admit", lambda self, c, *a: c),
    "own closing is not masked": ("grasp.slip.SlipMonitor.closing", lambda self, t_ns: None),
    "force is not measured": ("grasp.guard.ForceGuard.measured_n", lambda self, c: (0.0, 0.0, 0.0)),
    "the monitor is never armed": ("grasp.slip.SlipMonitor.arm", lambda self: None),
}


@pytest.mark.parametrize("what", INSIDE)
def test_one_thing_changed_inside_the_step_is_seen_by_the_check(
    what: str, bounded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert replay_run(bounded).differences == []
    name, changed = INSIDE[what]
    monkeypatch.setattr(name, changed)
    assert replay_run(bounded).differences


def test_tampered_probability_is_found(recorded: Path, tmp_path: Path) -> None:
    changed = copy_changed(
        recorded, tmp_path / "x.mcap", CONTROL, 300, probabilities=[0.5, 0.5, 0.5]
    )
    differences = replay_run(changed).differences
    assert [d.what for d in differences] == ["probabilities"]


def test_other_samples_lead_to_other_decisions(recorded: Path, tmp_path: Path) -> None:
    lift_step = next(
        k
        for k, (_, m) in enumerate(RunRecording.open(recorded, RUN_CHANNELS).of(CONTROL))
        if m.phase == "compensate"
    )
    recording = RunRecording.open(recorded, RUN_CHANNELS)
    first = next(t for t, _ in recording.of("/tactile"))
    control_times = [t for t, _ in recording.of(CONTROL)]
    at = lift_step - control_times.index(first)
    changed = copy_changed(recorded, tmp_path / "x.mcap", "/tactile", at, counts=[0] * 18)
    assert replay_run(changed).differences


def test_recording_of_a_killed_run_is_replayed_as_far_as_it_goes(
    recorded: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size * 2 // 3])
    replay = replay_run(cut)
    assert not replay.complete
    assert replay.differences == []
    assert replay.steps > 100


def copy_with_settings(source: Path, out: Path, config: str) -> Path:
    recording = RunRecording.open(source, RUN_CHANNELS)
    with RunRecorder(out, RUN_CHANNELS, {**recording.metadata, "config": config}) as writer:
        for name, t_ns, message in recording:
            writer.write(name, t_ns, message)
    return out


def test_recording_made_with_unknown_settings_is_refused(recorded: Path, tmp_path: Path) -> None:
    out = copy_with_settings(recorded, tmp_path / "x.mcap", '{"rig": "simulated", "novel": 1}')
    with pytest.raises(BadFile, match="do not fit this version"):
        replay_run(out)


def test_sections_of_other_scenarios_do_not_matter_to_a_replay(
    recorded: Path, tmp_path: Path
) -> None:
    settings = RunRecording.open(recorded, RUN_CHANNELS).metadata["config"]
    assert '"tap"' not in settings
    more = settings.replace('"scoring":{', '"juggling":{"balls":3},"scoring":{"novel":1,')
    assert more != settings
    assert replay_run(copy_with_settings(recorded, tmp_path / "x.mcap", more)).steps > 0


def fingertip_strokes() -> Recording:
    """Four seconds at rest with two loud strokes of 0.6 s."""
    rng = np.random.default_rng(0)
    n = 400
    slip = np.zeros(n, bool)
    slip[120:180] = slip[260:320] = True
    steps = rng.normal(0, np.where(slip, 20.0, 1.0)[:, None], (n, 6))
    counts = (-150 + np.cumsum(steps, axis=0) * 0.3 + steps).astype(np.int16)
    return Recording(np.arange(n) * 0.01, counts[:, None, :], slip, None, "made up")


def test_every_stroke_of_a_fingertip_recording_is_answered_once_by_closing() -> None:
    replay = replay_tactile(config(), fingertip_strokes())
    assert [finger for _, finger in replay.registered] == ["A", "A"]
    sent = [(c.t_s, c.command) for c in replay.commands if isinstance(c.command, CloseFast)]
    assert [command.more for _, command in sent] == [True, False] * 2
    closings = [t_s for t_s, command in sent if command.more]
    assert 1.2 < closings[0] < 1.4
    assert 2.6 < closings[1] < 2.8


def test_guard_limits_what_a_fingertip_recording_would_have_sent() -> None:
    replay = replay_tactile(config(), fingertip_strokes())
    closings = [c.command for c in replay.commands if isinstance(c.command, CloseFast)]
    assert closings
    assert all(c.force_cap_n == 10.0 and c.closing == THUMB_ALONE for c in closings)
    full_mps = ControllerSettings().closing_speed_mps
    assert all((c.speed_mps < full_mps) is (c.limits_counts[0] > 200) for c in closings)
