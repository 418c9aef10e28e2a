"""Random objects of training data keep a distance from the objects of the experiments."""

import msgspec
import numpy as np
import pytest

from grasp.settings import config_dir, names
from scenarios.acquire.config import with_values
from scenarios.acquire.datasets.causes import GRASPED, base_lift_config
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan, press_config
from scenarios.acquire.datasets.random_objects import (
    MARGIN,
    distance,
    excluded_objects,
    object_properties,
    random_object,
    shape_ranges,
    surface_properties,
)
from scenarios.world.objects import GraspObject

SETS = ("paper", "disturbances", "grasped-slip", "mallet", "turning")
SAMPLES = 300  # of each shape


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return [
        job for name in SETS
        for job in plan(load_dataset_config(config_dir() / "datasets" / f"{name}.toml"))
    ]  # fmt: skip


def nearest(properties: dict[str, tuple[float, float]]) -> float:
    return min(distance(properties, object_properties(body)) for body in excluded_objects())


@pytest.mark.parametrize("load", [None, (0.1, 0.6), (1.05, 2.2)])
@pytest.mark.parametrize("name", names("object_shapes"))
def test_random_objects_keep_the_margin_from_all_objects(
    name: str, load: tuple[float, float] | None
) -> None:
    config, rng = base_lift_config(""), np.random.default_rng(5)
    found = [random_object(name, load, config, rng) for _ in range(SAMPLES)]
    assert min(nearest(object_properties(body)) for body in found) >= MARGIN
    widths = [body.half_width_m for body in found]
    low, high = shape_ranges(name).half_width_m
    assert low <= min(widths) < max(widths) <= high
    assert np.ptp(widths) > 0.8 * (high - low)


def test_recordings_of_every_set_keep_the_margin(jobs: list[Job]) -> None:
    for job in jobs[::10]:
        if job.metadata.cause in GRASPED:
            properties = object_properties(msgspec.convert(job.metadata.object, GraspObject))
        else:
            config = with_values(press_config(job.surface, ""), job.metadata.parameters)
            properties = surface_properties(config.surface)
        assert nearest(properties) >= MARGIN, job.path
