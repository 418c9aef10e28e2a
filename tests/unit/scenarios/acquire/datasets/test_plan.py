"""Plans of data sets: separate seeds and textures of splits, and refused settings."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from grasp.settings import config_dir
from scenarios.acquire.datasets.causes import GRASPED, lift_config
from scenarios.acquire.datasets.plan import (
    SEEDS,
    Job,
    load_dataset_config,
    plan,
    press_config,
    reduced,
)
from scenarios.rigs.simulated import any_cell
from scenarios.world import fingertip
from scenarios.world.settings import Surface

SETS = ("paper", "disturbances", "grasped-slip", "mallet", "turning")


@cache
def jobs_of(name: str, share: float = 1.0) -> list[Job]:
    return plan(reduced(load_dataset_config(config_dir() / "datasets" / f"{name}.toml"), share))


def of_split(jobs: list[Job], split: str) -> list[Job]:
    return [job for job in jobs if job.metadata.split == split]


@pytest.mark.parametrize("name", ["paper", "mallet"])
def test_splits_have_different_seeds_at_any_size_of_the_set(name: str) -> None:
    every = [job for share in (0.05, 0.31, 1.0) for job in jobs_of(name, share)]
    seeds = {
        split: {job.metadata.seed for job in of_split(every, split)}
        for split in ("train", "validation", "test")
    }
    assert not seeds["train"] & seeds["test"]
    assert not seeds["train"] & seeds["validation"]
    assert not seeds["validation"] & seeds["test"]


def test_seeds_are_unique_over_all_sets_and_above_those_of_trials() -> None:
    every = [job.metadata.seed for name in SETS for job in jobs_of(name)]
    assert len(set(every)) == len(every)
    assert min(every) >= SEEDS


def test_splits_have_different_textures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    textures: list[bytes] = []
    make = fingertip.height_field

    def noted(surface: Surface, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        field, step = make(surface, rng)
        textures.append((field / field.std()).round(3).tobytes())  # independent of its height
        return field, step

    monkeypatch.setattr(fingertip, "height_field", noted)
    found: dict[str, set[bytes]] = {}
    for job in (job for name in SETS for job in some_of_each_split(jobs_of(name, 0.3))):
        textures.clear()
        if job.metadata.cause in GRASPED:
            any_cell(lift_config(job.metadata, job.disturbances, turns=False), job.metadata.seed)
        else:
            any_cell(press_config(job.surface, ""), job.metadata.seed)
        found.setdefault(job.metadata.split, set()).update(textures)
        assert len(set(textures)) == len(textures)
    assert min(map(len, found.values())) > 8
    assert not found["train"] & (found["test"] | found["validation"])
    assert not found["validation"] & found["test"]


def some_of_each_split(jobs: list[Job]) -> Iterator[Job]:
    for split in ("train", "validation", "test"):
        yield from of_split(jobs, split)[::3][:8]


def written(folder: Path, text: str) -> Path:
    file = folder / "set.toml"
    file.write_text(f'name = "x"\nseed = 1\nrecordings = 9\n{text}\n')
    return file


GRASP = '[[causes]]\ncause = "grasped_slip"\non = ["straight"]\nshare = 1\nseconds = 9\nload = {}\n'


@pytest.mark.parametrize("where", ["randomise", "causes"])
def test_ranges_of_a_held_object_outside_its_shape_are_refused(where: str, tmp_path: Path) -> None:
    """A range that replaces a property of the random object could violate the margin."""
    of_the_can = '"object.mass_kg" = [0.3, 0.3]'
    more = f"randomise = {{ {of_the_can} }}" if where == "causes" else f"[randomise]\n{of_the_can}"
    with pytest.raises(ConfigError) as caught:
        load_dataset_config(written(tmp_path, GRASP.format("[1, 2]") + more))
    assert "config/object_shapes" in f"{caught.value} {caught.value.allowed}"
