"""``UsbLink``: errors of libusb become errors with a remedy."""

import errno

import pytest
import usb.core

from drivers.errors import DeviceFault, LinkLost
from drivers.takktile.emulator.bus import EmulatedBus
from drivers.takktile.link import UsbLink
from drivers.takktile.protocol import UsbRequest


@pytest.fixture
def link(bench):
    made = bench.connect()
    yield made
    made.close()


def start(link: UsbLink) -> None:
    assert link.control(UsbRequest.TIMER, 375, 0xFF, 1, 0) == b"\x01"


def test_a_stall_is_a_device_fault(bench, link):
    with pytest.raises(DeviceFault, match="STALL"):
        link.control(0x42, 0, 0, 8, 0)
    start(link)
    bench.inject("stall")
    with pytest.raises(DeviceFault, match="STALL"):
        link.bulk_read(512, 0)
    link.clear_halt()
    assert len(link.bulk_read(512, 0).data) == 72


def test_a_hung_board_must_be_replugged(link):
    start(link)
    with pytest.raises(DeviceFault, match="hangs") as caught:
        link.control(UsbRequest.SCAN, 0, 0, 64, 0)
    assert "unplug the board, plug it in" in caught.value.remedy


def test_an_unplugged_board_is_a_lost_link_and_stays_one(bench, link):
    start(link)
    bench.inject("unplug")
    with pytest.raises(LinkLost, match="unplugged"):
        link.bulk_read(512, 0)
    bench.inject("replug")
    with pytest.raises(LinkLost, match="has been closed"):
        link.bulk_read(512, 0)
    again = bench.connect(link.serial)
    start(again)
    again.close()


def test_a_board_can_be_selected_by_serial_number(bench, link):
    serial = link.serial
    link.close()
    bench.connect(serial).close()
    with pytest.raises(LinkLost, match=rf"serial number 42 .*found: {serial}"):
        bench.connect("42")


def test_a_board_in_use_names_the_other_program(bench, link):
    with pytest.raises(LinkLost, match="another program uses the tactile board"):
        bench.connect()


def test_missing_permission_names_the_udev_rule(bench, monkeypatch):
    def refuse(self, dev):
        raise usb.core.USBError("Access denied", -3, errno.EACCES)

    monkeypatch.setattr(EmulatedBus, "open_device", refuse)
    with pytest.raises(LinkLost, match="may not open") as caught:
        bench.connect()
    assert "grasp doctor" in caught.value.remedy


@pytest.mark.parametrize(
    ("error", "message", "remedy"),
    [
        (usb.core.USBError("Configuration not set"), "no USB configuration", "own power supply"),
        (usb.core.USBError("Overflow", -8, errno.EOVERFLOW), "failed: Overflow", "replug it"),
        (usb.core.USBError("something new"), "failed: something new", "replug it"),
    ],
)
def test_a_usb_error_is_reported_as_text_with_a_remedy(link, monkeypatch, error, message, remedy):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(usb.core.Device, "read", fail)
    with pytest.raises(DeviceFault, match=message) as caught:
        link.bulk_read(64, 0)
    assert remedy in caught.value.remedy
    assert "Errno" not in str(caught.value)
