"""A LeRobot data set of two lifts, read with Parquet and JSON alone."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import BadFile, UsageError
from grasp.run.messages import ControlMessage, TactileMessage
from scenarios.report.lerobot_export import ACTION, write_lerobot
from scenarios.report.run_record import read_run
from tests.unit.scenarios.report.conftest import changed

ARROW = {"float32": "float", "int64": "int64", "bool": "bool"}
STATISTICS = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


class DataSet:
    """A reader of the layout: what a program finds that knows the format only."""

    def __init__(self, folder: Path) -> None:
        from pyarrow.parquet import read_table

        self.info = json.loads((folder / "meta/info.json").read_text())
        self.stats = json.loads((folder / "meta/stats.json").read_text())
        self.tasks = read_table(folder / "meta/tasks.parquet")
        first = {"chunk_index": 0, "file_index": 0}
        self.episodes = read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
        self.data = read_table(folder / self.info["data_path"].format(**first))

    def column(self, name: str, episode: int) -> Any:
        row = self.episodes[episode]
        begin, end = row["dataset_from_index"], row["dataset_to_index"]
        return np.array(self.data[name].to_pylist()[begin:end])


@pytest.fixture(scope="module")
def data(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    out = tmp_path_factory.mktemp("lerobot") / "cans"
    write_lerobot(runs, out)
    assert os.listdir(out.parent) == ["cans"] and out.stat().st_mode & 0o777 == 0o700
    return DataSet(out)


def test_schema_and_indices_are_those_of_version_3(data: DataSet, runs: list[Path]) -> None:
    info, rows = data.info, data.data.num_rows
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 100)
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, rows, 1)
    assert info["splits"] == {"train": "0:2"} and info["video_path"] is None
    assert set(data.data.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        kind, (width,) = ARROW[feature["dtype"]], feature["shape"]
        named = f"fixed_size_list<element: {kind}>[{width}]" if feature["names"] else kind
        assert str(data.data.schema.field(name).type) == named, name
        assert len(feature["names"] or [""]) == width, name
        assert set(data.stats[name]) == STATISTICS, name
    pandas = json.loads(data.tasks.schema.metadata[b"pandas"])
    assert pandas["index_columns"] == ["task"]
    assert data.tasks.to_pylist() == [{"task_index": 0, "task": "lift the can"}]

    begin = 0
    for number, row in enumerate(data.episodes):
        frames = np.arange(row["length"])
        verdict = read_run(runs[number]).verdict
        assert verdict is not None and verdict.success is True
        assert row["tasks"] == ["lift the can"] and row["dataset_from_index"] == begin
        for name, expected in {
            "frame_index": frames, "timestamp": (frames / 100).astype(np.float32),
            "index": begin + frames, "episode_index": 0 * frames + number,
            "task_index": 0 * frames, "next.done": frames == frames[-1],
            "next.success": frames == frames[-1],
        }.items():  # fmt: skip
            np.testing.assert_array_equal(data.column(name, number), expected, name)
        begin = row["dataset_to_index"]
    assert begin == rows


def test_statistics_are_those_of_the_frames(data: DataSet) -> None:
    for number, row in enumerate(data.episodes):
        state = data.column("observation.state", number)
        for name, values in {
            "min": state.min(0),
            "mean": state.mean(0),
            "std": state.std(0),
        }.items():
            found = row[f"stats/observation.state/{name}"]
            np.testing.assert_allclose(found, values, rtol=1e-4, atol=1e-6)
    every = np.array(data.data["observation.effort"].to_pylist())
    found = data.stats["observation.effort"]
    np.testing.assert_allclose(found["max"], every.max(0), rtol=1e-6)
    np.testing.assert_allclose(found["q90"], np.sort(every, 0)[int(0.9 * len(every))], atol=0.05)
    assert found["count"] == [len(every)]


def test_frames_hold_what_was_recorded(data: DataSet, runs: list[Path]) -> None:
    run = read_run(runs[0])
    known = ~np.isnan(run.counts[:, 0, 0])  # the episode begins with rest counts
    state, action = data.column("observation.state", 0), data.column("action", 0)
    assert len(state) == known.sum()
    np.testing.assert_allclose(state[:, :3], run.fingers_counts[known])
    np.testing.assert_allclose(state[:, 3:], run.arm_m[known], atol=1e-6)
    np.testing.assert_allclose(
        data.column("observation.effort", 0), run.estimated_n[known], rtol=1e-5, atol=1e-6
    )
    for i, finger in enumerate("abc"):
        found = data.column(f"observation.tactile.finger_{finger}", 0)
        np.testing.assert_array_equal(found, run.counts[known, i])
    # each command holds from its step until the next one
    sent = [each.message for each in run.commands]
    hand = [each for each in sent if each.applied is not None]
    for one, until in zip(hand, [*hand[1:], None], strict=True):
        end_ns = until.decided_ns if until else np.inf
        at = (run.t_s[known] * 1e9 > one.decided_ns - 1) & (run.t_s[known] * 1e9 < end_ns - 1)
        assert one.applied is not None
        expected = [*one.applied.targets_counts, one.applied.speed_mps, one.applied.force_n]
        np.testing.assert_allclose(action[at][:, :5] - expected, 0, atol=1e-6)
    upward = action[:, ACTION.index("arm_velocity_z_mps")]
    moved = np.diff(state[:, 5]) * 100
    assert upward.max() == pytest.approx(0.1) and upward.min() == pytest.approx(-0.05)
    assert np.corrcoef(moved, upward[:-1])[0, 1] > 0.9  # it accelerates and brakes


def test_a_missing_sample_repeats_the_one_before(runs: list[Path], tmp_path: Path) -> None:
    last = read_run(runs[0]).t_s[-1]

    def without(message: tuple[str, int, Any]) -> tuple[str, int, Any] | None:
        missing = round((last - 3.0) * 1e9) <= message[1] < round((last - 2.9) * 1e9)
        return None if missing and isinstance(message[2], ControlMessage) else message

    write_lerobot([changed(runs[0], tmp_path / "gap", without)], tmp_path / "out")
    data = DataSet(tmp_path / "out")
    frames = data.column("frame_index", 0)
    np.testing.assert_array_equal(frames, np.arange(len(frames)))
    z_m = data.column("observation.state", 0)[:, 5]
    still = np.flatnonzero(frames == frames[-1] - 300)[0]  # of 10 missing samples
    assert len(set(z_m[still - 1 : still + 10])) == 1 and len(set(z_m[still + 10 : still + 20])) > 5


def test_unlike_fingertips_and_a_run_without_samples_are_refused(
    runs: list[Path], tmp_path: Path
) -> None:
    def fewer(message: tuple[str, int, Any]) -> tuple[str, int, Any]:
        topic, t_ns, found = message
        if isinstance(found, TactileMessage):
            cut = {name: getattr(found, name)[:12] for name in ("counts", "raw", "temperature")}
            found = TactileMessage(found.seq, found.sampled_ns, **cut, missed=0, stale=False)
        return topic, t_ns, found

    small = changed(runs[0], tmp_path / "small", fewer)
    with pytest.raises(UsageError, match="fingertips have other taxels than those of"):
        write_lerobot([runs[1], small], tmp_path / "out")
    blind = changed(runs[0], tmp_path / "blind", lambda m: m if m[0] != "/tactile" else None)
    with pytest.raises(BadFile, match="has no sample with rest counts"):
        write_lerobot([runs[1], blind], tmp_path / "out")
    assert not (tmp_path / "out").exists()
