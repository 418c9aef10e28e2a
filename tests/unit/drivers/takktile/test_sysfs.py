"""Boards as Linux lists them."""

from pathlib import Path

from drivers.takktile.link.sysfs import boards


def device(folder: Path, **files: str) -> None:
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text + "\n")


def test_boards_are_listed_and_other_devices_are_not(tmp_path: Path) -> None:
    ours = {"idVendor": "59e3", "idProduct": "74c7", "busnum": "1"}
    device(tmp_path / "1-1", **ours, devnum="4", serial="4A45")
    device(tmp_path / "1-2", **ours, devnum="5")
    device(tmp_path / "1-3", **{**ours, "idVendor": "1d6b"}, devnum="1")
    device(tmp_path / "1-4", idVendor="59e3")
    found = list(boards(tmp_path))
    assert [(b.node, b.serial) for b in found] == [
        ("/dev/bus/usb/001/004", "4A45"), ("/dev/bus/usb/001/005", ""),
    ]  # fmt: skip


def test_machine_without_a_bus_has_none(tmp_path: Path) -> None:
    assert list(boards(tmp_path / "none")) == []
