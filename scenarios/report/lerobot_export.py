"""Runs as a LeRobot dataset v3.0: Parquet tables and their metadata, one episode a run.

`LeRobotDataset` reads the folder. Writing it needs the extra `exports`, and nothing of LeRobot.
"""

import json
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from detector.scores.quantiles import quantile
from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGER_NAMES, PERIOD_S
from grasp.control.commands import MoveArm, StopArm
from grasp.files import make_private_folder, whole_folder
from scenarios.report.run_record import RunRecord, read_run

Floats = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]  # feature to its values, (frames, width) or (frames,)

FINGERS = [f"finger_{name.lower()}" for name in FINGER_NAMES]
TACTILE = "observation.tactile."
ACTION = [*(f"{finger}_target_counts" for finger in FINGERS), "finger_speed_mps", "grip_force_n",
          *(f"arm_velocity_{axis}_mps" for axis in "xyz")]  # fmt: skip
NAMES = {
    "observation.state": [*(f"{finger}_counts" for finger in FINGERS), "x_m", "y_m", "z_m"],
    "observation.effort": [f"{finger}_n" for finger in FINGERS],
    "action": ACTION,
}
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
FIRST_FILE = FILE.format(chunk_index=0, file_index=0)
PLACES = {f"{where}/{what}_index": 0 for where in ("data", "meta/episodes")
          for what in ("chunk", "file")}  # fmt: skip
# by which pandas makes the column `task` the index of a table
INDEX = {"field_name": "task", "name": "task", "pandas_type": "unicode", "numpy_type": "object",
         "metadata": None}  # fmt: skip
PANDAS = {"index_columns": ["task"], "column_indexes": [], "columns": [INDEX]}


def write_lerobot(runs: Sequence[Path], out: Path) -> None:
    """Write runs to a new folder, complete or not at all. Raises BadFile as ``read_run`` and for a
    run without a complete sample, UsageError for runs of unlike fingertips, OSError."""
    from pyarrow import Table

    episodes: list[Columns] = []
    rows: list[dict[str, Any]] = []  # of meta/episodes
    tasks: list[str] = []
    begin = 0
    for path in runs:
        run = read_run(path)
        task = f"{run.scenario} the {run.config.object.name}"
        if task not in tasks:
            tasks.append(task)
        columns = _columns(run)
        frame = columns["frame_index"]
        columns["index"] = begin + frame
        columns["episode_index"] = np.full_like(frame, len(episodes))
        columns["task_index"] = np.full_like(frame, tasks.index(task))
        episodes.append(columns)
        if _features(columns) != _features(episodes[0]):
            problem = f"{path}: its fingertips have other taxels than those of {runs[0]}"
            raise UsageError(problem, "export runs of unlike fingertips separately")
        end = begin + len(frame)
        rows.append({
            "episode_index": len(rows), "tasks": [task], "length": len(frame),
            "dataset_from_index": begin, "dataset_to_index": end, **PLACES,
            **{f"stats/{feature}/{name}": values for feature, found in _statistics(columns).items()
               for name, values in found.items()},
        })  # fmt: skip
        begin = end
    every = {name: np.concatenate([e[name] for e in episodes]) for name in episodes[0]}
    info = {
        "codebase_version": "v3.0", "robot_type": "robotiq_3f_ur", "fps": round(1 / PERIOD_S),
        "total_episodes": len(episodes), "total_frames": begin, "total_tasks": len(tasks),
        "chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200,
        "splits": {"train": f"0:{len(episodes)}"}, "data_path": f"data/{FILE}", "video_path": None,
        "features": _features(every),
    }  # fmt: skip
    named = Table.from_pydict({"task_index": list(range(len(tasks))), "task": tasks})
    named = named.replace_schema_metadata({"pandas": json.dumps(PANDAS)})
    with whole_folder(out) as folder:
        for name, content in {
            f"data/{FIRST_FILE}": _parquet([_table(columns) for columns in episodes]),
            f"meta/episodes/{FIRST_FILE}": _parquet([Table.from_pylist(rows)]),
            "meta/tasks.parquet": _parquet([named]),
            "meta/info.json": json.dumps(info, indent=4).encode(),
            "meta/stats.json": json.dumps(_statistics(every), indent=4).encode(),
        }.items():
            make_private_folder((folder / name).parent)
            (folder / name).write_bytes(content)


