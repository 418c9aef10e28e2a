"""The page of a campaign in a real browser: quiet, without a script, no wider than the window."""

from pathlib import Path

import pytest

from scenarios.report.campaign_page import campaign_page
from tests.browser.chromium import BROWSER, Chromium
from tests.unit.scenarios.report.test_campaign_page import SPEC, made

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium (on Debian: apt-get install chromium)"),
]


@pytest.mark.parametrize("width", [360, 1280])
@pytest.mark.parametrize("dark", [False, True])
def test_a_page_asks_for_nothing_and_complains_of_nothing(
    width: int, dark: bool, tmp_path: Path
) -> None:
    page = tmp_path / "small.html"
    page.write_text(campaign_page(made(tmp_path / "small.sqlite", SPEC), page))
    with Chromium(tmp_path / "profile", dark, (width, 800)) as browser:
        browser.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1,
            mobile=False,
        )  # fmt: skip
        browser.open(page)
        assert browser.complaints == []
        assert browser.requests == [page.as_uri()]
        assert browser.value("document.documentElement.scrollWidth") <= width
        chart = "document.querySelector('.chart svg').getBoundingClientRect().width"
        assert browser.value(chart) > 50
