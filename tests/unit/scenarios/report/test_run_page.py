"""The page of a run says what was recorded, leaves out what nobody knows, and trusts no text."""

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from detector.motion import Motion
from drivers.errors import BadFile
from grasp.messages import ARM, GRIPPER, MOTION, PHASES, TRUTH
from grasp.phases import PhaseChange
from scenarios.lift.scoring import LiftOutcome
from scenarios.report.page import PARTS
from scenarios.report.run_page import page_path, run_page
from scenarios.report.run_record import read_run
from scenarios.report.run_words import HEADS
from scenarios.tap.scoring import TapOutcome
from scenarios.trial.run_folder import RESULT
from tests.unit.scenarios.report.conftest import Message, changed, data_of, unpacked

MOST_BYTES = 400_000
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
    unheard = np.isnan(run.counts[:, :, 0])
    assert unheard[0].all() and not unheard[-1].any()
    for name, values, near in (
        ("felt", run.felt_n, 1e-3),
        ("probability", run.probabilities, 1e-5),
    ):
        assert np.array_equal(np.isnan(shown[name]), unheard)
        np.testing.assert_allclose(shown[name][~unheard], values[~unheard], atol=near)
    np.testing.assert_allclose(shown["slip"][:, 0], run.truth.slip_m, atol=1e-5)
    np.testing.assert_array_equal(shown["counts"], run.counts.reshape(len(run.t_s), -1))


def test_a_page_is_small_and_equal_each_time(recorded: Path, page: str) -> None:
    assert len(page.encode()) <= MOST_BYTES
    assert run_page(recorded) == page


def test_a_page_asks_for_nothing_from_elsewhere(page: str) -> None:
    assert re.findall(r'(?:src|href|action)="([^"]*)"', page) == ["data:,"]
    assert "@import" not in page and "url(" not in page
    assert "default-src 'none'" in page


def test_a_page_says_the_verdict_with_its_figures(recorded: Path, page: str) -> None:
    result = json.loads((recorded / RESULT).read_text())
    (title,) = re.findall(r"<h1>(.*?)</h1>", page, re.DOTALL)
    assert HEADS["lift"][result["outcome"]] in title
    assert f"{result['slip_distance_m'] * 1e3:.1f} mm" in title
    most_n = max(result["peak_force_n"].values())
    assert f"{most_n:.1f} N (limit 10 N, every_finger: no finger shall bear more)" in title
    assert f"the arm stood {result['paused_s']:.2f} s to answer it" in title
    assert not remarks(page)


def test_every_outcome_has_words() -> None:
    assert HEADS["lift"].keys() == set(LiftOutcome)
    assert HEADS["tap"].keys() == set(TapOutcome)


def test_a_text_of_a_stranger_stays_text(recorded: Path, page: str, tmp_path: Path) -> None:
    def rename(message: Message) -> Message:
        topic, t_ns, told = message
        if topic == PHASES:
            told = msgspec.structs.replace(told, cause=HOSTILE, phase=HOSTILE)
        return topic, t_ns, told

    def settings(told: dict[str, Any]) -> None:
        told["object"]["name"] = told["object"]["description"] = HOSTILE

    hostile = run_page(changed(recorded, tmp_path / "run", rename, settings))
    assert hostile.count("<script") == page.count("<script")
    assert "&lt;/script&gt;&lt;script&gt;alert(1)" in hostile
    assert data_of(hostile)["scene"]["object"]["name"] == HOSTILE


def test_what_nobody_knows_is_left_out(recorded: Path, tmp_path: Path) -> None:
    run = changed(recorded, tmp_path / "run", lambda m: None if m[0] == TRUTH else m)
    result = json.loads((run / RESULT).read_text())
    unknown = dict.fromkeys(("peak_force_n", "slip_onset_s", "slip_distance_m", "turned_rad"))
    (run / RESULT).write_text(json.dumps(result | unknown | {"detection_latency_ms": None}))
    page = run_page(run)
    columns = unpacked(data_of(page)["series"])
    assert not {"true", "shear", "height", "slip", "turn"} & columns.keys()
    assert 'id="true-A"' not in page and 'id="plot-slip"' not in page and 'id="ruler"' not in page
    assert "Nobody knows true forces" in remarks(page)
    assert "the fingertips felt" in page
    assert not [m for m in data_of(page)["marks"] if m["kind"] == "onset"]


def test_a_recording_without_a_result_says_so(recorded: Path, tmp_path: Path) -> None:
    shutil.copy(recorded / "recording.mcap", tmp_path)
    page = run_page(tmp_path)
    assert "There is no verdict" in page
    assert "no result.json beside the recording" in remarks(page)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'{"outcome": 3}',
        b"\xff",
        b'{"outcome": "held", "timing": {"frame_age_ms": {"p50": "a"}}}',
    ],
)
def test_a_damaged_result_is_said(recorded: Path, tmp_path: Path, content: bytes) -> None:
    shutil.copy(recorded / "recording.mcap", tmp_path)
    (tmp_path / RESULT).write_bytes(content)
    assert "result.json beside the recording cannot be read" in remarks(run_page(tmp_path))


