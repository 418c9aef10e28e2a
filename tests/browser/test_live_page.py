"""A live page in a real browser follows the run and shows its numbers."""

import time
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.report.live_feed import LiveTrials
from scenarios.trial.experiment import TrialContext
from scenarios.trial.series import run_series
from tests.browser.chromium import BROWSER, Chromium

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium (on Debian: apt-get install chromium)"),
]
LONG_S = 30.0


def until(page: Chromium, expression: str) -> None:
    deadline = time.monotonic() + LONG_S
    while not page.value(expression):
        assert time.monotonic() < deadline, (expression, page.errors)
        time.sleep(0.05)


def test_page_follows_a_run_and_keeps_its_last_instant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    config = load_config("can", "simulated").for_lift()
    live = LiveTrials(config, "a lift", 1)
    shown: list[Any] = []

    def watch(tick: Any, truth: Any, controller: Any) -> None:
        if tick.decision.state != "lower.descend":  # the object is held at the last shown instant
            live.watch(tick, truth, controller)
            shown.append((tick, truth))
            time.sleep(0.002)

    with Chromium(tmp_path) as page:
        page.call("Page.navigate", url=live.feed.address)
        until(page, "document.documentElement?.dataset.ready")
        assert page.text("#state") == "waiting for the first sample"
        empty = "getComputedStyle(document.querySelector('.state')).visibility"
        assert page.value(empty) == "hidden"
        list(run_series(lift, config, [0], TrialContext(None, watch=watch)))
        until(page, "document.documentElement.dataset.rows > 100")
        assert page.value(empty) == "visible"
        live.feed.say("seed 0    held  slipped   1.0 mm")
        until(page, "document.getElementById('note').textContent")
        assert " ".join(page.text("#note").split()) == "seed 0, held, slipped 1.0 mm"
        at = float(page.text("#clock").removesuffix(" s"))
        tick, truth = min(shown, key=lambda each: abs(each[0].t_ns * 1e-9 - at))
        for i, finger in enumerate("ABC"):
            assert float(page.text(f"#true-{finger}")) == pytest.approx(
                truth.normal_n[i], abs=0.006
            )
            assert float(page.text(f"#estimated-{finger}")) == pytest.approx(
                tick.estimated_n[i], abs=0.006
            )
        page.press("Home")  # after a user's action the page no longer follows
        assert page.value("Number(document.getElementById('slider').value)") == 0
        page.value("document.getElementById('follow').click()")
        until(page, "Number(document.getElementById('slider').value) > 100")
        live.feed.close()
        until(page, "document.getElementById('state').textContent === 'over'")
        assert page.errors == []
        host = live.feed.address.split("/")[2]
        assert {url.split("/")[2] for url in page.requests} == {host}
        assert page.value("document.documentElement.scrollWidth") <= 1280
