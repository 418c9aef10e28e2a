"""Contact levels of a run: by experiment, by causes of rotation, and by settings."""

import pytest

from grasp.settings import names
from scenarios.campaign.config import RunConfig, load_config
from scenarios.tap.tap import tap
from scenarios.trial.config import contact_table
from scenarios.world.settings import ContactLevels


def config(*assignments: str, name: str = "can", rig: str = "simulated") -> RunConfig:
    return load_config(name, rig, "energy", None, assignments)


def lifted(*assignments: str, name: str = "can") -> ContactLevels | None:
    return config(*assignments, name=name).for_lift().physics(0)


def tapped(direction: str, *assignments: str, name: str = "can") -> ContactLevels | None:
    settings = config(f"tap.direction={direction}", *assignments, name=name)
    return tap.configure(settings.for_tap()).physics(0)


@pytest.mark.parametrize("name", names("objects"))
def test_lifts_and_taps_of_the_objects_have_the_levels_of_their_row(name: str) -> None:
    assert lifted(name=name) == contact_table().lift
    for direction in ("top", "side", "closing"):
        assert tapped(direction, name=name) == getattr(contact_table(), direction)


def test_off_centre_weight_and_a_pull_need_a_level_with_rotation() -> None:
    aside = lifted("object.centre_aside_m=0.006")
    assert aside is not None and (aside.level, aside.impact_level) == ("L3", "L4")
    pulled = lifted("pull.force_n=6")
    assert pulled is not None and pulled.level == "L4"
