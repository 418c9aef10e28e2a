"""How often a check finds fault where nothing is wrong; `grasp/doubt.py` has the checks.

    python scripts/false_faults.py [--detector NAME] [--jobs 2]       all sets: half an hour
    python scripts/false_faults.py --only paper taps --trials 2 --taps 12

Runs the paper's trials with both profiles (`paper` closes with each motor's own limit), taps, the
recordings of `config/datasets/confusers.toml`, three as the three fingertips of a hand, and, with
`--recording FILE`, a real one, itself at three times. Prints two tables for docs/faults.md: in how
many runs each check spoke, as it is set and with half and a quarter of its patience, which changes
no run; whatever else ended a run in the safe state; and how many ended with the object neither set
down nor fallen (`lost`). Exit 1 if a check as it is set spoke, or a run ended so.
"""

import argparse
import itertools
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector import recordings
from detector.recordings import Recording
from drivers.interfaces import FINGERS, PERIOD_NS
from grasp.doubt import Doubts
from grasp.doubt_settings import DoubtSettings
from grasp.fingertip_doubt import FingertipDoubt
from grasp.loop import Tick
from grasp.phases import Phase
from scenarios.acquire.datasets.build import build
from scenarios.acquire.datasets.plan import load_dataset_config, plan, reduced
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import combinations, read_spec, trials
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs.workers import Workers, results
from scenarios.tap import tap
from scenarios.tap.config import TapConfig

HOME = Path(__file__).resolve().parent.parent
OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
SETS = ("paper", "each-motor", "taps", "confusers", "recording")
TITLES = ("paper's trials", "the same, profile `paper`", "taps", "confusers", "real recording")
FIRST_TAP = 1000  # seed: none that the paper's trials use
REST = 450  # counts of a recording are without it
BATCH = 12  # runs that a worker takes at a time
# where every check of grasp/doubt.py can speak; of the others a simulated rig gives no occasion
CHECKS = (
    "fingertips_frozen", "fingertip_dead", "fingertip_deaf", "fingertips_at_rail",
    "fingertips_jump", "fingertips_absent", "detector_failed", "gripper_silent", "gripper_stands",
    "gripper_inactive", "gripper_impossible", "gripper_flickers", "arm_position_nan", "arm_frozen",
    "arm_wrong_way", "arm_goes_on", "arm_jump", "arm_flickers",
)  # fmt: skip
PATIENCE = ("1", "1/2", "1/4")
RANGES = (
    "soft_low_counts", "soft_high_counts", "pressing_ma", "stuck_samples", "living_share",
    "repeat_chance",
)  # fmt: skip
Trial = tuple[LiftConfig | TapConfig, int]  # settings and seed


@dataclass
class Tally:
    """What came of some runs: in how many each check spoke, by its patience, and why they ended."""

    spoke: dict[str, Counter[str]] = field(default_factory=lambda: {p: Counter() for p in PATIENCE})
    ended: Counter[str] = field(default_factory=Counter)
    runs: int = 0
    steps: int = 0

    def add(self, other: "Tally") -> None:
        for patience in PATIENCE:
            self.spoke[patience].update(other.spoke[patience])
        self.ended.update(other.ended)
        self.runs += other.runs
        self.steps += other.steps


