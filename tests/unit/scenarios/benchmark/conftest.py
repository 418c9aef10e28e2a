"""A small benchmark: few recordings and lifts of the split `validation`, for tests."""

from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from scenarios.acquire.datasets.build import build
from scenarios.benchmark import lifts, run
from scenarios.benchmark.protocol import Protocol, SplitSeeds, load_protocol
from scenarios.benchmark.run import Benchmark
from scenarios.benchmark.score_file import References
from scenarios.campaign.config import load_config
from scenarios.lift.config import LiftConfig
from scenarios.rigs.workers import Workers

HERE = Workers(0)
# every so manieth recording of a set
STEP = {"paper": 60, "sliding": 40, "disturbances": 60, "mallet": 80}
Recordings = dict[str, list[Path]]
Plugin = Callable[..., LiftConfig]  # settings of a detector with these lines as `update`


def nothing_shown(*_: object) -> None:
    """Progress that is not shown."""


def small_protocol(number: int) -> Protocol:
    protocol = load_protocol()
    ranges = msgspec.structs.replace(protocol.lifts, number=number)
    protocol = msgspec.structs.replace(protocol, lifts=ranges)
    splits = {n: SplitSeeds(s.first, protocol.digest(n)) for n, s in protocol.splits.items()}
    return msgspec.structs.replace(protocol, splits=splits)


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Recordings:
    protocol, folder = load_protocol(), tmp_path_factory.mktemp("recordings")
    found = {}
    for name, step in STEP.items():
        jobs = protocol.jobs(name, "validation")[::step]
        build(jobs, protocol.dataset(name, "validation"), folder / name, HERE, nothing_shown)
        found[name] = [folder / name / job.path for job in jobs]
    return found


@pytest.fixture(scope="module")
def small() -> Iterator[Protocol]:
    """The protocol with 8 lifts, no other thresholds, and two delays of the oracle."""
    protocol = small_protocol(8)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(lifts, "load_protocol", lambda: protocol)
        patched.setattr(run, "EXCEEDED", ())
        patched.setattr(run, "ORACLE_S", (0.0, 0.2))
        yield protocol


@pytest.fixture
def benchmark(small: Protocol, recordings: Recordings) -> Benchmark:
    return Benchmark(small, "validation", recordings, {}, HERE, nothing_shown)


@pytest.fixture
def references(benchmark: Benchmark, tmp_path: Path) -> References:
    return benchmark.references(settings("energy"), tmp_path / "references.json")


def settings(name: str, *assignments: str) -> LiftConfig:
    return load_config("can", "simulated", name, None, assignments).for_lift()


@pytest.fixture
def plugin(tmp_path: Path) -> Plugin:
    def made(*update: str) -> LiftConfig:
        body = "\n".join(f"        {line}" for line in update)
        path = tmp_path / "mine.py"
        path.write_text(
            "import sys\n\nimport numpy as np\n\n\nclass Mine:\n    def __init__(self, fingers):\n"
            "        self.fingers = fingers\n        self.reset()\n\n    def reset(self):\n"
            f"        self.past = []\n\n    def update(self, counts):\n{body}\n"
        )
        return settings(f"{path}:Mine")

    return made
