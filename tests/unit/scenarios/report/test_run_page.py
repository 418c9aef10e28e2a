"""The page of a run shows the recorded values, omits unknown ones, and escapes every text."""

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from grasp.control.states import State
from grasp.run.messages import PHASES
from scenarios.lift.scoring import LiftOutcome
from scenarios.report.run_page import HEADS, run_page
from scenarios.report.run_record import read_run
from scenarios.tap.scoring import TapOutcome
from scenarios.trial.run_folder import RESULT
from tests.unit.scenarios.report.conftest import Message, changed, data_of, unpacked

HOSTILE = "</script><script>alert(1)</script>"


@pytest.fixture(scope="module")
def page(recorded: Path) -> str:
    return run_page(recorded)


def remarks(page: str) -> str:
    return " ".join(re.findall(r'<p class="remark">(.*?)</p>', page))


def test_a_page_has_the_numbers_of_the_recording(recorded: Path, page: str) -> None:
    run, shown = read_run(recorded), unpacked(data_of(page)["series"])
    assert run.truth is not None
    np.testing.assert_allclose(shown["t"][:, 0], run.t_s, atol=1e-5)
    np.testing.assert_allclose(shown["true"], run.truth.normal_n, atol=1e-3)
    missing = np.isnan(run.counts[:, :, 0])
    assert missing[0].all() and not missing[-1].any()
    for name, values, near in (
        ("estimated", run.estimated_n, 1e-3),
        ("probability", run.probabilities, 1e-5),
    ):
        assert np.array_equal(np.isnan(shown[name]), missing)
        np.testing.assert_allclose(shown[name][~missing], values[~missing], atol=near)
    np.testing.assert_allclose(shown["slip"][:, 0], run.truth.slip_m, atol=1e-5)
    np.testing.assert_array_equal(shown["counts"], run.counts.reshape(len(run.t_s), -1))


def test_page_loads_nothing_from_other_addresses(page: str) -> None:
    assert re.findall(r'(?:src|href|action)="([^"]*)"', page) == ["data:,"]
    assert "@import" not in page and "url(" not in page
    assert "default-src 'none'" in page


def test_page_shows_the_verdict_with_its_figures(recorded: Path, page: str) -> None:
    result = json.loads((recorded / RESULT).read_text())
    (title,) = re.findall(r"<h1>(.*?)</h1>", page, re.DOTALL)
    assert HEADS[result["outcome"]].format(it="can").split(" lifted")[0] in title
    assert f"slipped {result['slip_distance_m'] * 1e3:.1f} mm" in title
    assert f"{max(result['peak_force_n'].values()):.1f} N; commanded" in title
    assert "_" not in title
    (figures,) = re.findall(r'<p class="hint">In figures: (.*?)</p>', page, re.DOTALL)
    assert f"peak force A {result['peak_force_n']['A']:.1f}, " in figures
    assert "limit 10 N on each finger" in figures
    assert f"the arm stopped for {result['paused_s']:.2f} s to respond to slip" in figures
    assert not remarks(page)


def test_the_first_screen_has_no_word_of_code(page: str) -> None:
    """Above the tables; scripts are left out, and the plots' own words are in their data."""
    screen = page[page.index("<header>") : page.index('<section class="tables">')]
    words = re.sub(r"<[^>]*>", " ", screen)
    assert not re.findall(r"\w+_\w+|\b[a-z]{2,}\.[a-z]{2,}|[{}]", words)
    assert set(data_of(page)["phase_names"]) == set(State)
    assert not re.search(r"[._]", " ".join(data_of(page)["phase_names"].values()))
    phases = page.split("<h2>Phases</h2>")[1].split("</table>", maxsplit=1)[0]
    assert re.search(r"thumb closes\s*<small>grasp.close</small>", phases)


def test_every_outcome_has_a_sentence_of_its_own() -> None:
    assert {*LiftOutcome, *TapOutcome} == set(HEADS)


def test_an_object_without_a_name_is_called_object(recorded: Path, tmp_path: Path) -> None:
    run = changed(recorded, tmp_path / "run")
    result = json.loads((run / RESULT).read_bytes())
    (run / RESULT).write_text(json.dumps(result | {"object": "unnamed"}))
    assert "The object was lifted" in run_page(run)


def test_html_in_a_foreign_text_is_escaped(recorded: Path, page: str, tmp_path: Path) -> None:
    def rename(message: Message) -> Message:
        topic, t_ns, content = message
        if topic == PHASES:
            content = msgspec.structs.replace(content, cause=HOSTILE, phase=HOSTILE)
        return topic, t_ns, content

    def settings(table: dict[str, Any]) -> None:
        table["object"]["description"] = HOSTILE

    hostile = run_page(changed(recorded, tmp_path / "run", rename, settings))
    assert hostile.count("<script") == page.count("<script")
    assert "&lt;/script&gt;&lt;script&gt;alert(1)" in hostile
    assert data_of(hostile)["scene"]["object"]["description"] == HOSTILE


def test_recording_that_was_cut_off_is_shown_to_its_end(recorded: Path, tmp_path: Path) -> None:
    whole = (recorded / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(whole[: len(whole) // 2])
    page = run_page(tmp_path)
    last_s = unpacked(data_of(page)["series"])["t"][-1, 0]
    assert f"cut off at {last_s:.2f} s" in remarks(page)


def test_checks_that_failed_in_report_mode_are_on_the_page(recorded: Path, tmp_path: Path) -> None:
    run = changed(recorded, tmp_path / "run")
    result = json.loads((run / RESULT).read_bytes())
    result["reported"] = [{"code": "arm_frozen", "device": "arm", "message": "it stood still"}]
    (run / RESULT).write_text(json.dumps(result))
    assert "without a stop" in remarks(run_page(run)) and "it stood still" in remarks(run_page(run))
