"""Data sets with the user's surfaces and layouts, given by the paths of their files."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from detector.recordings import read_dataset
from grasp.settings import config_dir
from scenarios.acquire.datasets import build as datasets
from scenarios.acquire.datasets.plan import DatasetConfig, Job, load_dataset_config, plan
from scenarios.rigs.workers import Workers

Copy = Callable[..., Path]
STROKES = """name = "mine"
seed = 9
static_samples = 300
slip_samples = 300
recording_samples = 200
least_recordings = 3
[randomise]
"surface.friction_kinetic" = [0.55, 1.0]
"surface.texture_rms_m" = [0.00005, 0.0004]
"surface.texture_length_m" = [0.001, 0.002]
[[rows]]
motion = "primary"
speed = 0.05
percent = {{ {} }}
"""


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    """Writes a copy of a packaged settings file under another name."""
    folder = tmp_path / "things"
    folder.mkdir()

    def write(kind: str, like: str, name: str, file: str = "") -> Path:
        text = (config_dir() / kind / f"{like}.toml").read_text()
        path = folder / f"{file or name}.toml"
        path.write_text(text.replace(f'name = "{like}"', f'name = "{name}"'))
        return path

    return write


def data_set(folder: Path, percent: str, more: str = "") -> Path:
    path = folder / "set.toml"
    path.write_text(more + STROKES.format(percent))
    return path


def made(jobs: list[Job], out: Path) -> int:
    return datasets.build(jobs, {}, out, Workers(0), lambda done, total: None)


def test_strokes_on_a_user_surface_with_a_user_layout(copy: Copy, tmp_path: Path) -> None:
    copy("surfaces", "sphere", "dome")
    copy("layouts", "eight", "two-rows")
    words = '"things/dome.toml" = 1.0, planar = 1.0'
    path = data_set(tmp_path, words, 'layout = "things/two-rows.toml"\n')
    config = load_dataset_config(path)
    jobs = plan(config)
    assert {job.path.split("/")[0] for job in jobs} == {"dome", "planar"}
    assert msgspec.json.decode(msgspec.json.encode(config), type=DatasetConfig) == config
    made([jobs[0], jobs[-1]], tmp_path / "out")
    first, last = sorted(read_dataset(tmp_path / "out"), key=lambda r: r.source)
    assert first.taxels == last.taxels == 8
    assert first.metadata is not None and last.metadata is not None
    assert (first.metadata.surface, last.metadata.surface) == ("dome", "planar")
    assert {Path(file).name for file in first.metadata.files} == {"dome.toml", "two-rows.toml"}
    assert {Path(file).name for file in last.metadata.files} == {"two-rows.toml"}
