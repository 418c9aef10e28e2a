"""The emulated bus through pyusb's interface, as any pyusb program uses it."""

import errno

import pytest
import usb.core
import usb.util

VENDOR_IN = 0xC0
SCAN, TIMER = 0x5C, 0xC7


def start(device, ticks: int = 375) -> None:
    assert device.ctrl_transfer(VENDOR_IN, TIMER, ticks, 0xFF, 1, 1000)[0] == 1


def test_descriptors_are_those_of_the_firmware(device):
    assert (device.idVendor, device.idProduct) == (0x59E3, 0x74C7)
    assert (device.bcdUSB, device.bcdDevice, device.bDeviceClass) == (0x0110, 0x0200, 0xFF)
    assert device.bMaxPacketSize0 == 64
    config = device.get_active_configuration()
    assert (config.wTotalLength, config.bMaxPower) == (32, 250)
    ends = [(e.bEndpointAddress, e.bmAttributes, e.wMaxPacketSize) for e in config[(0, 0)]]
    assert ends == [(0x81, 2, 64), (0x02, 2, 32)]


def test_strings_are_read_over_the_control_endpoint(device):
    assert device.manufacturer == "The Biorobotics Lab"
    assert device.product == "TakkTile"
    assert len(device.serial_number) == 22
    assert "wMaxPacketSize" in str(device)  # walks everything


def test_a_program_may_set_the_configuration_that_is_set(device):
    device.set_configuration()
    assert not device.is_kernel_driver_active(0)
    usb.util.claim_interface(device, 0)
    device.set_interface_altsetting(0, 0)
    device.clear_halt(0x81)


def test_a_board_that_was_not_started_times_out(device):
    with pytest.raises(usb.core.USBTimeoutError) as caught:
        device.read(0x81, 512, 30)
    assert caught.value.errno == errno.ETIMEDOUT
    assert caught.value.backend_error_code == -7
