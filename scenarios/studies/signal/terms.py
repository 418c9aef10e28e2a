"""The terms of the compliant fingertip one by one, and recordings of a data set without one."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from detector.recordings import Recording
from drivers.errors import BadFile
from scenarios.acquire.datasets.build import INDEX, make
from scenarios.acquire.datasets.plan import DatasetConfig, Job, plan
from scenarios.studies.signal.calibrate import OF_THE_PAD

COMPLIANT = "compliant"  # part of the paper's set that has them
# What leaves a term out; where that is no 0 or 1, the middle of the rigid part's range.
TERMS: dict[str, dict[str, float]] = {
    **OF_THE_PAD,
    "slow force loop": {"control.stroking_share": 1.0},
    "sharper fast and slower slow wander": {
        "fingertip.wander_fast_s": 0.0323, "fingertip.wander_slow_s": 0.212,
    },
    "strokes with a tail": {"control.braking_share": 1.0},
    "quick start of a stroke": {"control.acceleration_mps2": 0.2, "control.turn_radps2": 3.5},
    "load while zeroing": {"control.residual_n": 0.0},
    "slope of the surface": {"press.slope_x": 0.0, "press.slope_y": 0.0},
    "contact off the turning axis": {"press.axis_x_m": 0.0, "press.axis_y_m": 0.0},
    "the arm's mode": {"fingertip.vibration_mm": 0.0, "fingertip.sway_mm": 0.0},
    "lean of the finger": {"fingertip.tilt_x_rad": 0.0, "fingertip.tilt_y_rad": 0.0},
    "length of the texture": {"surface.texture_length_m": 0.0015},
}  # fmt: skip


def origin_of(folder: Path) -> DatasetConfig:
    """What a data set was built from. Raises BadFile for a folder that does not tell, or has no
    strokes with such a part."""
    path = folder / INDEX
    try:
        told = msgspec.json.decode(path.read_bytes())["dataset"]
        named = {key: value for key, value in told.items() if value != ""}  # no layout: the kit's
        config = msgspec.convert(named, DatasetConfig)
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        raise BadFile(path, "does not say what the set was built from", "build it anew") from None
    if not config.rows or COMPLIANT not in {part.name for part in config.parts}:
        problem = f"has no strokes with a part {COMPLIANT}"
        raise BadFile(path, problem, "give config/datasets/paper.toml, built")
    return config


def jobs_without(config: DatasetConfig, changes: Mapping[str, float], most: int) -> list[Job]:
    """At most so many recordings of the compliant part, spread over it, with these settings instead
    of what they drew; all else as it was, seeds included."""
    jobs = [job for job in plan(config) if job.metadata.part == COMPLIANT]
    chosen = jobs if len(jobs) <= most else [jobs[i * len(jobs) // most] for i in range(most)]
    return [_changed(job, changes) for job in chosen]


def _changed(job: Job, changes: Mapping[str, float]) -> Job:
    metadata = job.metadata
    parameters = metadata.parameters | dict(changes)
    return msgspec.structs.replace(
        job, metadata=msgspec.structs.replace(metadata, parameters=parameters)
    )


def made(jobs: Sequence[Job]) -> Iterator[Recording]:
    """The recordings of these jobs, in their order."""
    return map(make, jobs)
