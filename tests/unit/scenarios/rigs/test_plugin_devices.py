"""Devices of other packages: only the rig hardware opens them, with a permit; an error of theirs
is reported as one line."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import grasp
from drivers.errors import ConfigError, LinkLost, UsageError
from grasp.cli.main import main
from grasp.run.clock import WallClock
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs import config as rig_config
from scenarios.rigs import opening
from scenarios.rigs.permission import MotionPermit, check_devices
from scenarios.rigs.wired import acknowledgements, wired_devices

PACKAGE = """
from contextlib import contextmanager
from drivers.errors import LinkLost
opened = []

@contextmanager
def hand(settings, now):
    opened.append((dict(settings), now() >= 0))
    yield "a hand"
    opened.append("closed")

def bad(settings, now):
    raise ValueError("no such port")

def leaves(settings, now):
    raise SystemExit(0)

def lost(settings, now):
    raise LinkLost("no reply", "switch it on")
"""
ALL = ("devices.gripper=acme", "devices.arm=acme", "devices.fingertips=acme",
       "gripper.calibration=manual")  # fmt: skip


@pytest.fixture(autouse=True)
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Install a package for the test; returns the list of devices that it opens."""
    name = f"acme_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(PACKAGE)
    metadata = tmp_path / "acme-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        f"[grasp.grippers]\nacme = {name}:hand\nbad = {name}:bad\nlost = {name}:lost\n"
        f"leaves = {name}:leaves\n"
        f"[grasp.arms]\nacme = {name}:hand\n[grasp.fingertips]\nacme = {name}:hand\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    rig_config.plugin_devices.cache_clear()
    found: list[Any] = __import__(name).opened
    yield found
    rig_config.plugin_devices.cache_clear()


def lab(*words: str) -> RunConfig:
    return load_config("can", "hardware", "energy", None, words)


def test_plugin_devices_replace_the_built_in_ones_and_are_closed_again(opened: list[Any]) -> None:
    config = lab(*ALL, 'devices.gripper_settings={port="x"}')
    check_devices(config)  # needs no addresses
    with wired_devices(config, WallClock()) as devices:
        assert devices == ("a hand", "a hand", "a hand")
        assert ({"port": "x"}, True) in opened
        assert list(acknowledgements(devices[2])()) == []
    assert opened.count("closed") == 3


@pytest.mark.parametrize(
    ("device", "rig"), [("gripper", "simulated"), ("arm", "emulated"), ("fingertips", "simulated")]
)
def test_plugin_device_is_refused_on_other_rigs_than_hardware(
    device: str, rig: str, tmp_path: Path, opened: list[Any]
) -> None:
    word = f"devices.{device}=acme"
    with pytest.raises(ConfigError, match=f"--set: devices.{device}: .* counts as real"):
        load_config("can", rig, "energy", None, [word])
    file = tmp_path / "rig.toml"
    file.write_text(f'rig = "{rig}"\n[devices]\n{device} = "acme"\n')
    with pytest.raises(ConfigError, match=rf"{file}: devices.{device}: .* counts as real"):
        load_config("can", str(file), "energy")
    with pytest.raises(ConfigError, match="counts as real"):
        grasp.lift(rig=rig, settings={f"devices.{device}": "acme"})
    campaign = tmp_path / "c.toml"
    campaign.write_text(f'name = "c"\nobjects = ["can"]\nsettings = ["{word}"]\n')
    with pytest.raises(ConfigError, match="counts as real"):
        grasp.campaign(campaign, jobs=0)
    assert opened == []


def test_no_plugin_device_is_opened_without_a_permit(
    tmp_path: Path, opened: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UsageError, match="may not open the rig hardware"):
        opening.open_rig(lab(*ALL), 0, paced=False).__enter__()
    with pytest.raises(UsageError, match="moves no real devices"):
        grasp.lift(rig="hardware", settings=dict(w.split("=") for w in ALL))
    words = [word for text in ALL for word in ("--set", text)]
    assert main(["run", "lift", "--rig", "hardware", *words, "--runs", str(tmp_path)]) == 2
    assert "--confirm-motion" in capsys.readouterr().err
    assert opened == []


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("zzz", ConfigError, "unknown: 'zzz'"),
        ("bad", UsageError, "cannot be opened: ValueError: no such port"),
        ("leaves", UsageError, "cannot be opened: SystemExit: 0"),
        ("lost", LinkLost, "no reply"),
    ],
)
def test_error_at_opening_is_reported_as_one_line(
    name: str, error: type[Exception], message: str
) -> None:
    config = lab(*ALL[1:], f"devices.gripper={name}")
    with (
        pytest.raises(error, match=message),
        opening.open_rig(config, 0, False, MotionPermit("x")),
    ):
        pass