def test_a_recording_that_was_cut_off_is_shown_as_far_as_it_goes(
    recorded: Path, tmp_path: Path
) -> None:
    whole = (recorded / "recording.mcap").read_bytes()
    (tmp_path / "recording.mcap").write_bytes(whole[: len(whole) // 2])
    page = run_page(tmp_path)
    last_s = unpacked(data_of(page)["series"])["t"][-1, 0]
    assert f"cut off at {last_s:.2f} s" in remarks(page)


def test_a_damaged_recording_is_refused_with_what_to_do(recorded: Path, tmp_path: Path) -> None:
    content = bytearray((recorded / "recording.mcap").read_bytes())
    chunk = content.index(b"\x28\xb5\x2f\xfd", len(content) // 2)  # where zstd's begins
    content[chunk + 100] ^= 0xFF
    (tmp_path / "recording.mcap").write_bytes(content)
    with pytest.raises(BadFile, match="damaged") as caught:
        run_page(tmp_path)
    assert caught.value.remedy


def nested(levels: int) -> dict[str, Any]:
    return {"a": nested(levels - 1)} if levels else {}


@pytest.mark.parametrize("more", [{"contact": None}, {"tap": 3}, {"loop": nested(20)}])
def test_settings_that_cannot_be_are_refused_with_their_version(
    more: dict[str, Any], recorded: Path, tmp_path: Path
) -> None:
    run = changed(recorded, tmp_path / "run", settings=lambda told: told.update(more))
    with pytest.raises(BadFile, match="settings do not fit"):
        run_page(run)


def test_an_arm_that_says_no_number_is_no_zero(recorded: Path, tmp_path: Path) -> None:
    def lost(message: Message) -> Message:
        topic, t_ns, told = message
        if topic == ARM:
            told = msgspec.structs.replace(told, position_m=(None, None, None))
        return topic, t_ns, told

    page = run_page(changed(recorded, tmp_path / "run", lost))
    assert np.isnan(unpacked(data_of(page)["series"])["arm"]).all()


def test_commands_have_three_times(recorded: Path) -> None:
    sent = read_run(recorded).commands
    to_hand = [command for command in sent if command.applied is not None]
    assert len(to_hand) > 3 and len(to_hand) < len(sent)
    for command in to_hand:
        assert command.confirmed_ns is not None
        assert command.decided_ns <= command.sent_ns < command.confirmed_ns
    assert all(command.confirmed_ns is None for command in sent if command.applied is None)


def test_a_phase_in_the_data_is_one_that_was_recorded(recorded: Path, page: str) -> None:
    changes: list[PhaseChange] = read_run(recorded).phases
    assert [phase["name"] for phase in data_of(page)["phases"]] == [c.phase for c in changes]


def test_the_kits_taxels_stand_in_two_rows(page: str) -> None:
    places = [tuple(place) for place in data_of(page)["taxels"]]
    assert places == [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)]


def test_taxels_stand_where_the_settings_have_them(recorded: Path, tmp_path: Path) -> None:
    places = [[0, 1], [0, 2], [0, 3], [5, 1], [5, 2], [5, 3]]

    def settings(told: dict[str, Any]) -> None:
        told["fingertip"]["taxels_mm"] = places

    page = run_page(changed(recorded, tmp_path / "run", settings=settings))
    found = [tuple(place) for place in data_of(page)["taxels"]]
    assert found == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]


# The library of the plots


def test_the_library_is_the_one_that_its_page_names() -> None:
    text = (PARTS / "uplot" / "README.md").read_text()
    sums = dict(re.findall(r"`([\w.]+)` \| `([0-9a-f]{64})`", text))
    assert sums.keys() == {"uPlot.iife.min.js", "uPlot.min.css"}
    for name, wanted in sums.items():
        assert hashlib.sha256((PARTS / "uplot" / name).read_bytes()).hexdigest() == wanted
    assert "MIT License" in (PARTS / "uplot" / "LICENSE").read_text()
    assert "1.6.32" in text and "v1.6.32" in (PARTS / "uplot" / "uPlot.iife.min.js").read_text()


def test_a_page_is_called_as_its_recording_where_that_has_a_name_of_its_own(tmp_path: Path) -> None:
    assert page_path(tmp_path) == tmp_path / "report.html"
    assert page_path(tmp_path / "recording.mcap") == tmp_path / "report.html"
    assert page_path(tmp_path / "000010-tap-foam.mcap") == tmp_path / "000010-tap-foam.html"


def test_what_heads_tell_is_shown_where_they_were_asked(
    recorded: Path, page: str, tmp_path: Path
) -> None:
    assert "by the heads" not in page and "told_speed" not in unpacked(data_of(page)["series"])
    at_ns = round(read_run(recorded).t_s[100] * 1e9)

    def told(message: Message) -> Message:
        topic, t_ns, _ = message
        if topic == GRIPPER and abs(t_ns - at_ns) < 1000:  # gives up its place
            return MOTION, t_ns, Motion([0.01, 0.02, 0.03], [0, 45, 315], [0.1, 0.9, 0.5])
        return message

    with_heads = run_page(changed(recorded, tmp_path / "told", told))
    shown = unpacked(data_of(with_heads)["series"])
    assert "by the heads" in with_heads and 'id="plot-told"' in with_heads
    np.testing.assert_allclose(shown["told_speed"][100], [0.01, 0.02, 0.03])
    np.testing.assert_allclose(shown["told_way"][100], [0, 45, 315])
    np.testing.assert_allclose(shown["told_turning"][100], [0.1, 0.9, 0.5])
    assert np.isnan(np.delete(shown["told_speed"], 100, axis=0)).all()


def test_phases_say_how_long_they_lasted(recorded: Path, page: str) -> None:
    first, second, *_ = read_run(recorded).phases
    lasted_s = (second.t_ns - first.t_ns) * 1e-9
    assert f'<th scope="row">{first.phase}</th><td>{lasted_s:.2f}</td>' in page
