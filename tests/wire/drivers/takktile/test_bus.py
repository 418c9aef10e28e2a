"""The emulated bus through pyusb's interface, as any pyusb program uses it."""

import errno

import pytest
import usb.core
import usb.util

from drivers.takktile import protocol

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


def test_a_started_board_streams_frames_of_72_bytes(bench, device):
    start(device)
    for _ in range(20):
        frame = bytes(device.read(0x81, 512, 1000))
        assert protocol.parse_frame(frame, 18)[0].tolist() == bench.codes.tolist()


def test_a_board_that_was_not_started_times_out(device):
    with pytest.raises(usb.core.USBTimeoutError) as caught:
        device.read(0x81, 512, 30)
    assert caught.value.errno == errno.ETIMEDOUT
    assert caught.value.backend_error_code == -7


def test_a_stall_is_errno_32_and_ends_by_itself(bench, device):
    start(device)
    bench.inject("stall")
    with pytest.raises(usb.core.USBError) as caught:
        device.read(0x81, 512, 1000)
    assert caught.value.errno == errno.EPIPE
    device.clear_halt(0x81)
    assert len(device.read(0x81, 512, 1000)) == 72


def test_a_hung_board_times_out_on_both_endpoints(device):
    start(device)
    for _ in range(2):
        with pytest.raises(usb.core.USBTimeoutError):  # a scan while sampling hangs it
            device.ctrl_transfer(VENDOR_IN, SCAN, 0, 0, 64, 30)
    with pytest.raises(usb.core.USBTimeoutError):
        device.read(0x81, 512, 30)


def test_a_second_program_gets_busy_until_the_first_releases_the_board(bench, device):
    usb.util.claim_interface(device, 0)
    second = bench.find()
    for attempt in (
        lambda: usb.util.claim_interface(second, 0),
        lambda: second.read(0x81, 512, 30),
        second.set_configuration,
    ):
        with pytest.raises(usb.core.USBError) as caught:
            attempt()
        assert caught.value.errno == errno.EBUSY
    usb.util.dispose_resources(device)
    usb.util.claim_interface(second, 0)
    usb.util.dispose_resources(second)
