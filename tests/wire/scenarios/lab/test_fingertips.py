"""`grasp tactile watch`, `rest` and `identify` at an emulated lab."""

import json
import re
import signal
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scenarios.campaign.config import load_config
from scenarios.rigs.cell_control import ControlClient
from tests.wire.scenarios.lab.terminal import grasp, started
from tests.wire.scenarios.test_rigs import emulate, lab_file

PADS = (("A", 0), ("C", 4))


@pytest.fixture(scope="module")
def endpoints() -> Iterator[dict[str, Any]]:
    with emulate() as found:
        yield found


@pytest.fixture
def cell(endpoints: dict[str, Any]) -> Iterator[ControlClient]:
    client = ControlClient(endpoints["control"]["host"], endpoints["control"]["port"])
    yield client
    client.close()


@pytest.fixture
def lab(endpoints: dict[str, Any], tmp_path: Path) -> Path:
    return lab_file(tmp_path / "lab.toml", endpoints)


def test_every_second_is_told_and_every_taxel_at_the_end(lab: Path) -> None:
    done = grasp("tactile", "watch", "--seconds", "2", "--config", str(lab))
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.startswith("counts A ") for line in lines[:3]] == [True, True, False]
    assert len(lines) == 2 + 1 + 18
    told = json.loads(
        grasp("tactile", "watch", "--seconds", "1", "--json", "--config", str(lab)).stdout
    )
    assert all(400 < rest < 512 for finger in told["rest"] for rest in finger)
    assert all(abs(counts) < 2.0 for finger in told["counts"] for counts in finger)
    assert 0.0 < max(max(finger) for finger in told["noise_counts"]) < 1.5


def test_watch_ends_with_ctrl_c_and_tells_what_it_has_heard(lab: Path) -> None:
    with started("tactile", "watch", "--config", str(lab)) as run:
        assert run.stdout is not None
        first = run.stdout.readline()
        run.send_signal(signal.SIGINT)
        rest, _ = run.communicate(timeout=30)
    assert first.startswith("counts")
    assert "noise" in rest.splitlines()[-19]
    assert run.returncode == 0


def test_rest_is_a_file_that_settings_read_and_none_is_overwritten(
    lab: Path, tmp_path: Path
) -> None:
    out = tmp_path / "rest.toml"
    words = ("tactile", "watch", "--rest", "--seconds", "1", "--config", str(lab))
    words = (*words, "--out", str(out))
    done = grasp(*words)
    assert done.returncode == 0, done.stderr
    assert out.read_text() == done.stdout
    codes = tomllib.loads(done.stdout)["tactile"]["rest_reference"]
    config = load_config("can", "hardware", "energy", [lab, out])
    assert config.tactile.rest_reference == tuple(map(tuple, codes))
    again = grasp(*words)
    assert again.returncode == 2
    assert "is there already" in again.stderr


def identified(lab: Path, cell: ControlClient, *words: str) -> tuple[int, str]:
    """Pads pressed one after the other while `identify` watches, and what it showed."""
    with started("tactile", "identify", "--seconds", "3", "--config", str(lab), *words) as run:
        assert run.stderr is not None
        assert run.stderr.readline().startswith("press one pad after the other")
        for finger, taxel in PADS:
            cell.ask("press", finger=finger, taxel=taxel, newtons=2.0, seconds=0.4)
            time.sleep(0.6)
        shown, _ = run.communicate(timeout=60)
    return run.returncode, shown


def test_pads_that_a_person_presses_are_told_by_finger_and_taxel(
    lab: Path, cell: ControlClient
) -> None:
    code, shown = identified(lab, cell)
    assert code == 0
    assert [line for line in shown.splitlines() if not line.startswith("strongest")] == [
        "finger A taxel 0 (row 0, column 0)", "finger C taxel 4 (row 2, column 4)",
    ]  # fmt: skip


def test_fingers_wired_otherwise_than_the_file_says_are_seen_and_mended_in_it(
    lab: Path, cell: ControlClient
) -> None:
    a, b, c = ([[row, column] for column in range(6)] for row in range(3))
    wrong = f"tactile.cells={json.dumps([c, b, a])}"
    _, shown = identified(lab, cell, "--set", wrong)
    assert shown.splitlines()[:2] == [
        "finger C taxel 0 (row 0, column 0)", "finger A taxel 4 (row 2, column 4)",
    ]  # fmt: skip


def test_what_was_pressed_until_ctrl_c_is_told(lab: Path, cell: ControlClient) -> None:
    words = ("tactile", "identify", "--seconds", "600", "--config", str(lab))
    with started(*words) as run:
        assert run.stderr is not None and run.stdout is not None
        assert run.stderr.readline().startswith("press one pad after the other")
        cell.ask("press", finger="A", taxel=0, newtons=2.0, seconds=0.4)
        assert run.stdout.readline() == "finger A taxel 0 (row 0, column 0)\n"
        run.send_signal(signal.SIGINT)
        shown, _ = run.communicate(timeout=60)
    assert run.returncode == 0
    assert re.fullmatch(r"(finger A taxel 0 .*\n)*strongest: finger A taxel 0 .*\n", shown)
    with started(*words) as run:
        assert run.stderr is not None
        assert run.stderr.readline().startswith("press one pad after the other")
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert said == "grasp: interrupted\n"


def test_press_that_cannot_be_is_refused(cell: ControlClient) -> None:
    for wrong in ({"finger": "D"}, {"taxel": 6}, {"taxel": -1}, {"newtons": 1e9}, {"seconds": 0}):
        with pytest.raises(ValueError, match=r"finger|taxel|newtons|seconds"):
            cell.ask("press", **{"finger": "A", "taxel": 0, **wrong})


@pytest.mark.parametrize(
    "words",
    [
        ("watch", "--set", "usb.url=tcp://127.0.0.99:9"),
        ("rest", "--set", "usb.url=tcp://127.0.0.99:9"),
        ("identify", "--url", "tcp://127.0.0.99:9"),
    ],
    ids=lambda words: words[0],
)
def test_board_that_does_not_answer_at_its_url_is_told_with_url_and_remedy(
    lab: Path, words: tuple[str, ...]
) -> None:
    lab_words = () if words[0] == "identify" else ("--config", str(lab))
    done = grasp("tactile", *words, *lab_words)
    assert done.returncode == 3
    assert "no TakkTile board (59e3:74c7) at tcp://127.0.0.99:9" in done.stderr
    assert "prints a new one each time it starts" in done.stderr
