"""The doubts: how soon each fault is there, and how often one is raised where nothing is wrong.

TRIALS repetitions of the paper's campaign (20 in full), TAPS taps an object (167 in full: 1,000), a
folder of recordings in CONFUSERS (`grasp dataset build config/datasets/confusers.toml --out DIR`).
"""

import itertools
import os
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from detector import recordings
from detector.recordings import Recording
from drivers.interfaces import FINGERS, PERIOD_NS
from grasp.doubt import Doubts, DoubtSettings, FingertipDoubt
from grasp.loop import Tick
from grasp.phases import Phase
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import combinations, read_spec, trials
from scenarios.lift import lift
from scenarios.tap import tap
from scenarios.tap.config import TapConfig
from tests.unit.scenarios.conftest import Staged
from tests.unit.scenarios.lift.doubt_delays import delay_ms
from tests.unit.scenarios.lift.test_doubt_delays import CASES, WITHIN_MS, staged

ROOT = Path(__file__).parents[2]
CLIP = ROOT.parent / "shared" / "data" / "takktile_felt.csv"  # never in the repository
OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
TRIALS = int(os.environ.get("TRIALS", "2"))
TAPS = int(os.environ.get("TAPS", "4"))
CONFUSERS = os.environ.get("CONFUSERS", "")
REST = 450  # of a recording, whose counts are without it
STRICT = DoubtSettings(  # half the patience everywhere
    frozen_samples=4, dead_samples=4, dead_unloaded_samples=25, loaded_counts=15, rail_samples=1,
    jump_counts=20, detector_s=0.05, standstill_s=0.075, echo_s=0.075, finger_start_s=0.15,
    stands_s=0.075, target_counts=4, finger_counts_ps=150.0, arm_start_s=0.125, arm_frozen_s=0.03,
    arm_moved_m=0.0004, arm_there_m=0.001, arm_astray_m=0.001, arm_fastest_mps=0.5,
    arm_jump_m=0.005,
)  # fmt: skip


class Watch:
    """What a run's ticks would make of other settings."""

    def __init__(self) -> None:
        self.named: Counter[str] = Counter()
        self.strict: Counter[str] = Counter()
        self.steps = 0

    def begin(self) -> None:
        self._doubts = Doubts(STRICT)
        self._phase = Phase.IDLE
        self._found: set[str] = set()

    def take(self, tick: Tick) -> None:
        seen = tick.observation
        doubt = self._doubts.of(
            self._phase, tick.frame, tick.gripper, tick.arm, seen.pending, seen.late_ns,
            seen.took_ns,
        )  # fmt: skip
        self._doubts.sent(tick.decision.commands, tick.arm)
        self._phase = tick.decision.phase
        self.steps += 1
        self.named.update(names(seen.doubt))
        self.strict.update(names(doubt) - self._found)
        self._found |= names(doubt)


def names(doubt: str) -> set[str]:
    return {part.partition(":")[0] for part in doubt.split("; ") if part}


def report(title: str, watch: Watch, runs: int) -> None:
    hours = watch.steps * PERIOD_NS / 3.6e12
    print(f"| {title} | {runs} | {hours:.2f} | {watch.named.total()} {dict(watch.named) or ''} | "
          f"{watch.strict.total()} {dict(watch.strict) or ''} |")  # fmt: skip


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_no_doubt_in_the_paper_s_trials() -> None:
    spec = read_spec(ROOT / "config" / "campaigns" / "paper.toml")
    spec = msgspec.structs.replace(spec, repetitions=TRIALS)
    watch, runs = Watch(), 0
    for task in trials(spec, combinations(spec)):
        watch.begin()
        run = tap.run if isinstance(task.config, TapConfig) else lift.run
        run(task.config, task.seed, None, on_tick=watch.take)  # type: ignore[arg-type]
        runs += 1
    report("the paper's trials", watch, runs)
    assert not watch.named


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_no_doubt_in_taps() -> None:
    watch, runs = Watch(), 0
    for name in OBJECTS:
        config = load_config(name, "simulated", "energy", None, ()).for_tap()
        for seed in range(1000, 1000 + TAPS):
            watch.begin()
            tap.run(config, seed, None, on_tick=watch.take)
            runs += 1
    report("taps", watch, runs)
    assert not watch.named


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_no_doubt_in_confusers() -> None:
    """Three recordings of one cause are the three fingertips of a hand."""
    if not CONFUSERS:
        pytest.skip("no confusers here")
    causes: dict[str, list[Recording]] = {}
    for recording in recordings.read_dataset(CONFUSERS):
        causes.setdefault(cause_of(recording), []).append(recording)
    watch, hands = Watch(), 0
    for cause, found in sorted(causes.items()):
        for three in zip(*[iter(found)] * FINGERS, strict=False):
            length = min(len(r.counts) for r in three)
            counts = np.concatenate([r.counts[:length] for r in three], axis=1)[:, :FINGERS]
            listen(watch, counts, skip_repeats=cause == "lost_samples")
            hands += 1
    report("confusers, three fingertips each", watch, hands)
    assert not watch.named


@pytest.mark.bench
def test_no_doubt_in_the_real_recording() -> None:
    """One fingertip, four seconds: itself at three times stands for a hand."""
    if not CLIP.exists():
        pytest.skip("the authors' recording is not here")
    one = recordings.read(CLIP).counts
    watch = Watch()
    listen(watch, np.concatenate([np.roll(one, k * 139, axis=0) for k in range(3)], axis=1))
    report("the real recording", watch, 1)
    assert not watch.named


def cause_of(recording: Recording) -> str:
    assert recording.metadata is not None
    return recording.metadata.cause or ""


def listen(watch: Watch, counts: NDArray[np.int16], skip_repeats: bool = False) -> None:
    """Counts (n, fingers, 6). In a recording a lost sample repeats the one before; a driver would
    have called it missed."""
    for settings, into in ((DoubtSettings(), watch.named), (STRICT, watch.strict)):
        fingertips, found = FingertipDoubt(settings), set[str]()
        for before, now in itertools.pairwise(counts):
            if not (skip_repeats and (now == before).all(axis=1).any()):
                fingertips.take(now + np.int16(REST), now)
            found |= names(fingertips.wrong())
        into.update(found)
    watch.steps += len(counts)


@pytest.mark.bench
@pytest.mark.timeout(7200)
def test_delays() -> None:
    """From when it could be told from what is normal (`doubt_delays`) to the step that answers, and
    from the fault itself."""
    print("\n| what happens | name | delay, ms: least, most | from the fault on, ms |")
    print("|---|---|---|---|")
    for act, phases, name in CASES:
        delays: list[float] = []
        whole: list[float] = []
        for phase, seed, after in itertools.product(phases, range(3), (0, 2, 5, 12)):
            lift, found = staged(act, phase, after, seed)
            assert found == name
            delays.append(delay_ms(lift, name))
            whole.append(since_injected_ms(lift))
        assert max(delays) <= WITHIN_MS
        print(f"| {act.__name__} | {name} | {min(delays):.0f}, {max(delays):.0f} | "
              f"{min(whole):.0f}, {max(whole):.0f} |")  # fmt: skip


def since_injected_ms(lift: Staged) -> float:
    assert lift.done_at_ns is not None
    end_ns = next(t.t_ns for t in lift.ticks if t.decision.phase is Phase.FAULT)
    return (end_ns - lift.done_at_ns) / 1e6
