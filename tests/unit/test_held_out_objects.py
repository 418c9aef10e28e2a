"""Held-out test objects: found by name, and used by no list, default or tuning."""

import re
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp.settings import config_dir, named_layer, names
from scenarios.campaign.config import load_config

ROOT = Path(__file__).parents[2]
UNSEEN = ("book", "bottle", "jar", "mug", "orange", "sponge")
NAMED = re.compile(rf"\b({'|'.join(UNSEEN)})\b")
# modules that may refer to the folder: they find files by name, or keep training away from it
FINDERS = {
    "grasp/settings.py",
    "scenarios/acquire/datasets/random_objects.py",
    "scenarios/report/run_settings.py",
}


def test_held_out_objects_are_in_no_list_and_are_found_by_name() -> None:
    assert tuple(names("objects/unseen")) == UNSEEN
    assert not set(UNSEEN) & set(names("objects"))
    for name in UNSEEN:
        assert load_config(name, "simulated", "energy").object.name == name
    with pytest.raises(ConfigError, match="unknown") as caught:
        named_layer("objects", "anvil")
    assert not NAMED.search(str(caught.value))


def test_held_out_objects_are_not_named_in_code_or_configuration() -> None:
    """A default, chart, calibration or tuning that used them would have to name them."""
    sources = [
        path for package in ("grasp", "drivers", "detector", "scenarios", "studies")
        for path in (ROOT / package).rglob("*.py")
    ]  # fmt: skip
    tables = [p for p in config_dir().rglob("*.toml") if p.parent.name != "unseen"]
    for path in (*sources, *tables):
        assert not re.search(rf"[\"']({'|'.join(UNSEEN)})[\"']", path.read_text()), path
    for path in sources:
        speaks = re.search(r"objects/unseen|\bUNSEEN\b", path.read_text()) is not None
        assert not speaks or path.relative_to(ROOT).as_posix() in FINDERS, path
