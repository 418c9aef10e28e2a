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
# what may speak of them: who finds a file by its name, a page of a run among them, who keeps
# training away from them, and who says that no figure rests on them
FINDERS = {"grasp/settings.py", "scenarios/acquire/datasets/bodies.py", "scripts/figures.py",
           "scripts/last_draw.py", "scenarios/report/run_settings.py"}  # fmt: skip
LAST = (
    "last-draw"  # figures whose id begins so are the last tables, the only ones that may name them
)
FIGURE = re.compile(r"<!-- figure: id=(\S+)")


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


def named_in_figures(page: str) -> list[str]:
    """Lines of a page's tables, pictures and figures' commands that name one of them."""
    found, figure = [], ""
    for line in page.splitlines():
        if begins := FIGURE.search(line):
            figure = begins[1]
        told = line.startswith(("|", "![")) or begins is not None
        if told and NAMED.search(line) and not figure.startswith(LAST):
            found.append(line)
    return found


def test_no_code_or_configuration_names_them() -> None:
    """A default, a chart, a calibration or a tuning that did would have to say so somewhere."""
    sources = [
        path for room in ("grasp", "drivers", "detector", "scenarios", "scripts")
        for path in (ROOT / room).rglob("*.py")
    ]  # fmt: skip
    tables = [p for p in config_dir().rglob("*.toml") if p.parent.name != "unseen"]
    for path in (*sources, *tables):
        assert not re.search(rf"[\"']({'|'.join(UNSEEN)})[\"']", path.read_text()), path
    for path in sources:
        speaks = re.search(r"objects/unseen|\bUNSEEN\b", path.read_text()) is not None
        assert not speaks or path.relative_to(ROOT).as_posix() in FINDERS, path


def test_no_figure_names_them_before_the_last() -> None:
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        assert named_in_figures(page.read_text()) == [], page
    for drawn in (ROOT / "docs" / "figures").iterdir():
        if not drawn.name.startswith(LAST) and drawn.suffix != ".png":  # pages of a can, of a ball
            assert not NAMED.search(drawn.read_text()), drawn


def test_however_a_figure_names_them_it_is_seen() -> None:
    for line in (
        "| `mug` | 20 of 20 |", "|mug|", "| the jar, held | 3 |",
        '<!-- figure: id=x command="grasp run lift --object mug" commit=1 code=a -->',
        "![mug](figures/lift-mug.svg)",
    ):  # fmt: skip
        assert named_in_figures(line) == [line]
    last = f'<!-- figure: id={LAST}-lifts command="grasp campaign run" -->\n| mug | 20 |'
    assert named_in_figures(last) == []
    assert named_in_figures(last + "\n<!-- figure: id=other -->\n| mug | 20 |") == ["| mug | 20 |"]


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