def _columns(run: RunRecord) -> Columns:
    """The run at the data set's rate, from its first complete sample on. Where a sample is missing
    or incomplete, the one before it is repeated."""
    vectors = {
        "observation.state": np.hstack([run.fingers_counts, run.arm_m]),
        "observation.effort": run.estimated_n,
        **{TACTILE + finger: run.counts[:, i] for i, finger in enumerate(FINGERS)},
        "action": _actions(run),
    }
    complete = np.flatnonzero(~np.isnan(np.hstack(list(vectors.values()))).any(axis=1))
    if not len(complete):
        problem = "has no sample with rest counts and with positions of fingers and arm"
        raise BadFile(run.path, problem, "leave it out: it ended before the grasp")
    times = run.t_s[complete]
    at = np.rint((times - times[0]) / PERIOD_S).astype(int)
    frame = np.arange(at[-1] + 1)
    rows = complete[np.searchsorted(at, frame, side="right") - 1]
    return {
        **{name: values[rows].astype(np.float32) for name, values in vectors.items()},
        "timestamp": (frame * PERIOD_S).astype(np.float32),
        "frame_index": frame,
        "next.done": frame == frame[-1],
        "next.success": (frame == frame[-1]) & bool(run.verdict and run.verdict.success),
    }


def _actions(run: RunRecord) -> Floats:
    """What hand and arm were last commanded at each step, (n, 8) as ``ACTION``. The arm's velocity
    points to its target, and is no faster than reaches the target within a period."""
    action = np.zeros((len(run.t_s), len(ACTION)))
    hand, velocity = action[:, :5], action[:, 5:]
    hand[:, :3] = run.fingers_counts[0]
    target_m, speed_mps = run.arm_m.copy(), np.zeros(len(run.t_s))
    for sent in (each.message for each in run.commands):
        if sent.refused:
            continue
        since = max(0, int(np.searchsorted(run.t_s, sent.decided_ns * 1e-9 + 1e-9, "right")) - 1)
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


def _features(columns: Columns) -> dict[str, dict[str, Any]]:
    """Type, shape and names of each feature, as in info.json."""
    found = {}
    for name, values in columns.items():
        shape = list(values.shape[1:]) or [1]
        taxels = [f"taxel_{k}" for k in range(shape[0])] if name.startswith(TACTILE) else None
        found[name] = {"dtype": str(values.dtype), "shape": shape, "names": NAMES.get(name, taxels)}
    return found


def _statistics(columns: Columns) -> dict[str, dict[str, list[float]]]:
    """For each feature the least and largest value, mean and so on, of each of its numbers."""
    found = {}
    for name, column in columns.items():
        values = column.reshape(len(column), -1).astype(np.float64)
        ordered = np.sort(values, axis=0).T
        found[name] = {
            **{key: getattr(values, key)(axis=0).tolist() for key in ("min", "max", "mean", "std")},
            "count": [len(values)],
            **{
                f"q{round(100 * share):02d}": [quantile(line, share) for line in ordered]
                for share in QUANTILES
            },
        }
    return found


def _table(columns: Columns) -> Any:
    """Arrow table of an episode: scalars, and lists of fixed length."""
    import pyarrow as pa

    arrays = {}
    for name, values in columns.items():
        flat = pa.array(values.ravel())
        lists = values.ndim > 1
        arrays[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1]) if lists else flat
    return pa.table(arrays)


def _parquet(tables: Sequence[Any]) -> bytes:
    """A file with a row group for each table."""
    from pyarrow.parquet import ParquetWriter

    content = BytesIO()
    with ParquetWriter(content, tables[0].schema) as writer:
        for table in tables:
            writer.write_table(table)
    return content.getvalue()
