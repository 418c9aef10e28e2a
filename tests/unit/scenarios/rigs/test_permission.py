"""Real devices are opened by a verb made for a lab, told so on its command line, and by nobody
else, whatever files and settings say."""

import argparse
import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

import grasp
from drivers.errors import ConfigError, UsageError
from grasp.cli.main import build_parser, main
from scenarios.acquire.acquire import run as acquire
from scenarios.acquire.config import load_acquire_config
from scenarios.acquire.press import motion
from scenarios.acquire.session import open_acquire_rig
from scenarios.campaign.config import load_config
from scenarios.campaign.spec import CampaignSpec, Combination, combinations, trials
from scenarios.campaign.worker import run_trial
from scenarios.lift import lift
from scenarios.rigs import opening
from scenarios.rigs import opening as hardware_room
from scenarios.rigs.permission import MotionPermit, check_devices, permit, release_command
from scenarios.tap import tap
from scenarios.trial.series import Bench
from tests.calibrations import PRESSED
from tests.unit.grasp.cli.test_recordings_cli import stroke_csv

ROOT = Path(__file__).parents[4]
# addresses where nobody is; a test that came so far would fail for that reason, not move anything
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
LAB_VERBS = {
    "run",
    "release",
    "gripper",
    "arm",
    "calibrate",
}  # may move real devices, with --confirm-motion


