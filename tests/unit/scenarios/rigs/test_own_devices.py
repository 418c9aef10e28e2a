"""Devices that other packages offer: opened on the rig hardware alone, with a permit, and every
mistake of theirs is one line."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import grasp
from drivers.errors import ConfigError, LinkLost, UsageError
from grasp.cli.main import main
from grasp.clock import WallClock
from scenarios.campaign.config import RunConfig, load_config
from scenarios.rigs import config as rig_config
from scenarios.rigs import opening
from scenarios.rigs.permission import MotionPermit, check_devices
from scenarios.rigs.wired import acknowledgements, wired_devices

OFFER = """
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
    raise LinkLost("nobody answers", "switch it on")
"""
ALL = ("devices.gripper=acme", "devices.arm=acme", "devices.fingertips=acme",
       "gripper.calibration=manual")  # fmt: skip


@pytest.fixture(autouse=True)
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """A package that is installed for the test, and what it was asked to open."""
    name = f"acme_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(OFFER)
    told = tmp_path / "acme-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text(
        f"[grasp.grippers]\nacme = {name}:hand\nbad = {name}:bad\nlost = {name}:lost\n"
        f"leaves = {name}:leaves\n"
        f"[grasp.arms]\nacme = {name}:hand\n[grasp.fingertips]\nacme = {name}:hand\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    rig_config.offered_devices.cache_clear()
    found: list[Any] = __import__(name).opened
    yield found
    rig_config.offered_devices.cache_clear()


def lab(*words: str) -> RunConfig:
    return load_config("can", "hardware", "energy", None, words)


def test_they_are_opened_in_place_of_ours_and_closed_again(opened: list[Any]) -> None:
    config = lab(*ALL, 'devices.gripper_settings={port="x"}')
    check_devices(config)  # no address of ours is asked for
    with wired_devices(config, WallClock()) as devices:
        assert devices == ("a hand", "a hand", "a hand")
        assert ({"port": "x"}, True) in opened
        assert list(acknowledgements(devices[2])()) == []
    assert opened.count("closed") == 3


@pytest.mark.parametrize(
    ("device", "rig"), [("gripper", "simulated"), ("arm", "emulated"), ("fingertips", "simulated")]
)
def test_it_counts_as_real_whatever_it_is(
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


def test_without_a_permit_none_is_opened(
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
    ("name", "error", "told"),
    [
        ("zzz", ConfigError, "unknown: 'zzz'"),
        ("bad", UsageError, "cannot be opened: ValueError: no such port"),
        ("leaves", UsageError, "cannot be opened: SystemExit: 0"),
        ("lost", LinkLost, "nobody answers"),
    ],
)
def test_what_goes_wrong_as_it_is_opened_is_one_line(
    name: str, error: type[Exception], told: str
) -> None:
    config = lab(*ALL[1:], f"devices.gripper={name}")
    with (
        pytest.raises(error, match=told),
        opening.open_rig(config, 0, False, MotionPermit("x")),
    ):
        pass
