"""What training touches is drawn, and keeps its distance from the objects of the experiments."""

import math

import msgspec
import numpy as np
import pytest

from grasp.settings import config_dir, names
from scenarios.acquire.datasets.bodies import (
    MARGIN,
    SCALES,
    body_ranges,
    distance,
    draw_object,
    far,
    kept_away,
    of_object,
    of_surface,
)
from scenarios.acquire.datasets.draws import with_values
from scenarios.acquire.datasets.grasped import GRASPED, bare_config
from scenarios.acquire.datasets.plan import Job, load_dataset_config, plan, pressing
from scenarios.world.objects import GraspObject

SETS = ("paper", "confusers", "grasped-slip", "mallet", "turning")
DRAWS = 300  # of each kind of object


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    return [
        job for name in SETS
        for job in plan(load_dataset_config(config_dir() / "datasets" / f"{name}.toml"))
    ]  # fmt: skip


def nearest(properties: dict[str, tuple[float, float]]) -> float:
    return min(distance(properties, of_object(body)) for body in kept_away())


def test_distance_is_kept_from_the_six_and_from_those_kept_for_testing() -> None:
    kept = {body.name for body in kept_away()}
    assert kept == {*names("objects"), *names("objects/unseen")}
    assert len(kept) == 12
    for body in kept_away():
        assert not far(of_object(body))


@pytest.mark.parametrize("load", [None, (0.1, 0.6), (1.05, 2.2)])
@pytest.mark.parametrize("name", names("bodies"))
def test_objects_are_drawn_at_the_margin_from_all_twelve(
    name: str, load: tuple[float, float] | None
) -> None:
    config, rng = bare_config(""), np.random.default_rng(5)
    found = [
        draw_object(body_ranges(name), load, config.contact, config.hand.m_per_count, 20.0, rng)
        for _ in range(DRAWS)
    ]
    assert min(nearest(of_object(body)) for body in found) >= MARGIN
    widths = [body.half_width_m for body in found]
    low, high = body_ranges(name).half_width_m
    assert low <= min(widths) < max(widths) <= high
    assert np.ptp(widths) > 0.8 * (high - low)


def test_recordings_of_every_set_keep_the_margin(jobs: list[Job]) -> None:
    for job in jobs[::10]:
        if job.metadata.cause in GRASPED:
            properties = of_object(msgspec.convert(job.metadata.object, GraspObject))
        else:
            config = with_values(pressing(job.surface, ""), job.metadata.parameters)
            properties = of_surface(config.surface)
        assert nearest(properties) >= MARGIN, job.path


def test_distance_counts_spans_and_ratios_and_a_mass_between_bare_and_loaded_as_none() -> None:
    can = next(body for body in kept_away() if body.name == "can")
    own = of_object(can)
    assert distance(own, own) == 0.0
    low, high, _ = SCALES["half_width_m"]
    wider = msgspec.structs.replace(can, half_width_m=can.half_width_m + 0.5 * (high - low))
    assert distance(own, of_object(wider)) == pytest.approx(0.5)
    low, high, _ = SCALES["wall_stiffness_npm"]
    softer = msgspec.structs.replace(can, wall_stiffness_npm=can.wall_stiffness_npm / 10)
    decades = math.log10(high / low)
    assert distance(own, of_object(softer)) == pytest.approx(1.0 / decades)
    between = msgspec.structs.replace(can, mass_kg=can.mass_kg + 0.1, added_mass_kg=0.0)
    assert distance(own, of_object(between)) == 0.0
    assert distance(own, {"half_width_m": own["half_width_m"]}) == 0.0  # what both have
