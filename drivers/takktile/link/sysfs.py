"""Fingertip boards on this machine's USB, as Linux lists them: nothing is opened."""

import os
from collections.abc import Iterator
from pathlib import Path

import msgspec

from drivers.takktile.protocol import PRODUCT_ID, VENDOR_ID

RULE_FILE = "/etc/udev/rules.d/60-takktile.rules"

RULE = (
    f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{VENDOR_ID:04x}", ATTR{{idProduct}}=="{PRODUCT_ID:04x}",'
    ' MODE="0660", TAG+="uaccess"'
)

INSTALL = (
    f"echo '{RULE}' | sudo tee {RULE_FILE} && sudo udevadm control --reload && "
    "sudo udevadm trigger --subsystem-match=usb"
)


DEVICES = Path("/sys/bus/usb/devices")
IDS = f"{VENDOR_ID:04x}:{PRODUCT_ID:04x}"


class BoardNode(msgspec.Struct, frozen=True):
    """One board: its node, its serial number (empty: none), and whether this user may open it."""

    node: str
    serial: str
    allowed: bool


def boards(devices: Path = DEVICES) -> Iterator[BoardNode]:
    """Those that are plugged in."""
    for entry in sorted(devices.glob("*")):
        try:
            ids = ":".join((entry / name).read_text().strip() for name in ("idVendor", "idProduct"))
            bus, number = (int((entry / name).read_text()) for name in ("busnum", "devnum"))
            if ids != IDS:
                continue
            serial = entry / "serial"
            known = serial.read_text().strip() if serial.is_file() else ""
        except (OSError, ValueError):
            continue
        node = f"/dev/bus/usb/{bus:03d}/{number:03d}"
        yield BoardNode(node, known, os.access(node, os.R_OK | os.W_OK))
