"""`grasp find` and `grasp doctor` at an emulated lab: what is there, and what is wrong with it."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.wire.scenarios.lab.terminal import grasp
from tests.wire.scenarios.test_rigs import emulate, lab_file, woken

URL, CALIBRATION = r'url = ".*"', r'calibration = ".*"'
STOP = ("--set", "controller.answer_stop_mps2=4")


@pytest.fixture(scope="module")
def endpoints() -> Iterator[dict[str, Any]]:
    with emulate() as found:
        yield found


def doctor(lab: Path, *words: str) -> tuple[int, dict[str, dict[str, str]]]:
    done = grasp("doctor", "--rig", "hardware", "--config", str(lab), "--json", *words)
    told = json.loads(done.stdout)
    return done.returncode, {check["name"]: check for check in told["checks"]}


def test_devices_that_answer_are_found_with_what_to_write_down(endpoints: dict[str, Any]) -> None:
    gripper, url = endpoints["gripper"], endpoints["tactile"]["url"]
    done = grasp("find", endpoints["host"], f"{gripper['host']}:{gripper['port']}", url)
    assert done.returncode == 0, done.stderr
    assert "not activated, no fault" in done.stdout
    assert "robot mode 7: running" in done.stdout
    assert "serial number" in done.stdout
    for line in (f"port = {gripper['port']}", f'url = "{url}"', f'host = "{endpoints["host"]}"'):
        assert line in done.stdout


def test_doctor_hears_every_device_and_says_what_a_run_would_do_first(
    endpoints: dict[str, Any], tmp_path: Path
) -> None:
    lab = lab_file(tmp_path / "lab.toml", endpoints)
    code, checks = doctor(lab)
    assert code == 3, checks
    assert [name for name, check in checks.items() if check["status"] == "fail"] == ["gripper"]
    assert "18 taxels, rest 4" in checks["fingertips"]["detail"]
    assert checks["arm pose"]["detail"].startswith("stands, tool at x 500")
    assert checks["force guard"]["status"] == "ok"
    assert "`grasp gripper activate`" in checks["gripper"]["remedy"]
    code, checks = doctor(woken(lab))
    assert code == 0, checks


@pytest.mark.parametrize(("words", "code", "told"), [
    (("--object", "cup"), 2, "object"),
    (("--profile", "none"), 2, "profile"),
    (("--detector", "none"), 2, "detector"),
    (("--profile", "paper", *STOP), 2, "answer_stop_mps2"),  # whose answer stops no arm
    (("--object", "ball", "--detector", "psd", *STOP), 0, ""),
])  # fmt: skip
def test_doctor_asks_of_the_run_that_is_named(
    endpoints: dict[str, Any], tmp_path: Path, words: tuple[str, ...], code: int, told: str
) -> None:
    ended, checks = doctor(woken(lab_file(tmp_path / "lab.toml", endpoints)), *words)
    assert ended == code, checks
    against = [check for check in checks.values() if check["status"] == "fail"]
    assert bool(against) == bool(told)
    assert all(told in check["detail"] + check["remedy"] for check in against)


@pytest.mark.parametrize(
    ("written", "instead", "check", "detail"),
    [
        (URL, 'url = "tcp://127.0.0.99:9"', "fingertips", "tcp://127.0.0.99:9"),
        (CALIBRATION, 'calibration = "manual"', "force guard", "cannot close with less than 15 N"),
        (r"\[tactile\]", "[tactile]\nrest_min_counts = 460", "fingertips", "outside 460..512"),
    ],
    ids=["no board at its URL", "refused by the force guard", "cannot be at rest"],
)
def test_doctor_fails_where_a_run_would(
    endpoints: dict[str, Any], tmp_path: Path, written: str, instead: str, check: str, detail: str
) -> None:
    lab = lab_file(tmp_path / "lab.toml", endpoints)
    text, changed = re.subn(written, instead, lab.read_text())
    assert changed == 1
    lab.write_text(text)
    code, checks = doctor(lab)
    assert code == 3
    assert checks[check]["status"] == "fail"
    assert detail in checks[check]["detail"]
