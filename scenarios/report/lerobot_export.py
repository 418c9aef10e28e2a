"""Runs as a LeRobot dataset v3.0: Parquet tables and their metadata, one episode a run.

The folder is what `LeRobotDataset` reads; LeRobot itself is not needed. The extra `exports` is.
"""

import json
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from detector.scores.quantiles import quantile
from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGER_NAMES, PERIOD_S
from grasp.commands import MoveArm, StopArm
from grasp.files import make_private_folder, whole_folder
from scenarios.report.run_record import RunRecord, read_run

Floats = NDArray[np.float64]
Feature = dict[str, Any]  # dtype, shape and names, as in info.json

FINGERS = [f"finger_{name.lower()}" for name in FINGER_NAMES]
TACTILE = "observation.tactile."
STATE = [*(f"{finger}_counts" for finger in FINGERS), *(f"arm_{axis}_m" for axis in "xyz")]
EFFORT = [f"{finger}_n" for finger in FINGERS]
ACTION = [*(f"{finger}_target_counts" for finger in FINGERS), "finger_speed_mps", "grip_force_n",
          *(f"arm_velocity_{axis}_mps" for axis in "xyz")]  # fmt: skip
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FIRST_FILE = FILE.format(chunk_index=0, file_index=0)
ROBOT = "robotiq_3f_ur"


class Episode(NamedTuple):
    """A run. ``columns``: feature to values, (frames, width) or (frames,)."""

    task: str
    features: dict[str, Feature]
    columns: dict[str, NDArray[Any]]

    @property
    def frames(self) -> int:
        return len(self.columns["timestamp"])


def write_lerobot(runs: Sequence[Path], out: Path) -> None:
    """Write runs to a new folder, complete or not at all. Raises BadFile as ``read_run`` and for a
    run without a complete sample, UsageError for runs of unlike fingertips, OSError."""
    from pyarrow import Table

    episodes: list[Episode] = []
    tasks: dict[str, int] = {}
    for path in runs:
        run = read_run(path)
        task = f"{run.scenario} the {run.config.object.name}"
        tasks.setdefault(task, len(tasks))
        begin = sum(episode.frames for episode in episodes)
        episode = _episode(run, task, tasks[task], len(episodes), begin)
        if episodes and episode.features != episodes[0].features:
            taxels = f"not of {_taxels(episodes[0])} as in {runs[0]}"
            problem = f"{path}: its fingertips are of {_taxels(episode)} taxels, {taxels}"
            raise UsageError(problem, "export runs of unlike fingertips separately")
        episodes.append(episode)
    features = episodes[0].features
    rows = [_index_row(i, episode) for i, episode in enumerate(episodes)]
    every = {name: np.concatenate([e.columns[name] for e in episodes]) for name in features}
    info = {
        "codebase_version": "v3.0",
        "robot_type": ROBOT,
        "total_episodes": len(episodes),
        "total_frames": len(every["index"]),
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": round(1 / PERIOD_S),
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": f"data/{FILE}",
        "video_path": None,
        "features": features,
    }
    named = Table.from_pydict({"task_index": list(tasks.values()), "task": list(tasks)})
    named = named.replace_schema_metadata({"pandas": json.dumps(_indexed_by("task"))})
    with whole_folder(out) as folder:
        for name, content in {
            f"data/{FIRST_FILE}": _parquet([_table(episode) for episode in episodes]),
            f"meta/episodes/{FIRST_FILE}": _parquet([Table.from_pylist(rows)]),
            "meta/tasks.parquet": _parquet([named]),
            "meta/info.json": _json(info),
            "meta/stats.json": _json(_statistics(every)),
        }.items():
            make_private_folder((folder / name).parent)
            (folder / name).write_bytes(content)


def _episode(run: RunRecord, task: str, task_index: int, number: int, begin: int) -> Episode:
    """The run at the dataset's rate, from its first complete sample on. Where a sample is missing
    or incomplete, the one before it is repeated. ``begin``: frames of the episodes before."""
    vectors: dict[str, tuple[list[str], Floats]] = {
        "observation.state": (STATE, np.hstack([run.fingers_counts, run.arm_m])),
        "observation.effort": (EFFORT, run.estimated_n),
        "action": (ACTION, _actions(run)),
    }
    taxels = [f"taxel_{k}" for k in range(run.counts.shape[2])]
    for i, finger in enumerate(FINGERS):
        vectors[TACTILE + finger] = (taxels, run.counts[:, i])
    values = np.hstack([values for _, values in vectors.values()])
    complete = np.flatnonzero(~np.isnan(values).any(axis=1))
    if not len(complete):
        problem = "has no sample with rest counts and with positions of fingers and arm"
        raise BadFile(run.path, problem, "leave it out: it ended before the grasp")
    times = run.t_s[complete]
    at = np.rint((times - times[0]) / PERIOD_S).astype(int)
    frame = np.arange(at[-1] + 1)
    rows = complete[np.searchsorted(at, frame, side="right") - 1]
    scalars: dict[str, NDArray[Any]] = {
        "timestamp": (frame * PERIOD_S).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full_like(frame, number),
        "index": begin + frame,
        "task_index": np.full_like(frame, task_index),
        "next.done": frame == frame[-1],
        "next.success": (frame == frame[-1]) & bool(run.verdict and run.verdict.success),
    }
    columns = {name: values[rows].astype(np.float32) for name, (_, values) in vectors.items()}
    names: dict[str, list[str] | None] = {name: names for name, (names, _) in vectors.items()}
    columns |= scalars
    features = {
        name: {
            "dtype": str(values.dtype),
            "shape": list(values.shape[1:]) or [1],
            "names": names.get(name),
        }
        for name, values in columns.items()
    }
    return Episode(task, features, columns)


