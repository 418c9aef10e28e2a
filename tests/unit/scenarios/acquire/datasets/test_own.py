"""A data set names surfaces, bodies and layouts of one's own by the paths of their files."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from detector.recordings import read_dataset
from drivers.errors import ConfigError
from grasp.cli.main import main
from grasp.settings import config_dir
from scenarios.acquire.datasets import build as datasets
from scenarios.acquire.datasets.plan import DatasetConfig, Job, load_dataset_config, plan
from scenarios.rigs.workers import Workers

Own = Callable[..., Path]
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
def own(tmp_path: Path) -> Own:
    """Writes a packaged thing under another name, in a folder of its own."""
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


def test_strokes_on_a_surface_and_with_a_layout_of_ones_own(own: Own, tmp_path: Path) -> None:
    own("surfaces", "sphere", "dome")
    own("layouts", "eight", "two-rows")
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


def test_a_surface_of_ones_own_is_what_is_pressed(own: Own, tmp_path: Path) -> None:
    """All else is drawn alike, so its curvature is heard."""
    file = own("surfaces", "sphere", "dome")
    sphere, dome = (
        plan(load_dataset_config(data_set(tmp_path, f'"{word}" = 1.0')))[0]
        for word in ("sphere", file)
    )
    alike = (msgspec.structs.replace(j, static=60, slip=60) for j in (sphere, dome))
    same = [datasets.make(job).counts for job in alike]
    assert np.array_equal(*same)
    text = file.read_text()
    file.write_text(text.replace("radius_x_m = ", "radius_x_m = 0.02 # ", 1))
    assert file.read_text() != text
    datasets.pressing.cache_clear()
    other = plan(load_dataset_config(data_set(tmp_path, f'"{file}" = 1.0')))[0]
    assert other.metadata.files != dome.metadata.files
    counts = datasets.make(msgspec.structs.replace(other, static=60, slip=60)).counts
    assert not np.array_equal(counts, same[0])


def test_ranges_of_one_surface_are_said_by_its_path(own: Own, tmp_path: Path) -> None:
    own("surfaces", "sphere", "dome")
    path = data_set(tmp_path, '"things/dome.toml" = 1.0, sphere = 1.0')
    with path.open("a") as file:
        file.write('[on."things/dome.toml"]\n"surface.radius_x_m" = [0.02, 0.03]\n'
                   '[[causes]]\ncause = "steady"\non = ["things/dome.toml", "sphere"]\n'
                   'share = 1.0\nseconds = 2.0\n')  # fmt: skip
    jobs = [job for job in plan(load_dataset_config(path)) if job.metadata.cause]
    told = {job.metadata.surface: job.metadata.parameters for job in jobs}
    assert 0.02 <= told["dome"]["surface.radius_x_m"] <= 0.03
    assert "surface.radius_x_m" not in told["sphere"]


def test_what_is_held_is_drawn_from_a_file_of_ones_own(own: Own, tmp_path: Path) -> None:
    own("bodies", "straight", "pipe")
    path = tmp_path / "set.toml"
    path.write_text('name = "mine"\nseed = 9\n[[causes]]\ncause = "grasped_slip"\nshare = 1.0\n'
                    'on = ["things/pipe.toml"]\nseconds = 3.0\nload = [0.9, 0.95]\n')  # fmt: skip
    jobs = plan(load_dataset_config(path))
    assert {job.metadata.object["name"] for job in jobs} == {"pipe"}
    assert {job.path for job in jobs} == {f"grasped_slip/{k:03d}-pipe.npz" for k in range(3)}
    (recording,) = [datasets.make(jobs[0])]
    assert recording.slip.any()


@pytest.mark.parametrize(
    ("percent", "told"),
    [
        ('"things/none.toml" = 1.0', "no such file"),
        ('"things/planar.toml" = 1.0', "as one of config/surfaces is called"),
        ('"things/dome.toml" = 1.0, "things/again.toml" = 1.0', "is 'dome', as that of"),
        ('"things/two-rows.toml" = 1.0', r"is not of the surface"),
        ("dome = 1.0", "unknown"),
        ('"../planar" = 1.0', "unknown"),
    ],
)
def test_what_is_no_surface_or_is_called_as_another_is_refused(
    percent: str, told: str, own: Own, tmp_path: Path
) -> None:
    own("surfaces", "sphere", "dome")
    own("surfaces", "sphere", "dome", file="again")
    own("surfaces", "planar", "planar")
    own("layouts", "eight", "two-rows")
    with pytest.raises(ConfigError, match=told):
        load_dataset_config(data_set(tmp_path, percent))


@pytest.mark.parametrize(
    ("layout", "told"),
    [
        ("../eight", "no such file"),
        ("nine", "unknown"),
        ("none.toml", "no such file"),
        ("x.toml", "--rig"),
    ],
)
def test_what_is_no_layout_is_refused(layout: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text('rig = "hardware"\n')
    with pytest.raises(ConfigError) as caught:
        load_dataset_config(data_set(tmp_path, "planar = 1.0", f'layout = "{layout}"\n'))
    assert told in f"{caught.value.message} {caught.value.remedy}"


def test_a_file_that_was_changed_is_another_data_set(
    own: Own, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = own("surfaces", "sphere", "dome")
    path = data_set(tmp_path, '"things/dome.toml" = 1.0')
    jobs = plan(load_dataset_config(path))
    assert made(jobs[:1], tmp_path / "out") == 1
    file.write_text(file.read_text() + "# another word\n")
    words = ["dataset", "build", str(path), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert main(words) == 2
    assert "other settings" in capsys.readouterr().err


def test_a_data_set_is_checked_without_being_made(
    own: Own, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = own("surfaces", "sphere", "dome")
    path = data_set(tmp_path, '"things/dome.toml" = 1.0')
    assert main(["config", "check", str(path)]) == 0
    assert "a data set of 3 recordings" in capsys.readouterr().out
    file.with_name("dish.toml").write_text('[surface]\nname = "dish"\nradius_x_m = -1.0\n')
    other = data_set(tmp_path, '"things/dish.toml" = 1.0')
    assert main(["config", "check", str(other)]) == 2
    assert "radius_x_m" in capsys.readouterr().err
