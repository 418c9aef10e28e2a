"""Recordings of a data set without one term of the compliant fingertip."""

from pathlib import Path

import msgspec
import pytest

from drivers.errors import BadFile
from grasp.settings import config_dir
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.datasets.draws import with_values
from scenarios.acquire.datasets.plan import load_dataset_config
from scenarios.studies.signal.terms import TERMS, jobs_without, origin_of

PAPER = load_dataset_config(config_dir() / "datasets" / "paper.toml")


@pytest.mark.parametrize("term", TERMS)
def test_a_term_is_left_out_by_settings_that_exist_and_that_the_set_draws(term: str) -> None:
    (whole,) = jobs_without(PAPER, {}, 1)
    (job,) = jobs_without(PAPER, TERMS[term], 1)
    plain = load_acquire_config(job.surface, "simulated")
    assert with_values(plain, job.metadata.parameters) != with_values(
        plain, whole.metadata.parameters
    )


def test_all_else_is_as_it_was() -> None:
    whole, without = jobs_without(PAPER, {}, 7), jobs_without(PAPER, TERMS["lever"], 7)
    assert len(whole) == len(without) == 7
    assert {job.metadata.part for job in whole} == {"compliant"}
    for a, b in zip(whole, without, strict=True):
        assert (a.path, a.metadata.seed, a.metadata.split) == (
            b.path, b.metadata.seed, b.metadata.split,
        )  # fmt: skip
        drawn = a.metadata.parameters | TERMS["lever"]
        assert b.metadata.parameters == drawn


def test_a_folder_tells_what_it_was_built_from_or_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_bytes(
        msgspec.json.encode({"digest": "x", "dataset": msgspec.to_builtins(PAPER)})
    )
    assert origin_of(tmp_path) == PAPER
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(BadFile, match="does not say"):
        origin_of(tmp_path)
    rigid = msgspec.structs.replace(PAPER, parts=PAPER.parts[:1])
    held = load_dataset_config(config_dir() / "datasets" / "grasped-slip.toml")
    for other in (rigid, held):
        (tmp_path / "dataset.json").write_bytes(msgspec.json.encode({"dataset": other}))
        with pytest.raises(BadFile, match="no strokes with a part compliant"):
            origin_of(tmp_path)
