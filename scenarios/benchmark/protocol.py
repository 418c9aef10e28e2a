"""The benchmark's protocol: its splits, seeds, recordings and lifts, from config/benchmark."""

import hashlib
from typing import Any, Literal

import msgspec

from drivers.errors import ConfigError
from grasp.settings import config_dir, file_of, load, read_toml
from scenarios.acquire.datasets.plan import DatasetConfig, Job, load_dataset_config, plan, reduced
from scenarios.acquire.datasets.random_objects import Range

SplitName = Literal["validation", "test"]
PER_SET = 1000  # a data set's seed is a thousand times smaller than those of lifts


class SplitSeeds(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Seeds of a split: the first, and a digest of them all with their settings."""

    first: int
    digest: str


class LiftRanges(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Number and ranges of the lifts; see config/benchmark/protocol.toml."""

    number: int
    shapes: tuple[str, ...]
    weak: Range
    sufficient: Range
    holdable: float
    crush: float
    crush_n: float
    hands: str
    latency_s: Range
    debounce_s: Range
    tip_mass_kg: Range


class Protocol(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A version of the benchmark."""

    version: int
    splits: dict[SplitName, SplitSeeds]
    recordings: dict[str, float]  # share of each packaged data set
    lifts: LiftRanges

    def dataset(self, name: str, split: SplitName, layout: str = "") -> DatasetConfig:
        """Settings of a set of the split's recordings."""
        config = load_dataset_config(file_of("datasets", name))
        seed = self.splits[split].first // PER_SET + list(self.recordings).index(name)
        config = msgspec.structs.replace(config, seed=seed, layout=layout or config.layout)
        return reduced(config, self.recordings[name])

    def jobs(self, name: str, split: SplitName, layout: str = "") -> list[Job]:
        """Recordings of that set, whatever split of the packaged set they belong to. They do not
        name the program's commit: the protocol's version stands for what they contain."""
        replace = msgspec.structs.replace
        return [
            replace(job, metadata=replace(job.metadata, commit=""))
            for job in plan(self.dataset(name, split, layout))
        ]

    def lift_seeds(self, split: SplitName) -> range:
        first = self.splits[split].first
        return range(first, first + self.lifts.number)

    def digest(self, split: SplitName) -> str:
        """Digest of all seeds and settings of the split."""
        every: list[Any] = [self.version, self.lifts, list(self.lift_seeds(split))]
        for name in self.recordings:
            seeds = [job.metadata.seed for job in self.jobs(name, split)]
            every += [seeds, self.dataset(name, split)]
        return hashlib.sha256(msgspec.json.encode(every)).hexdigest()[:16]


def load_protocol() -> Protocol:
    """The packaged protocol. Raises ConfigError."""
    return load(Protocol, [read_toml(config_dir() / "benchmark" / "protocol.toml")])


def check_digest(protocol: Protocol, split: SplitName) -> None:
    """Raise ConfigError where the split is not the one that its version stands for."""
    if (found := protocol.digest(split)) != protocol.splits[split].digest:
        raise ConfigError(
            "config/benchmark/protocol.toml", f"splits.{split}.digest",
            f"the seeds or settings have changed: their digest is {found}",
            "undo the change, or raise the version and state that digest",
        )  # fmt: skip
