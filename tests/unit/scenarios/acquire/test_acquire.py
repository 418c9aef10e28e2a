"""What an acquisition leaves, however it ends: the recording of every run, and labelled samples."""

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
from grasp import signals
from grasp.messages import ARM, TACTILE, TRUTH
from grasp.recording import RunRecording
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


def test_a_run_leaves_a_folder_as_every_run_does(tmp_path: Path) -> None:
    finished = acquired(tmp_path)
    (folder,) = tmp_path.iterdir()
    assert folder.name.endswith("-acquire-planar")
    assert {path.name for path in folder.iterdir()} == {
        "recording.mcap", "result.json", "samples.npz",
    }  # fmt: skip
    assert (
        msgspec.json.decode((folder / "result.json").read_bytes(), type=AcquireResult) == finished
    )


def test_the_recording_has_the_whole_session_and_the_labelled_samples_are_of_it(
    tmp_path: Path,
) -> None:
    seen: list[Sample] = []
    finished = acquired(tmp_path, seen.append)
    assert finished.recording is not None
    recording = RunRecording(Path(finished.recording), CHANNELS)
    frames, arms, presses, truths = (list(recording.of(t)) for t in (TACTILE, ARM, PRESS, TRUTH))
    assert len(frames) == len(arms) == len(presses) == len(truths) == len(seen)
    assert presses[0][1].phase == PressPhase.APPROACH
    assert [m.asked for _, m in presses] == [sample.asked for sample in seen]
    labelled = read(finished.recordings[0])
    last = np.array([m.counts[:6] for _, m in frames[-finished.samples :]])
    assert (labelled.counts[:, 0] == last).all()
    assert msgspec.json.decode(recording.metadata["motion"])["direction"] == "0"
    assert msgspec.json.decode(recording.metadata["config"])["surface"]["name"] == "planar"


def test_sigterm_keeps_what_was_recorded_and_leaves_the_arm_standing(tmp_path: Path) -> None:
    seen: list[Sample] = []

    def end(sample: Sample) -> None:
        seen.append(sample)
        if len(seen) == 500:
            os.kill(os.getpid(), signal.SIGTERM)

    with signals.taken():
        finished = acquired(tmp_path, end, seconds=20.0)
    assert finished.outcome is AcquireOutcome.INTERRUPTED
    assert finished.failure is not None and finished.failure.end is not None
    assert finished.failure.message == f"terminated (SIGTERM) in phase {seen[-1].phase}"
    assert finished.failure.end.arm == "the arm stands"
    assert finished.recording is not None
    recording = RunRecording(Path(finished.recording), CHANNELS)
    assert recording.complete
    assert len(list(recording.of(TACTILE))) == 500
    assert len(read(finished.recordings[0]).t_s) == finished.samples > 100


def test_a_machine_that_stood_still_leaves_two_recordings_and_no_burst(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patient = ("tactile.stale_after_missed=20", "arm.stale_after_s=1.0")
    clocks = []
    ticks = 0

    @contextmanager
    def remembered(*given: Any) -> Iterator[PressRig]:
        with open_acquire_rig(*given) as rig:
            clocks.append(rig.clock)
            yield rig

    def stand_still(tick: Sample) -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 500:
            clocks[0].sleep_until_ns(clocks[0].now_ns + 150_000_000)

    monkeypatch.setattr(acquire, "open_acquire_rig", remembered)
    finished = acquire.run(
        config("planar", *patient), motion("0", 0.05, 1.0), 0, 6.0, tmp_path, False, stand_still
    )
    assert finished.failure is None
    parts = [read(path) for path in finished.recordings]
    assert [Path(path).stem[-2:] for path in finished.recordings] == ["-1", "-2"]
    assert sum(len(part.t_s) for part in parts) == finished.samples == 600
    assert all(np.diff(part.t_s).min() > 0.005 for part in parts)
    assert 14 <= finished.missed_periods <= 15 and finished.repeated < 60


def striking(sample: Sample) -> None:
    """A bug in what watches, in the midst of a stroke."""
    if sample.phase is PressPhase.STROKE and abs(sample.arm.velocity_mps[0]) > 0.02:
        raise ZeroDivisionError("in what watches")


def test_bug_of_ours_ends_a_session_as_a_fault_does_and_the_arm_stands(tmp_path: Path) -> None:
    finished = acquired(tmp_path, striking)
    assert finished.outcome is AcquireOutcome.INTERNAL_ERROR
    assert finished.samples > 0
    assert finished.bug is not None and "in what watches" in finished.bug.traceback
    assert finished.failure is not None and finished.failure.end is not None
    assert finished.failure.kind == "internal"
    assert finished.failure.end.arm == "the arm stands"
    (stored,) = tmp_path.rglob("result.json")
    assert msgspec.json.decode(stored.read_bytes(), type=AcquireResult) == finished