def impatient(settings: DoubtSettings, times: int) -> DoubtSettings:
    """With 1/times of the patience, or of the margin, everywhere."""
    changed = {}
    for name in settings.__struct_fields__:
        value = getattr(settings, name)
        changed[name] = max(1, value // times) if isinstance(value, int) else value / times
    changed["arm_moved_m"] = settings.arm_moved_m * times  # motion that counts as none
    changed |= {name: getattr(settings, name) for name in RANGES}
    return msgspec.structs.replace(settings, **changed)


class Watch:
    """What a run's ticks make of each patience."""

    def __init__(self, settings: DoubtSettings) -> None:
        self.said: dict[str, set[str]] = {patience: set() for patience in PATIENCE}
        self.steps = 0
        self._own = [Doubts(impatient(settings, 2)), Doubts(impatient(settings, 4))]
        self.phase = Phase.IDLE

    def take(self, tick: Tick) -> None:
        seen = tick.observation
        self.said["1"] |= names(seen.doubt)
        for patience, doubts in zip(PATIENCE[1:], self._own, strict=True):
            self.said[patience] |= names(
                doubts.of(
                    self.phase, tick.frame, tick.gripper, tick.arm, seen.pending, seen.late_ns,
                    seen.took_ns,
                )
            )  # fmt: skip
            doubts.sent(tick.decision.commands, tick.arm)
        self.phase = tick.decision.phase
        self.steps += 1


def names(doubt: str) -> set[str]:
    """The checks that spoke."""
    return {part.partition(":")[0] for part in doubt.split("; ") if part}


def run_batch(batch: Sequence[Trial]) -> Tally:
    """Run the trials and watch them."""
    tally = Tally()
    for config, seed in batch:
        watch = Watch(config.doubt)
        if isinstance(config, TapConfig):
            finished: Any = tap.run(config, seed, None, on_tick=watch.take)
        else:
            finished = lift.run(config, seed, None, on_tick=watch.take)
        for patience, said in watch.said.items():
            tally.spoke[patience].update(said)
        if finished.failure is not None:
            tally.ended[finished.failure.message] += 1
        elif watch.phase is Phase.LOST:
            tally.ended["lost"] += 1
        tally.runs += 1
        tally.steps += watch.steps
    return tally


def run_all(todo: Sequence[Trial], jobs: int) -> Tally:
    """Run the trials in worker processes and watch them."""
    batches = [todo[at : at + BATCH] for at in range(0, len(todo), BATCH)]
    total = Tally()
    for tally in results(run_batch, batches, Workers(jobs)):
        total.add(tally)
        spoke = total.spoke["1"].total()
        print(f"{total.runs} of {len(todo)}: {spoke} doubts, {total.ended.total()} ended in the "
              "safe state", file=sys.stderr, flush=True)  # fmt: skip
    return total


def paper_trials(profile: str, detector: str | None, repetitions: int) -> list[Trial]:
    """Of `config/campaigns/paper.toml`, with another profile."""
    spec = msgspec.structs.replace(
        read_spec(HOME / "config" / "campaigns" / "paper.toml"),
        profiles=(profile,), detectors=() if detector is None else (detector,),
        repetitions=repetitions,
    )  # fmt: skip
    return [(task.config, task.seed) for task in trials(spec, combinations(spec))]


def taps(detector: str | None, number: int) -> list[Trial]:
    """So many, the objects in turn."""
    configs = [load_config(name, "simulated", detector).for_tap() for name in OBJECTS]
    return [(configs[i % len(OBJECTS)], FIRST_TAP + i // len(OBJECTS)) for i in range(number)]


def listen(counts: NDArray[np.int16], lost: bool = False) -> Tally:
    """Counts (n, fingers, 6) as a hand's fingertips. ``lost``: a sample that was lost repeats the
    one before; a driver would have called it missed."""
    tally = Tally()
    for patience, times in zip(PATIENCE, (1, 2, 4), strict=True):
        fingertips = FingertipDoubt(impatient(DoubtSettings(), times))
        said: set[str] = set()
        for before, now in itertools.pairwise(counts):
            if not (lost and (now == before).all(axis=1).any()):
                fingertips.take(now + np.int16(REST), now)
            said |= names(fingertips.wrong())
        tally.spoke[patience].update(said)
    tally.runs, tally.steps = 1, len(counts)
    return tally


def hands(folder: Path) -> Iterator[tuple[str, NDArray[np.int16]]]:
    """Three recordings of one cause at a time, with the cause."""
    causes: dict[str, list[Recording]] = {}
    for recording in recordings.read_dataset(folder):
        assert recording.metadata is not None  # noqa: S101  (of a data set)
        causes.setdefault(recording.metadata.cause, []).append(recording)
    for cause, found in sorted(causes.items()):
        for three in zip(*[iter(found)] * FINGERS, strict=False):
            length = min(len(r.counts) for r in three)
            yield cause, np.concatenate([r.counts[:length] for r in three], axis=1)[:, :FINGERS]


def confusers(folder: Path | None, share: float, jobs: int) -> Tally:
    """All of them, from a folder or made anew."""
    total = Tally()
    with tempfile.TemporaryDirectory() as scratch:
        if folder is None:
            folder = Path(scratch) / "confusers"
            whole = load_dataset_config(HOME / "config" / "datasets" / "confusers.toml")
            config = reduced(whole, share)
            wanted = plan(config)
            build(wanted, config, folder, Workers(jobs), lambda done, total: None)
        for cause, counts in hands(folder):
            total.add(listen(counts, lost=cause == "lost_samples"))
    return total


def real(path: Path) -> Tally:
    """One fingertip, four seconds: itself at three times stands for a hand."""
    one = recordings.read(path).counts
    return listen(np.concatenate([np.roll(one, k * 139, axis=0) for k in range(FINGERS)], axis=1))


def tables(found: dict[str, Tally]) -> str:
    """As docs/faults.md has them."""
    titles = [TITLES[SETS.index(name)] for name in found]
    lines = [f"| check | {' | '.join(titles)} |", "|---" * (1 + len(titles)) + "|"]
    sizes = [f"{t.runs} runs, {t.steps * PERIOD_NS / 3.6e12:.2f} h" for t in found.values()]
    lines.append(f"| *how much* | {' | '.join(sizes)} |")
    named = {name for tally in found.values() for spoke in tally.spoke.values() for name in spoke}
    for check in (*CHECKS, *sorted(named - set(CHECKS))):
        cells = [
            ", ".join(str(tally.spoke[patience][check]) for patience in PATIENCE)
            for tally in found.values()
        ]
        lines.append(f"| `{check}` | {' | '.join(cells)} |")
    ends = [str(tally.ended.total()) for tally in found.values()]
    lines.append(f"| *ended in the safe state* | {' | '.join(ends)} |")
    causes = [
        f"- {title}: {number} x {cause}"
        for title, tally in zip(titles, found.values(), strict=True)
        for cause, number in tally.ended.most_common()
    ]
    return "\n".join([*lines, "", *causes])


def main() -> int:
    """Run what was asked for and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=SETS, default=SETS)
    parser.add_argument("--detector", help="one of config/detectors (default: the profile's)")
    parser.add_argument("--trials", type=int, default=20, help="of each of the paper's twelve")
    parser.add_argument("--taps", type=int, default=1002)
    parser.add_argument("--confusers", type=Path, help="a built data set (default: made anew)")
    parser.add_argument("--share", type=float, default=1.0, help="of the confusers that are made")
    parser.add_argument("--recording", type=Path, help="a real one; left out without")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    found: dict[str, Tally] = {}
    for name in asked.only:
        if name == "recording" and asked.recording is None:
            continue
        found[name] = _of(name, asked)
        print(tables({name: found[name]}), end="\n\n", file=sys.stderr, flush=True)
    print(tables(found))
    return int(any(tally.spoke["1"] or tally.ended for tally in found.values()))


def _of(name: str, asked: argparse.Namespace) -> Tally:
    if name == "paper":
        return run_all(paper_trials("default", asked.detector, asked.trials), asked.jobs)
    if name == "each-motor":
        return run_all(paper_trials("paper", asked.detector, asked.trials), asked.jobs)
    if name == "taps":
        return run_all(taps(asked.detector, asked.taps), asked.jobs)
    if name == "confusers":
        return confusers(asked.confusers, asked.share, asked.jobs)
    return real(asked.recording)


if __name__ == "__main__":
    sys.exit(main())
