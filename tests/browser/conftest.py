"""Pages of a lift and a tap on the simulated rig."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.report.run_page import run_page
from scenarios.tap.tap import tap
from tests.browser.chromium import Chromium


@pytest.fixture(scope="session")
def lifted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a lift, with its page."""
    config = load_config("can", "simulated").for_lift()
    result = lift.run(config, 0, tmp_path_factory.mktemp("runs")).result
    assert result is not None and result.recording is not None
    return with_page(Path(result.recording).parent)


@pytest.fixture(scope="session")
def tapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a tap with a cusum rule, with its page."""
    rule = ["rule.kind=cusum", "rule.limit=8", "rule.fusion=any", "rule.threshold=0.5"]
    config = load_config("can", "simulated", "energy", None, rule).for_tap()
    result = tap.run(config, 0, tmp_path_factory.mktemp("runs")).result
    assert result is not None and result.recording is not None
    return with_page(Path(result.recording).parent)


def with_page(run: Path) -> Path:
    (run / "report.html").write_text(run_page(run), encoding="utf-8")
    return run


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Chromium]:
    with Chromium(tmp_path / "profile") as page:
        yield page
