"""The fingertip of a run beside the one of the paper's set."""

import msgspec
import pytest

from grasp.settings import config_dir
from scenarios.acquire.datasets.plan import load_dataset_config
from scenarios.world.fingertip_settings import FingertipSettings, in_a_grasp

SECTION = "fingertip."


def test_the_fingertip_of_a_run_is_the_middle_of_the_compliant_part() -> None:
    config = load_dataset_config(config_dir() / "datasets" / "paper.toml")
    (part,) = (p for p in config.parts if p.name == "compliant")
    settings = msgspec.structs.asdict(FingertipSettings())
    ranges = {k: v for k, v in (config.randomise | part.randomise).items() if k.startswith(SECTION)}
    assert len(ranges) > 20
    for key, (low, high) in ranges.items():
        assert settings[key.removeprefix(SECTION)] == pytest.approx((low + high) / 2), key


def test_in_a_grasp_the_hand_is_as_restless_as_told_and_the_pads_are_the_same() -> None:
    pressed = FingertipSettings(holding_share=0.5)
    held = in_a_grasp(pressed)
    for name in ("wander_mm", "vibration_mm", "sway_mm", "shift_mm", "rock_rad"):
        assert getattr(held, name) == 0.5 * getattr(pressed, name)
    for name in ("lever_x", "spring_mm", "crown_radius_mm", "relaxation_slow_share"):
        assert getattr(held, name) == getattr(pressed, name)
