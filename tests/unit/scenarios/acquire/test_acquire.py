"""Files of an acquisition, complete or ended early: recording and labelled samples."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from detector.recordings import read
from grasp.run import signals
from grasp.run.messages import ARM, TACTILE, TRUTH
from grasp.run.recording import RunRecording
from scenarios.acquire import acquire
from scenarios.acquire.acquire import CHANNELS, PRESS, AcquireOutcome, AcquireResult
from scenarios.acquire.config import AcquireConfig, load_acquire_config
from scenarios.acquire.press import PressPhase, motion
from scenarios.acquire.session import Sample, open_acquire_rig
from scenarios.rigs.rig import PressRig


def config(surface: str = "planar", *assignments: str) -> AcquireConfig:
    return load_acquire_config(surface, "simulated", None, assignments)


def acquired(runs: Path, on_tick: Any = lambda sample: None, seconds: float = 4.0) -> AcquireResult:
    return acquire.run(config(), motion("0", 0.05, 1.0), 0, seconds, runs, False, on_tick)


def test_acquisition_writes_recording_result_and_samples(tmp_path: Path) -> None:
    finished = acquired(tmp_path)
    (folder,) = tmp_path.iterdir()
    assert folder.name.endswith("-acquire-planar")
    assert {path.name for path in folder.iterdir()} == {
        "recording.mcap", "result.json", "samples.npz",
    }  # fmt: skip
    assert (
        msgspec.json.decode((folder / "result.json").read_bytes(), type=AcquireResult) == finished
    )


def test_recording_has_the_whole_session_and_the_labelled_samples(
    tmp_path: Path,
) -> None:
    samples: list[Sample] = []
    finished = acquired(tmp_path, samples.append)
    assert finished.recording is not None
    recording = RunRecording(Path(finished.recording), CHANNELS)
    frames, arms, presses, truths = (list(recording.of(t)) for t in (TACTILE, ARM, PRESS, TRUTH))
    assert len(frames) == len(arms) == len(presses) == len(truths) == len(samples)
    assert presses[0][1].phase == PressPhase.APPROACH
    assert [m.command for _, m in presses] == [sample.command for sample in samples]
    labelled = read(finished.recordings[0])
    last = np.array([m.counts[:6] for _, m in frames[-finished.samples :]])
    assert (labelled.counts[:, 0] == last).all()
    assert msgspec.json.decode(recording.metadata["motion"])["direction"] == "0"
    assert msgspec.json.decode(recording.metadata["config"])["surface"]["name"] == "planar"


def test_sigterm_keeps_the_recorded_data_and_stops_the_arm(tmp_path: Path) -> None:
    samples: list[Sample] = []

    def end(sample: Sample) -> None:
        samples.append(sample)
        if len(samples) == 500:
            os.kill(os.getpid(), signal.SIGTERM)

    with signals.taken():
        finished = acquired(tmp_path, end, seconds=20.0)
    assert finished.outcome is AcquireOutcome.INTERRUPTED
    assert finished.failure is not None and finished.failure.end is not None
    assert finished.failure.message == f"terminated (SIGTERM) in phase {samples[-1].phase}"
    assert finished.failure.end.arm == "the arm is stationary"
    assert finished.recording is not None
    recording = RunRecording(Path(finished.recording), CHANNELS)
    assert recording.complete
    assert len(list(recording.of(TACTILE))) == 500
    assert len(read(finished.recordings[0]).t_s) == finished.samples > 100


def test_pause_of_the_process_splits_the_labelled_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patient = ("tactile.stale_after_missed=20", "arm.stale_after_s=1.0")
    clocks = []
    ticks = 0

    @contextmanager
    def opened(*given: Any) -> Iterator[PressRig]:
        with open_acquire_rig(*given) as rig:
            clocks.append(rig.clock)
            yield rig

    def pause(tick: Sample) -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 500:
            clocks[0].sleep_until_ns(clocks[0].now_ns + 150_000_000)

    monkeypatch.setattr(acquire, "open_acquire_rig", opened)
    finished = acquire.run(
        config("planar", *patient), motion("0", 0.05, 1.0), 0, 6.0, tmp_path, False, pause
    )
    assert finished.failure is None
    parts = [read(path) for path in finished.recordings]
    assert [Path(path).stem[-2:] for path in finished.recordings] == ["-1", "-2"]
    assert sum(len(part.t_s) for part in parts) == finished.samples == 600
    assert all(np.diff(part.t_s).min() > 0.005 for part in parts)
    assert 14 <= finished.missed_periods <= 15 and finished.repeated < 60


def failing(sample: Sample) -> None:
    """An observer that raises during a stroke."""
    if sample.phase is PressPhase.STROKE and abs(sample.arm.velocity_mps[0]) > 0.02:
        raise ZeroDivisionError("in the observer")


def test_internal_error_ends_a_session_and_stops_the_arm(tmp_path: Path) -> None:
    finished = acquired(tmp_path, failing)
    assert finished.outcome is AcquireOutcome.INTERNAL_ERROR
    assert finished.samples > 0
    assert finished.bug is not None and "in the observer" in finished.bug.traceback
    assert finished.failure is not None and finished.failure.end is not None
    assert finished.failure.kind == "internal"
    assert finished.failure.end.arm == "the arm is stationary"
    (stored,) = tmp_path.rglob("result.json")
    assert msgspec.json.decode(stored.read_bytes(), type=AcquireResult) == finished
