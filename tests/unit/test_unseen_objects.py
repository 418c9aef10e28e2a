"""Objects kept for testing: graspable, named by whoever wants them, and met by nothing else."""

import re
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from grasp.settings import config_dir, named_layer, names
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import CampaignSpec
from scenarios.tap.mallet import search
from scenarios.tap.tap import tap_config

ROOT = Path(__file__).parents[2]
UNSEEN = ("book", "bottle", "jar", "mug", "orange", "sponge")
NAMED = re.compile(rf"\b({'|'.join(UNSEEN)})\b")
# modules that may name the folder: finding a file by name, and keeping training away from it
FINDERS = {"grasp/settings.py", "scenarios/acquire/datasets/bodies.py",
           "scenarios/report/run_settings.py"}  # fmt: skip
LAST = {"last-draw.md", "robustness.md"}  # pages whose tables may name them: results of testing


def test_they_are_in_no_list_and_are_found_by_name() -> None:
    assert tuple(names("objects/unseen")) == UNSEEN
    assert not set(UNSEEN) & set(names("objects"))
    for name in UNSEEN:
        assert load_config(name, "simulated", "energy").object.name == name
    with pytest.raises(ConfigError, match="unknown") as caught:
        named_layer("objects", "anvil")
    assert not NAMED.search(str(caught.value))


def test_a_campaign_may_name_them() -> None:
    assert CampaignSpec(name="last", objects=UNSEEN, repetitions=1).objects == UNSEEN


def test_no_code_or_configuration_names_them() -> None:
    """A default, a chart, a calibration or a tuning that did would have to say so somewhere."""
    sources = [
        path for room in ("grasp", "drivers", "detector", "scenarios", "scripts", "studies")
        for path in (ROOT / room).rglob("*.py")
    ]  # fmt: skip
    tables = [p for p in config_dir().rglob("*.toml") if p.parent.name != "unseen"]
    for path in (*sources, *tables):
        assert not re.search(rf"[\"']({'|'.join(UNSEEN)})[\"']", path.read_text()), path
    for path in sources:
        speaks = re.search(r"objects/unseen|\bUNSEEN\b", path.read_text()) is not None
        assert not speaks or path.relative_to(ROOT).as_posix() in FINDERS, path


def test_no_other_table_or_figure_names_them() -> None:
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        rows = [line for line in page.read_text().splitlines() if line.startswith(("|", "!["))]
        assert page.name in LAST or not [row for row in rows if NAMED.search(row)], page
    for drawn in (ROOT / "docs" / "figures").iterdir():
        if not drawn.name.startswith("last-draw") and drawn.suffix != ".png":
            assert not NAMED.search(drawn.read_text()), drawn


@pytest.mark.parametrize("name", UNSEEN)
def test_a_full_grip_carries_them_and_a_blow_moves_them_without_knocking_them_out(
    name: str,
) -> None:
    config = load_config(name, "simulated", "energy")
    body, grip_n = config.object, sum(config.guard.full_grip_n)
    assert body.friction_kinetic * grip_n > 1.5 * body.total_kg * 9.81
    tap = tap_config(config.for_tap())
    for direction in ("top", "side"):
        assert 0.02 < search(tap, direction) < 1.0