@pytest.fixture(autouse=True)
def devices(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Whoever comes so far as to open real devices is noted, and comes no further."""
    opened: list[str] = []

    def wired_devices(config: Any, clock: Any) -> Any:
        opened.append(config.rig)
        raise AssertionError("real devices were opened")

    monkeypatch.setattr(hardware_room, "wired_devices", wired_devices)
    return opened


def hardware_lift() -> Any:
    return load_config("can", "hardware", "energy", None, LAB_WORDS)


# Every verb


def verbs(parser: argparse.ArgumentParser) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command of the parser with its own parser."""
    nested = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not nested:
        yield (), parser
    for action in nested:
        for name, sub in action.choices.items():
            yield from (((name, *rest), leaf) for rest, leaf in verbs(sub))


GRIPPER = ("status", "activate", "open", "close", "step")
ARM = ("status", "step", "stop")
TACTILE = ("watch", "rest")
CALIBRATE = {
    "force": ["--out", "f.toml"], "hand": ["--out", "f.toml", "--up-to", "16"],
    "noise": ["--out", "f.toml"],
}  # fmt: skip

# a command line of every verb that reads settings of one's own, less the settings
LINES = {
    ("run", "lift"): ["run", "lift", "--rig", "simulated", "--pace", "max"],
    ("run", "tap"): ["run", "tap", "--rig", "simulated", "--pace", "max", "--trials", "1"],
    ("run", "acquire"): ["run", "acquire", "--rig", "simulated", "--pace", "max"],
    ("config", "show"): ["config", "show"],
    ("doctor",): ["doctor", "--rig", "simulated"],
    ("emulate",): ["emulate"],
    ("release",): ["release", "--rig", "simulated"],
    **{("gripper", name): ["gripper", name] for name in GRIPPER},
    **{("arm", name): ["arm", name] for name in ARM},
    **{("tactile", name): ["tactile", name] for name in (*TACTILE, "identify")},
    **{("calibrate", name): ["calibrate", name, *more] for name, more in CALIBRATE.items()},
    ("replay",): ["replay", "--tactile", "strokes.csv", "--detector", "energy"],
    ("detector", "evaluate"): ["detector", "evaluate", "energy", "--recording", "strokes.csv"],
    ("detector", "tune"): ["detector", "tune", "energy"],
    ("campaign", "run"): ["campaign", "run", "c.toml", "--jobs", "1", "--out", "c.sqlite"],
}


def with_own_settings() -> dict[tuple[str, ...], set[str]]:
    found = {}
    for words, parser in verbs(build_parser()):
        options = {text for action in parser._actions for text in action.option_strings}
        if options & {"--config", "--set"} and words != ("world", "plan"):  # settings of its own
            found[words] = options
    return found


def test_only_verbs_made_for_a_lab_can_be_confirmed() -> None:
    confirmed = {
        words[0]
        for words, parser in verbs(build_parser())
        if any("--confirm-motion" in action.option_strings for action in parser._actions)
    }
    assert confirmed == LAB_VERBS


def test_only_verbs_made_for_a_lab_ask_for_a_permit() -> None:
    asking = set()
    for package in ("grasp", "drivers", "detector", "scenarios"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                name = getattr(getattr(node, "func", None), "id", "")
                if name in ("permit", "motion_permit", "leave_to_move", "MotionPermit"):
                    asking.add(str(path.relative_to(ROOT)))
    # where they are made
    own = {"scenarios/rigs/permission.py", "grasp/cli/options.py", "grasp/cli/lab.py"}
    assert asking - own == {f"grasp/cli/{verb}.py" for verb in LAB_VERBS}


def test_every_verb_with_settings_of_one_s_own_is_tried_here() -> None:
    assert set(with_own_settings()) == set(LINES)


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("words", LINES, ids=" ".join)
@pytest.mark.parametrize("layer", ["--config", "GRASP_CONFIG", "--set"])
def test_no_file_and_no_assignment_chooses_what_the_command_line_alone_may(
    layer: str, words: tuple[str, ...], choice: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], devices: list[str],
) -> None:  # fmt: skip
    options = with_own_settings()[words]
    if layer != "GRASP_CONFIG" and layer not in options:
        pytest.skip("has no such option")
    if layer == "GRASP_CONFIG" and "--config" not in options:
        pytest.skip("reads no file")
    file = tmp_path / "lab.toml"
    file.write_text(f"{choice}\n{LAB}")
    stroke_csv(tmp_path / "strokes.csv")
    (tmp_path / "c.toml").write_text('name = "c"\nobjects = ["can"]\nrepetitions = 1\n')
    monkeypatch.chdir(tmp_path)
    more = {"--config": ["--config", str(file)], "GRASP_CONFIG": [], "--set": ["--set", choice]}
    if layer == "GRASP_CONFIG":
        monkeypatch.setenv("GRASP_CONFIG", str(file))
    code = main([*LINES[words], *more[layer]])
    said = "".join(capsys.readouterr())
    assert code == 2, said
    assert "is no setting" in said
    assert "choose it with --" in said
    assert devices == []


# Campaigns


def campaign(**fields: Any) -> CampaignSpec:
    return CampaignSpec(name="c", objects=("can",), detectors=("energy",), **fields)


@pytest.mark.parametrize(
    "fields",
    [{"settings": ('rig="hardware"', *LAB_WORDS)}, {"sweep": {"rig": ("simulated", "hardware")}},
     {"settings": ("detector_name=psd",)}, {"sweep": {"profile": ("paper",)}}],
)  # fmt: skip
def test_campaign_file_chooses_no_rig(fields: Any) -> None:
    with pytest.raises(ConfigError, match="is no setting"):
        combinations(campaign(**fields))


def test_campaign_does_not_follow_the_environment_to_real_devices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, devices: list[str]
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text('rig = "hardware"\n' + LAB)
    monkeypatch.setenv("GRASP_CONFIG", str(file))
    (tmp_path / "c.toml").write_text('name = "c"\nobjects = ["can"]\nrepetitions = 1\n')
    out = tmp_path / "c.sqlite"
    assert main(["campaign", "run", str(tmp_path / "c.toml"), "--out", str(out)]) == 2
    assert devices == []


@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_trial_of_a_campaign_refuses_real_devices_though_its_settings_name_them(
    scenario: str, devices: list[str]
) -> None:
    whole = hardware_lift()
    config = whole.for_lift() if scenario == "lift" else whole.for_tap()
    task = next(trials(campaign(repetitions=1), [Combination(scenario, {}, config)]))
    row = run_trial(task).row
    assert row.status == "error"
    assert "may not open the rig hardware" in (row.error or "")
    assert devices == []


@pytest.mark.parametrize("said", ["config", "rig"])
def test_campaign_takes_a_lab_s_file_to_no_real_device(
    said: str, tmp_path: Path, devices: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Not as settings, and there is no place for a rig."""
    (tmp_path / "lab.toml").write_text('rig = "hardware"\n' + LAB)
    word = '["lab.toml"]' if said == "config" else '"lab.toml"'
    file = tmp_path / "c.toml"
    file.write_text(f'name = "c"\nobjects = ["can"]\nrepetitions = 1\n{said} = {word}\n')
    assert main(["campaign", "run", str(file), "--out", str(tmp_path / "c.sqlite")]) == 2
    assert devices == []
    with pytest.raises(ConfigError):
        grasp.campaign(file, jobs=0)
    assert devices == []


# Rigs of one's own


@pytest.fixture
def lab_rig(tmp_path: Path) -> str:
    """The file of a lab, by a name that tells nothing."""
    file = tmp_path / "simulated.toml"
    file.write_text('rig = "hardware"\n' + LAB)
    return str(file)


@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_a_rig_file_for_real_devices_is_hardware_under_any_name(
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
    ("run", "lift"): [], ("run", "tap"): [], ("run", "acquire"): [], ("config", "show"): [],
    ("release",): [], ("doctor",): [],
    **{("gripper", name): [] for name in GRIPPER}, ("arm", "status"): [],
    ("arm", "step"): ["--z", "1"], ("arm", "stop"): [], **{("tactile", n): [] for n in TACTILE},
    **{("calibrate", name): more for name, more in CALIBRATE.items()},
}  # fmt: skip
LOOKS = {  # nobody answers
    ("doctor",), ("gripper", "status"), ("arm", "status"), ("arm", "stop"),
    *(("tactile", name) for name in TACTILE),
}  # fmt: skip


def test_every_verb_that_takes_a_rig_is_tried_here() -> None:
    found = {
        words
        for words, parser in verbs(build_parser())
        if any("--rig" in action.option_strings for action in parser._actions)
    }
    assert found == set(WITH_A_RIG)


@pytest.mark.parametrize("words", WITH_A_RIG, ids=" ".join)
def test_no_verb_opens_real_devices_of_a_rig_file_unconfirmed(
    words: tuple[str, ...], lab_rig: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    devices: list[str], capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    code = main([*words, *WITH_A_RIG[words], "--rig", lab_rig])
    assert "Traceback" not in "".join(capsys.readouterr())
    expected = {("config", "show"): 0, **dict.fromkeys(LOOKS, 3)}
    assert code == expected.get(words, 2)
    assert devices == []


def test_a_rig_file_with_a_lab_s_addresses_that_is_like_a_simulated_one_reaches_nobody(
    tmp_path: Path, devices: list[str]
) -> None:
    file = tmp_path / "lab.toml"
    file.write_text('rig = "simulated"\n' + LAB)
    assert grasp.lift(rig=str(file), detector="energy").result.rig == "simulated"
    assert devices == []


def test_the_way_out_names_the_rig_s_file(lab_rig: str) -> None:
    leave = permit(load_config("can", lab_rig, "energy"), True, None, (), lab_rig)
    assert leave is not None
    assert leave.release == f"grasp release --rig {lab_rig} --confirm-motion"


# Library calls


@pytest.mark.parametrize(
    "call",
    [
        lambda c: lift.run(c.for_lift(), 0, None),
        lambda c: tap.run(c.for_tap(), 0, None),
        lambda c: list(tap.run_series(c.for_tap(), range(2), Bench())),
        lambda c: opening.open_rig(c, 0, paced=False).__enter__(),
    ],
)
def test_library_call_without_a_permit_opens_no_real_device(call: Any, devices: list[str]) -> None:
    with pytest.raises(UsageError, match="may not open the rig hardware"):
        call(hardware_lift())
    assert devices == []


def test_acquisition_without_a_permit_opens_no_real_device(
    tmp_path: Path, devices: list[str]
) -> None:
    words = [word for word in LAB_WORDS if word.startswith(("usb", "ur"))]
    config = load_acquire_config("planar", "hardware", None, words)
    with pytest.raises(UsageError, match="may not open"):
        open_acquire_rig(config, 0, paced=False).__enter__()
    with pytest.raises(UsageError, match="may not open"):
        acquire(config, motion("0", 0.05, 1.0), 0, 1.0, tmp_path, False, lambda sample: None)
    assert devices == []


@pytest.mark.parametrize("pretended", [True, "yes", object()])
def test_what_is_no_permit_does_not_pass_for_one(pretended: Any, devices: list[str]) -> None:
    with pytest.raises(UsageError), opening.open_rig(hardware_lift(), 0, False, pretended):
        pass
    assert devices == []


def test_rig_that_nobody_knows_is_not_taken_for_hardware(devices: list[str]) -> None:
    config = msgspec.structs.replace(hardware_lift(), rig="zzz")
    with (
        pytest.raises(ConfigError, match="unknown"),
        opening.open_rig(config, 0, False, MotionPermit("x")),
    ):
        pass
    assert devices == []


def test_with_a_permit_real_devices_are_opened(devices: list[str]) -> None:
    with pytest.raises(AssertionError, match="real devices were opened"):
        opening.open_rig(hardware_lift(), 0, False, MotionPermit("x")).__enter__()
    assert devices == ["hardware"]


# Confirmation


@pytest.mark.parametrize("scenario", ["lift", "tap", "acquire"])
def test_hardware_moves_on_a_confirmation_alone(
    scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], devices: list[str]
) -> None:
    words = ["run", scenario, "--rig", "hardware", "--runs", str(tmp_path / "runs")]
    own = [text for text in LAB_WORDS if scenario != "acquire" or text.startswith(("usb", "ur"))]
    words += [word for text in own for word in ("--set", text)]
    assert main(words) == 2
    assert "--confirm-motion" in capsys.readouterr().err
    assert devices == []


# Addresses and calibration


@pytest.mark.parametrize("left_out", ["gripper", "modbus", "usb", "ur"])
@pytest.mark.parametrize("profile", ["default", "paper"])
@pytest.mark.parametrize("name", ["can", "ball", "football", "foam", "box", "cardboard"])
def test_hardware_has_no_default_address_and_no_default_calibration(
    left_out: str, profile: str, name: str, devices: list[str]
) -> None:
    left = ("gripper", "calibration") if left_out == "gripper" else (left_out,)
    given = [word for word in LAB_WORDS if not word.startswith(left)]
    config = load_config(name, "hardware", None, None, given, profile)
    with pytest.raises(ConfigError) as told:
        check_devices(config)
    assert left_out in told.value.message
    with pytest.raises(ConfigError):
        opening.open_rig(config, 0, False, MotionPermit("x")).__enter__()
    assert devices == []


def test_serial_line_has_no_default_either() -> None:
    words = ("gripper.link=rtu", *LAB_WORDS)
    with pytest.raises(ConfigError, match="serial_port"):
        check_devices(load_config("can", "hardware", "energy", None, words))


def test_acquisition_needs_no_gripper() -> None:
    words = [word for word in LAB_WORDS if word.startswith(("usb", "ur"))]
    check_devices(load_acquire_config("planar", "hardware", None, words))


# The way out


def test_command_that_opens_the_hand_names_rig_file_and_the_settings_that_matter() -> None:
    words = ("modbus.host=10.0.0.7", "object.half_width_m=0.04", "gripper.link=tcp")
    assert release_command("hardware", Path("my lab.toml"), words) == (
        "grasp release --rig hardware --confirm-motion --config 'my lab.toml' "
        "--set modbus.host=10.0.0.7 --set gripper.link=tcp"
    )


def test_simulated_rigs_need_no_permit_and_advise_nothing() -> None:
    for rig in ("simulated", "emulated"):
        assert permit(load_config("can", rig, "energy"), False, None, ()) is None
