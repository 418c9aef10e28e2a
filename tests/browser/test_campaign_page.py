"""Pages of a campaign and an evaluation in a real browser: no errors, requests or overflow."""

from pathlib import Path

import pytest

from scenarios.report.campaign_page import campaign_page
from scenarios.report.score_page import score_page
from tests.browser.chromium import BROWSER, Chromium
from tests.unit.scenarios.report.test_campaign_page import SPEC, made
from tests.unit.scenarios.report.test_score_page import made as evaluated

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium (on Debian: apt-get install chromium)"),
]


@pytest.mark.parametrize(("width", "dark"), [(360, False), (1280, True)])
def test_page_has_no_requests_and_no_errors(width: int, dark: bool, tmp_path: Path) -> None:
    campaign, evaluation = tmp_path / "small.html", tmp_path / "toys.html"
    campaign.write_text(campaign_page(made(tmp_path / "small.sqlite", SPEC), campaign))
    evaluation.write_text(score_page(evaluated(tmp_path / "toys.json")))
    with Chromium(tmp_path / "profile", dark, (width, 800)) as browser:
        browser.resize(width, 740)
        for page in (campaign, evaluation):
            browser.requests.clear()
            browser.open(page)
            assert browser.errors == []
            assert browser.requests == [page.as_uri()]
            assert browser.value("document.documentElement.scrollWidth") <= width
            least = "Math.min(40, ...[...document.querySelectorAll('a, summary')]"
            least += ".map((e) => e.getBoundingClientRect().height))"
            assert width > 360 or browser.value(least) >= 40
        chart = "document.querySelector('.chart svg').getBoundingClientRect().width"
        assert browser.value(chart) > 50  # of a worst miss
