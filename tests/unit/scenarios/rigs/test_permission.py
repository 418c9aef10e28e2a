"""Only lab commands with a confirmation on their command line open real devices; files and
settings cannot."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import grasp
from drivers.errors import ConfigError, UsageError
from grasp.cli.commands import build_parser
from grasp.cli.main import main
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.rigs import opening, wired
from scenarios.rigs.permission import MotionPermit, check_devices, permit
from scenarios.tap.tap import tap
from scenarios.trial.experiment import TrialContext
from scenarios.trial.series import run_series
from tests.calibrations import PRESSED
from tests.unit.grasp.cli.test_recordings_cli import stroke_csv

# addresses without a device: a test that connected would fail and move nothing
LAB = """
[gripper]
calibration = "paper"
[calibration]
pressed_bytes = [0]
presses = 10
[modbus]
host = "127.0.0.99"
port = 9
[usb]
url = "tcp://127.0.0.99:9"
[ur]
host = "127.0.0.99"
"""
LAB_WORDS = (
    "gripper.calibration=paper", *PRESSED, "modbus.host=127.0.0.99", "modbus.port=9",
    "usb.url=tcp://127.0.0.99:9", "ur.host=127.0.0.99",
)  # fmt: skip
CHOICES = (
    'rig = "hardware"',
    'profile = "paper"',
    'detector_name = "psd"',
    'detector_name = "zzz"',
)


@pytest.fixture(autouse=True)
def devices(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Record attempts to open real devices and prevent them."""
    opened: list[str] = []

    def wired_devices(config: Any, clock: Any) -> Any:
        opened.append(config.rig)
        raise AssertionError("real devices were opened")

    monkeypatch.setattr(wired, "wired_devices", wired_devices)
    return opened


def hardware_lift() -> Any:
    return load_config("can", "hardware", "energy", None, LAB_WORDS)


# Every command


