"""The page of a run in a real browser: no errors, and control by mouse and keys."""

import math
from pathlib import Path

import numpy as np
import pytest

from scenarios.report.run_record import RunRecord, read_run
from scenarios.report.run_view import PHASE_NAMES
from tests.browser.chromium import BROWSER, Chromium

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium (on Debian: apt-get install chromium)"),
]


def index(page: Chromium) -> int:
    """Index of the shown sample."""
    return int(page.value("Number(document.getElementById('slider').value)"))


def move(page: Chromium, to: int) -> None:
    """Move the slider as a user does."""
    page.value(
        f"(() => {{ const s = document.getElementById('slider'); s.value = {to};"
        "s.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )


def shown(page: Chromium, what: str) -> list[float]:
    """The numbers shown for the fingers; a dash is NaN."""
    texts = [page.text(f"#{what}-{finger}") for finger in "ABC"]
    return [math.nan if text == "–" else float(text) for text in texts]


def agrees(page: Chromium, run: RunRecord, at: int) -> None:
    assert run.truth is not None
    assert index(page) == at
    assert shown(page, "true") == pytest.approx(run.truth.normal_n[at], abs=0.0056)
    rows = (("estimated", run.estimated_n, 0.0056), ("probability", run.probabilities, 0.00051))
    for what, values, near in rows:
        assert shown(page, what) == pytest.approx(run.known(values)[at], abs=near, nan_ok=True)
    assert page.text("#clock") == f"{run.t_s[at]:.2f} s"


@pytest.mark.parametrize("name", ["lifted", "tapped"])
def test_page_has_no_requests_and_no_errors(
    name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    file = request.getfixturevalue(name) / "report.html"
    with Chromium(tmp_path, dark=name == "tapped") as page:
        page.open(file)
        page.press("n")
        page.printed()
        assert page.errors == []
        assert page.requests == [file.as_uri()]
        assert page.value("document.getElementById('error').hidden")


def test_forces_at_the_cursor_are_the_recordings(lifted: Path, browser: Chromium) -> None:
    run = read_run(lifted)
    browser.open(lifted / "report.html")
    assert run.truth is not None
    for at in (
        0,
        len(run.t_s) // 3,
        int(run.truth.normal_n.max(axis=1).argmax()),
        len(run.t_s) - 1,
    ):
        move(browser, at)
        agrees(browser, run, at)


def test_keys_select_samples_and_phases(lifted: Path, browser: Chromium) -> None:
    run = read_run(lifted)
    browser.open(lifted / "report.html")
    last = len(run.t_s) - 1
    browser.press("Home")
    assert index(browser) == 0
    browser.press("ArrowRight")
    browser.press("ArrowRight", shift=True)
    assert index(browser) == 11
    browser.press("ArrowLeft")
    assert index(browser) == 10
    browser.press("End")
    assert index(browser) == last
    browser.press("p")
    phase = run.phases[-2]
    assert run.t_s[index(browser)] == pytest.approx(phase.t_ns * 1e-9)
    assert browser.text("#phase") == PHASE_NAMES[phase.phase]
    browser.press("n")
    assert browser.text("#phase") == PHASE_NAMES[run.phases[-1].phase]
    browser.value("document.getElementById('slider').focus()")
    browser.press("ArrowLeft")  # counted once although the slider handles this key too
    assert index(browser) == last - 1


def test_page_opens_on_the_second_around_the_slip(lifted: Path, browser: Chromium) -> None:
    run = read_run(lifted)
    browser.open(lifted / "report.html")
    slip_s = float(run.t_s[np.flatnonzero(run.registered)[0]])
    assert 0.1 < slip_s - run.t_s[index(browser)] < 0.2
    shown_phases = browser.text("#strip")
    assert "respond to slip" in shown_phases and "open" not in shown_phases
    browser.value("document.getElementById('span').click()")
    assert browser.text("#span") == "one second"


def test_click_on_a_plot_or_a_time_selects_that_instant(lifted: Path, browser: Chromium) -> None:
    run = read_run(lifted)
    browser.open(lifted / "report.html")
    browser.value("document.getElementById('span').click()")
    x, y = browser.value(
        "(() => { const r = document.querySelector('#plot-force .u-over').getBoundingClientRect();"
        "return [r.left + r.width / 2, r.top + r.height / 2]; })()"
    )
    browser.click(x, y)
    middle = int(np.searchsorted(run.t_s, (run.t_s[0] + run.t_s[-1]) / 2))
    assert abs(index(browser) - middle) <= 2
    agrees(browser, run, index(browser))
    browser.value("document.querySelectorAll('button.at')[3].click()")
    assert browser.text("#phase") == PHASE_NAMES[run.phases[3].phase]


PICTURE = "document.getElementById('scene').toDataURL()"


def test_scene_turns_by_mouse_and_keys_and_back(lifted: Path, browser: Chromium) -> None:
    browser.open(lifted / "report.html")
    first, at = browser.value(PICTURE), index(browser)
    x, y = browser.value(
        "(() => { const r = document.getElementById('scene').getBoundingClientRect();"
        "return [r.left + r.width / 2, r.top + r.height / 2]; })()"
    )
    browser.drag(x, y, x + 60, y + 10)
    turned = browser.value(PICTURE)
    assert turned != first
    browser.value("document.getElementById('scene').focus()")
    browser.press("ArrowLeft")
    assert browser.value(PICTURE) not in (first, turned)
    assert index(browser) == at  # the key did not step through the samples
    browser.value("document.getElementById('unturn').click()")
    assert browser.value(PICTURE) == first


def test_scene_follows_the_arm_and_says_so_as_text(lifted: Path, browser: Chromium) -> None:
    run = read_run(lifted)
    browser.open(lifted / "report.html")
    browser.press("Home")
    low = browser.value(PICTURE)
    move(browser, int(run.arm_m[:, 2].argmax()))
    assert browser.value(PICTURE) != low
    label = str(browser.value("document.getElementById('scene').getAttribute('aria-label')"))
    risen_mm = 1e3 * (run.arm_m[:, 2].max() - run.arm_m[0, 2])
    assert float(label.split()[1]) == pytest.approx(risen_mm, abs=1.0)


@pytest.mark.parametrize("width", [320, 360, 1280])
def test_nothing_is_wider_than_the_window(lifted: Path, browser: Chromium, width: int) -> None:
    browser.resize(width, 740)
    browser.open(lifted / "report.html")
    assert browser.value("document.documentElement.scrollWidth") <= width


def test_controls_of_a_phone_stay_visible_and_fit_a_finger(lifted: Path, browser: Chromium) -> None:
    browser.resize(360, 740)
    browser.open(lifted / "report.html")
    browser.value("scrollTo(0, document.body.scrollHeight)")
    boxes = browser.value(
        "[...document.querySelectorAll('.player button, .player select, .player input')]"
        ".map((e) => e.getBoundingClientRect()).map((r) => [r.top, r.bottom, r.width])"
    )
    assert len(boxes) == 6
    for top, bottom, wide in boxes:
        assert top >= 0 and bottom < 370 and bottom - top >= 40 and wide >= 40


def test_lines_differ_by_more_than_their_colour(lifted: Path, browser: Chromium) -> None:
    """The legend's limits are dashed, and each finger is named to the right of its curves."""
    browser.open(lifted / "report.html")
    legend = "getComputedStyle(document.querySelector('#legend-{} .limit')).borderTopStyle"
    for plot in ("force", "probability"):
        assert browser.value(legend.format(plot)) == "dashed"
        drawn = browser.value(
            f"(() => {{ const c = document.querySelector('#plot-{plot} canvas');"
            f"const o = document.querySelector('#plot-{plot} .u-over');"
            "const right = (o.offsetLeft + o.offsetWidth) * devicePixelRatio + 2;"
            "const d = c.getContext('2d').getImageData(right, 0, c.width - right, c.height).data;"
            "return d.filter((v, k) => k % 4 === 3 && v > 0).length; })()"
        )
        assert drawn > 3 * 15


def test_slip_is_not_shown_where_nothing_is_touched(lifted: Path, browser: Chromium) -> None:
    browser.open(lifted / "report.html")
    assert browser.text("#ruler .reading") == ""
    browser.press("End")
    assert browser.text("#ruler .reading") == "no contact"
