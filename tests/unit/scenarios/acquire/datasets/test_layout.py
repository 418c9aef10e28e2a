"""Fingertips of eight taxels: data sets, lifts, and refused detectors of six taxels."""

from pathlib import Path

import msgspec
import pytest

from detector.loading import load_detector
from detector.recordings import read_dataset
from drivers.errors import UsageError
from grasp.settings import config_dir
from scenarios.acquire.config import layout_file
from scenarios.acquire.datasets import build as datasets
from scenarios.acquire.datasets.plan import load_dataset_config, plan
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs.workers import Workers
from tests.unit.scenarios.conftest import EAGER, QUIET

EIGHT = layout_file("eight")
PAPER = config_dir() / "datasets" / "paper.toml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three recordings of strokes, and one of a grasp."""
    paper, grasps = (
        plan(msgspec.structs.replace(load_dataset_config(path), layout="eight"))
        for path in (PAPER, PAPER.with_name("grasped-slip.toml"))
    )
    short = [msgspec.structs.replace(job, static=150, slip=120) for job in (paper[0], paper[40])]
    chosen = [*short, grasps[0]]
    out = tmp_path_factory.mktemp("eight") / "set"
    datasets.build(chosen, {}, out, Workers(0), lambda done, total: None)
    return out


def test_a_data_set_has_recordings_of_the_layout_that_it_names(folder: Path) -> None:
    made = read_dataset(folder)
    assert [r.taxels for r in made] == [8, 8, 8]
    assert {r.metadata.layout for r in made if r.metadata} == {"eight"}
    for r in made:
        assert (r.counts.std(axis=0) > 0.1).all()  # every taxel has its own noise


def test_detector_of_another_layout_is_refused(folder: Path) -> None:
    made = read_dataset(folder)
    for name in ("gru", "tcn-paper", "psd"):
        with pytest.raises(UsageError, match=f"'{name}' was made for fingertips of 6 taxels"):
            load_detector(name, {}, 3, made[0].taxels)
    with pytest.raises(UsageError, match="not of 8"):
        load_config("can", "simulated", "gru", EIGHT).make_detector(3)


def test_an_object_is_lifted_with_eight_taxels_a_finger() -> None:
    config = load_config("can", "simulated", "energy", EIGHT, [QUIET, EAGER]).for_lift()
    result = lift.run(config, 0, None).result
    assert result is not None
    assert result.outcome == "held_within_6cm"
