"""`grasp emulate`: allowed addresses, and typed actions as requests to the cell."""

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import msgspec
import pytest

from drivers.addresses import check_host
from drivers.errors import LinkLost, UsageError
from grasp.cli import emulate
from grasp.cli.device_commands import EmulateOptions
from grasp.cli.emulate import Console, check_address, lab_settings
from scenarios.campaign.config import load_config

ADDRESS = f"127.{230 + os.getpid() % 20}.{os.getpid() // 20 % 250}.2"  # not used by other tests


def test_an_address_beyond_loopback_needs_its_option_and_is_numeric() -> None:
    for host, beyond, replies in (
        *(
            (host, False, "is no loopback address")
            for host in ("0.0.0.0", "192.168.0.1", "foo", "")
        ),
        ("localhost", False, "is no loopback address but a name"),
        *((host, True, "is no address but a name") for host in ("localhost", "foo")),
        *((host, beyond, "is an IPv6 address") for host in ("::1", "fe80::1") for beyond in (0, 1)),
        (None, True, "needs --host"),
        ("127.0.0.1", True, "ur_rtde skips a check there"),
    ):
        with pytest.raises(UsageError, match=replies):
            check_address(host, bool(beyond))
            pytest.fail(f"listens at {host}")
    check_host("0.0.0.0", beyond_loopback=True)
    check_host("127.0.0.2", beyond_loopback=False)
    check_address(None, False)


def test_written_settings_point_the_rig_hardware_at_the_cell(tmp_path: Path) -> None:
    endpoints = {
        "gripper": {"host": ADDRESS, "port": 5020}, "tactile": {"url": f"tcp://{ADDRESS}:5021"},
        "arm": {"host": ADDRESS},
    }  # fmt: skip
    file = tmp_path / "lab.toml"
    file.write_text(lab_settings(endpoints))
    config = load_config("can", "hardware", "energy", [file])
    assert (config.modbus.host, config.modbus.port, config.ur.host) == (ADDRESS, 5020, ADDRESS)
    assert config.usb.url == f"tcp://{ADDRESS}:5021"
    assert config.modbus.timeout_s == 1.0  # of a busy machine


def test_settings_are_written_over_older_ones_and_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served: list[str] = []
    monkeypatch.setattr(emulate, "serve", lambda *_: served.append(file.read_text()))
    monkeypatch.setattr(emulate, "Console", Mock())
    monkeypatch.setattr(emulate, "end_on_signals", Mock())
    file = tmp_path / "lab.toml"
    args = EmulateOptions(write=file)
    file.write_text("[modbus]\nhost = 'mine'\n")
    with pytest.raises(UsageError, match="exists already"):
        emulate.emulate(args)
    settings = lab_settings({"gripper": {"host": "", "port": 0}, "tactile": {"url": ""},
                             "arm": {"host": ""}})  # fmt: skip
    file.write_text(settings)
    assert emulate.emulate(args) == 0 and served == [settings]


def test_a_used_port_is_refused_before_anything_is_compiled() -> None:
    with socket.create_server((ADDRESS, 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(LinkLost, match="in use") as caught:
            check_address(ADDRESS, False, port)
        assert "end the other cell" in caught.value.remedy
    check_address(ADDRESS, False, port)


# What is typed

TRUTH = {
    "normal_n": [0.0, 0.0, 0.0], "height_m": 0.05, "slip_distance_m": 0.003, "across_m": 0.004,
    "turn_rad": 0.0,
}  # fmt: skip


class Cell:
    """Records requests; raises an error for an unknown name."""

    def __init__(self) -> None:
        self.requests: list[dict[str, Any]] = []
        self.homeward: list[dict[str, Any]] = []  # replies on the way home

    def execute_request(self, request: dict[str, Any]) -> dict[str, Any]:
        self.requests.append(request)
        if request["verb"] == "fault" and request["name"] == "dance":
            raise ValueError("unknown fault 'dance'")
        if request["verb"] == "fault" and request["name"] == "unplug":
            return {"effect": "unplug: off the bus"}
        if request["verb"] == "press":
            msgspec.convert(request["taxel"], int)
        if request["verb"] == "home":
            return self.homeward.pop(0) if self.homeward else {"away_m": 0.0}
        return {"truth": TRUTH}


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Descriptor to which tests write typed input."""
    reading, writing = os.pipe()
    monkeypatch.setattr(emulate, "STDIN", reading)
    yield writing
    os.close(reading)


def printed(
    typed: int,
    lines: str,
    capsys: pytest.CaptureFixture[str],
    *homeward: dict[str, Any],
    settings: tuple[str, ...] = (),
) -> tuple[Cell, list[str]]:
    cell = Cell()
    config = load_config("can", "emulated", "energy", None, settings).for_tap()
    cell.homeward = list(homeward)
    console = Console(config, 0)
    console.listen(cell)  # type: ignore[arg-type]
    os.write(typed, lines.encode())
    os.close(typed)  # the end of the input ends the listening, and nothing else
    replies: list[str] = []
    while len(replies) < len(lines.split("\n")) - 1:
        time.sleep(0.005)
        replies += capsys.readouterr().err.splitlines()
    return cell, [line.removeprefix("cell: ") for line in replies]


def test_typed_actions_become_requests_to_the_cell(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = "place\nhome\nlook\ntap side\nfault gripper_delay seconds=0.2 times=3\n"
    cell, replies = printed(typed, lines, capsys)
    verbs = [request["verb"] for request in cell.requests]
    assert verbs == ["place", "home", "truth", "tap", "fault"]
    assert cell.requests[3]["direction"] == "side" and cell.requests[3]["impulse_n_s"] > 0.0
    assert cell.requests[4] == {
        "verb": "fault",
        "name": "gripper_delay",
        "seconds": 0.2,
        "times": 3,
    }
    assert replies[2] == "the object is not touched, 50 mm above the table, 5.0 mm from its mark"
    assert replies.count("done") == 4


def test_an_unknown_action_is_refused_with_the_known_ones(
    typed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = "dance\ntap below\nplace it\nfault dance\npress A pad\nplace\n"
    cell, replies = printed(typed, lines, capsys)
    assert "'dance' is no action" in replies[0]
    assert "Expected `int`" in replies[4]
    assert all("take (it away) | home (the arm)" in reply for reply in replies[:5])
    assert replies[5] == "done"
    assert [request["verb"] for request in cell.requests] == ["fault", "press", "place"]
