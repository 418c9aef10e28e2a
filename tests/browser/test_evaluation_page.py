"""The page of an evaluation in a real browser: quiet, without a script, no wider than it may be."""

from pathlib import Path

import pytest

from scenarios.report.evaluation_page import evaluation_page
from tests.browser.chromium import BROWSER, Chromium
from tests.unit.scenarios.report.test_evaluation_page import made

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium (on Debian: apt-get install chromium)"),
]


@pytest.mark.parametrize("width", [360, 1280])
@pytest.mark.parametrize("dark", [False, True])
def test_a_page_asks_for_nothing_and_complains_of_nothing(
    width: int, dark: bool, tmp_path: Path
) -> None:
    page = tmp_path / "toys.html"
    page.write_text(evaluation_page(made(tmp_path / "toys.json")))
    with Chromium(tmp_path / "profile", dark, (width, 800)) as browser:
        browser.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1,
            mobile=False,
        )  # fmt: skip
        browser.open(page)
        browser.printed()
        assert browser.complaints == []
        assert browser.requests == [page.as_uri()]
        assert browser.value("document.documentElement.scrollWidth") <= width
        chart = "document.querySelector('.chart svg').getBoundingClientRect().width"
        assert browser.value(chart) > 50