def verbs(parser: argparse.ArgumentParser) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command of the parser with its own parser."""
    nested = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not nested:
        yield (), parser
    for action in nested:
        for name, sub in action.choices.items():
            yield from (((name, *rest), leaf) for rest, leaf in verbs(sub))


GRIPPER = ("activate", "close", "step")
ARM = ("step", "stop")
TACTILE = ("watch",)
CALIBRATE = {
    "force": ["--out", "f.toml"], "hand": ["--out", "f.toml", "--up-to", "16"],
    "noise": ["--out", "f.toml"],
}  # fmt: skip

# a command line of every command that reads user settings, without the settings
LINES = {
    ("run", "lift"): ["run", "lift", "--rig", "simulated", "--pace", "max"],
    ("run", "tap"): ["run", "tap", "--rig", "simulated", "--pace", "max", "--trials", "1"],
    ("run", "acquire"): ["run", "acquire", "--rig", "simulated", "--pace", "max"],
    ("ros",): ["ros", "--rig", "simulated"],
    ("config",): ["config"],
    ("doctor",): ["doctor", "--rig", "simulated"],
    ("emulate",): ["emulate"],
    ("release",): ["release"],
    **{("gripper", name): ["gripper", name] for name in GRIPPER},
    **{("arm", name): ["arm", name] for name in ARM},
    **{("tactile", name): ["tactile", name] for name in (*TACTILE, "identify")},
    **{("calibrate", name): ["calibrate", name, *more] for name, more in CALIBRATE.items()},
    ("replay",): ["replay", "--tactile", "strokes.csv", "--detector", "energy"],
    ("detector", "evaluate"): ["detector", "evaluate", "energy", "--recording", "strokes.csv"],
    ("detector", "tune"): ["detector", "tune", "energy", "--data", "sets"],
    ("campaign", "run"): ["campaign", "run", "c.toml", "--jobs", "1", "--out", "c.sqlite"],
}


def commands_with_settings() -> dict[tuple[str, ...], set[str]]:
    found = {}
    for words, parser in verbs(build_parser()):
        options = {text for action in parser._actions for text in action.option_strings}
        if options & {"--config", "--set"}:
            found[words] = options
    return found


@pytest.mark.parametrize("layer", ["--config", "GRASP_CONFIG", "--set"])
def test_options_of_the_command_line_are_refused_in_files_and_assignments(
    layer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], devices: list[str],
) -> None:  # fmt: skip
    settable = commands_with_settings()
    file = tmp_path / "lab.toml"
    stroke_csv(tmp_path / "strokes.csv")
    (tmp_path / "c.toml").write_text('name = "c"\nobjects = ["can"]\nrepetitions = 1\n')
    monkeypatch.chdir(tmp_path)
    lift = ("run", "lift")
    cases = [*((words, CHOICES[0]) for words in LINES), *((lift, choice) for choice in CHOICES)]
    for words, choice in cases:
        if ("--set" if layer == "--set" else "--config") not in settable[words]:
            continue
        file.write_text(f"{choice}\n{LAB}")
        more = {"--config": ["--config", str(file)], "GRASP_CONFIG": [], "--set": ["--set", choice]}
        if layer == "GRASP_CONFIG":
            monkeypatch.setenv("GRASP_CONFIG", str(file))
        code = main([*LINES[words], *more[layer]])
        output = "".join(capsys.readouterr())
        assert code == 2, (words, choice, output)
        assert "is no setting" in output, (words, choice)
        assert "choose it with --" in output, (words, choice)
        assert devices == [], (words, choice)


# Rig files


@pytest.fixture
def lab_rig(tmp_path: Path) -> str:
    """Settings file of a lab with a misleading name."""
    file = tmp_path / "simulated.toml"
    file.write_text('rig = "hardware"\n' + LAB)
    return str(file)


@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_rig_file_for_real_devices_is_hardware_under_any_name(
    scenario: str, lab_rig: str, tmp_path: Path, devices: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    words = ["run", scenario, "--rig", lab_rig, "--runs", str(tmp_path / "runs")]
    assert main(words) == 2
    assert "--confirm-motion" in capsys.readouterr().err
    config = load_config("can", lab_rig, "energy")
    assert config.rig == "hardware"
    with pytest.raises(UsageError, match="may not open the rig hardware"):
        opening.open_rig(config, 0, paced=False).__enter__()
    for call in (grasp.lift, grasp.tap):
        with pytest.raises(UsageError, match="moves no real devices"):
            call(rig=lab_rig)
    assert devices == []


WITH_A_RIG = {
    ("run", "lift"): [], ("run", "tap"): [], ("run", "acquire"): [], ("config",): [], ("ros",): [],
    ("release",): [], ("doctor",): [],
    **{("gripper", name): [] for name in GRIPPER}, ("status",): ["arm"],
    ("arm", "step"): ["--z", "1"], ("arm", "back"): ["run"], ("arm", "stop"): [],
    **{("tactile", n): [] for n in TACTILE},
    **{("calibrate", name): more for name, more in CALIBRATE.items()},
}  # fmt: skip
READ_ONLY = {  # no device replies
    ("doctor",), ("status",), ("arm", "stop"),
    *(("tactile", name) for name in TACTILE),
}  # fmt: skip


def test_no_command_opens_real_devices_of_a_rig_file_without_a_confirmation(
    lab_rig: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    devices: list[str], capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    found = {
        words
        for words, parser in verbs(build_parser())
        if any("--rig" in action.option_strings for action in parser._actions)
    }
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "result.json").write_text('{"rig": "hardware", "home_m": [0, 0, 0]}')
    assert found == set(WITH_A_RIG)  # every command with --rig is tried here
    expected = {("config",): 0, **dict.fromkeys(READ_ONLY, 3)}
    for words, more in WITH_A_RIG.items():
        code = main([*words, *more, "--rig", lab_rig])
        assert "Traceback" not in "".join(capsys.readouterr()), words
        assert code == expected.get(words, 2), words
        assert devices == [], words


# Library calls


@pytest.mark.parametrize(
    "call",
    [
        lambda c: lift.run(c.for_lift(), 0, None),
        lambda c: tap.run(c.for_tap(), 0, None),
        lambda c: list(run_series(tap, c.for_tap(), range(2), TrialContext())),
        lambda c: opening.open_rig(c, 0, paced=False).__enter__(),
    ],
)
def test_library_opens_no_real_device_without_a_permit(call: Any, devices: list[str]) -> None:
    with pytest.raises(UsageError, match="may not open the rig hardware"):
        call(hardware_lift())
    assert devices == []


def test_real_devices_are_opened_with_a_permit(devices: list[str]) -> None:
    with pytest.raises(AssertionError, match="real devices were opened"):
        opening.open_rig(hardware_lift(), 0, False, MotionPermit("x")).__enter__()
    assert devices == ["hardware"]


# Addresses and calibration


@pytest.mark.parametrize("left_out", ["gripper", "modbus", "usb", "ur"])
def test_hardware_has_no_default_address_and_no_default_calibration(
    left_out: str, devices: list[str]
) -> None:
    left = ("gripper", "calibration") if left_out == "gripper" else (left_out,)
    given = [word for word in LAB_WORDS if not word.startswith(left)]
    config = load_config("can", "hardware", None, None, given)
    with pytest.raises(ConfigError) as refused:
        check_devices(config)
    assert left_out in refused.value.message
    with pytest.raises(ConfigError):
        opening.open_rig(config, 0, False, MotionPermit("x")).__enter__()
    assert devices == []


def test_simulated_and_emulated_rigs_need_no_permit() -> None:
    for rig in ("simulated", "emulated"):
        assert permit(load_config("can", rig, "energy"), False, None, ()) is None