def _actions(run: RunRecord) -> Floats:
    """What hand and arm were last commanded at each step, (n, 8) as ``ACTION``. The arm's velocity
    points to its target, and is no faster than reaches the target within a period."""
    action = np.zeros((len(run.t_s), len(ACTION)))
    hand, velocity = action[:, :5], action[:, 5:]
    hand[:, :3] = run.fingers_counts[0]
    target_m, speed_mps = run.arm_m.copy(), np.zeros(len(run.t_s))
    for sent in run.commands:
        since = max(0, int(np.searchsorted(run.t_s, sent.decided_ns * 1e-9 + 1e-9, "right")) - 1)
        if sent.refused:
            continue
        match sent.admitted:
            case MoveArm(position_m, mps):
                target_m[since:], speed_mps[since:] = position_m, mps
            case StopArm():
                speed_mps[since:] = 0.0
        if (applied := sent.applied) is not None:
            hand[since:] = *applied.targets_counts, applied.speed_mps, applied.force_n
    away_m = target_m - run.arm_m
    distance_m = np.linalg.norm(away_m, axis=1)
    seconds = np.maximum(distance_m / np.maximum(speed_mps, 1e-9), PERIOD_S)
    velocity[:] = away_m / seconds[:, None]
    return action


def _table(episode: Episode) -> Any:
    """Arrow table of an episode: scalars, and lists of fixed length."""
    import pyarrow as pa

    columns = {}
    for name, values in episode.columns.items():
        flat = pa.array(values.ravel())
        width = values.shape[1] if values.ndim > 1 else 0
        columns[name] = pa.FixedSizeListArray.from_arrays(flat, width) if width else flat
    return pa.table(columns)


def _index_row(number: int, episode: Episode) -> dict[str, Any]:
    """The episode's row of meta/episodes: its place in the data, and its statistics."""
    begin = int(episode.columns["index"][0])
    return {
        "episode_index": number,
        "tasks": [episode.task],
        "length": episode.frames,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": begin,
        "dataset_to_index": begin + episode.frames,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        **{
            f"stats/{feature}/{name}": values
            for feature, found in _statistics(episode.columns).items()
            for name, values in found.items()
        },
    }


def _statistics(columns: dict[str, NDArray[Any]]) -> dict[str, dict[str, list[float]]]:
    """For each feature the least and largest value, mean and so on, of each of its numbers."""
    found = {}
    for name, column in columns.items():
        values = column.reshape(len(column), -1).astype(np.float64)
        ordered = np.sort(values, axis=0).T
        found[name] = {
            "min": values.min(axis=0).tolist(),
            "max": values.max(axis=0).tolist(),
            "mean": values.mean(axis=0).tolist(),
            "std": values.std(axis=0).tolist(),
            "count": [len(values)],
            **{
                f"q{round(100 * share):02d}": [quantile(line, share) for line in ordered]
                for share in QUANTILES
            },
        }
    return found


def _indexed_by(column: str) -> dict[str, Any]:
    """What pandas reads to make an integer table's text column its index."""
    texts = {"field_name": column, "name": column, "pandas_type": "unicode",
             "numpy_type": "object", "metadata": None}  # fmt: skip
    index = {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object",
             "metadata": {"encoding": "UTF-8"}}  # fmt: skip
    return {"index_columns": [column], "column_indexes": [index], "columns": [texts]}


def _taxels(episode: Episode) -> int:
    return int(episode.features[TACTILE + FINGERS[0]]["shape"][0])


def _parquet(tables: Sequence[Any]) -> bytes:
    """A file with a row group for each table."""
    from pyarrow.parquet import ParquetWriter

    content = BytesIO()
    with ParquetWriter(content, tables[0].schema) as writer:
        for table in tables:
            writer.write_table(table)
    return content.getvalue()


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, indent=4).encode() + b"\n"
