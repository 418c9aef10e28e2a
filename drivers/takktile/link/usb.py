"""A ``Link`` to a real board through pyusb; the only part of the driver that knows pyusb.

Everything that libusb can answer is translated here: a time-out is None, the rest is an error that
names its remedy. After a replug the old pyusb ``Device`` is useless: find the board again.
"""

import contextlib
import errno
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import usb.core
import usb.util

from drivers.errors import DeviceFault, GraspError, LinkLost
from drivers.takktile import protocol
from drivers.takktile.board import READ_TIMEOUT_MS, Transfer
from drivers.takktile.link import trouble

CONTROL_TIMEOUT_MS = 1000  # a scan takes 5 ms; a hung firmware never answers
_INTERFACE = 0
EMULATED = "; usb.url is of an emulated board, whose lab prints a new one each time it starts"
_UNCONFIGURED = "Configuration not set"  # of pyusb, which gives it no number
_GONE = (errno.ENODEV, errno.EIO, errno.ENOENT, errno.ESHUTDOWN)


class UsbLink:
    """An opened and claimed board. One thread may read while another sends a control request."""

    def __init__(
        self,
        device: Any,
        clock: Callable[[], int] = time.monotonic_ns,
        read_timeout_ms: int = READ_TIMEOUT_MS,
        control_timeout_ms: int = CONTROL_TIMEOUT_MS,
    ) -> None:
        """``device``: a pyusb ``Device``, which the link owns from now on; see ``find``."""
        self._device = device
        self._clock = clock
        self._read_timeout_ms = read_timeout_ms
        self._control_timeout_ms = control_timeout_ms
        self._closed = False
        try:
            self._serial = _serial_of(device)
            usb.util.claim_interface(device, _INTERFACE)
        except usb.core.USBError as error:
            self.close()
            raise _explain(error, device) from error

    @classmethod
    def find(
        cls,
        serial: str | None = None,
        backend: Any = None,
        clock: Callable[[], int] = time.monotonic_ns,
        read_timeout_ms: int = READ_TIMEOUT_MS,
        control_timeout_ms: int = CONTROL_TIMEOUT_MS,
    ) -> "UsbLink":
        """The board with this serial number, or the first one; ``LinkLost`` when there is none.

        ``backend``: a pyusb back end, whose ``url``, if it has one, is told; None is the machine's
        libusb.
        """
        device = _find(serial, backend)
        return cls(device, clock, read_timeout_ms, control_timeout_ms)

    @property
    def serial(self) -> str:
        return self._serial

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            reply = self._opened().ctrl_transfer(
                protocol.REQUEST_TYPE, request, value, index, length, self._control_timeout_ms
            )
        except usb.core.USBTimeoutError as error:
            raise DeviceFault(trouble.HUNG, trouble.HUNG_REMEDY) from error
        except usb.core.USBError as error:
            raise self._explain(error) from error
        return bytes(reply)

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        """One transfer; None when it timed out without a byte.

        When it timed out with some, pyusb returns those and does not say so: compare the length.
        """
        try:
            data = self._opened().read(protocol.ENDPOINT_IN, size, self._read_timeout_ms)
        except usb.core.USBTimeoutError:
            return None
        except usb.core.USBError as error:
            raise self._explain(error) from error
        return Transfer(bytes(data), self._clock())

    def clear_halt(self) -> None:
        """End a halt (STALL) of the bulk endpoint."""
        try:
            self._opened().clear_halt(protocol.ENDPOINT_IN)
        except usb.core.USBError as error:
            raise self._explain(error) from error

    def close(self) -> None:
        """Give the board back to the system; safe to call twice."""
        self._closed = True
        _dispose(self._device)

    def _opened(self) -> Any:
        """The device; pyusb would open it again without being asked."""
        if self._closed:
            raise LinkLost("the tactile board has been closed", "find it again")
        return self._device

    def _explain(self, error: usb.core.USBError) -> GraspError:
        explained = _explain(error, self._device)
        if isinstance(explained, LinkLost):
            self.close()
        return explained


def _find(serial: str | None, backend: Any) -> Any:
    try:
        found = list(
            usb.core.find(
                find_all=True,
                backend=backend,
                idVendor=protocol.VENDOR_ID,
                idProduct=protocol.PRODUCT_ID,
            )
        )
    except usb.core.NoBackendError as error:
        raise LinkLost(
            "libusb is not installed on this machine", "install it (Debian: libusb-1.0-0)"
        ) from error
    serials = []
    for device in found:
        try:
            serials.append(_serial_of(device))
        except usb.core.USBError as error:
            _dispose(device)
            raise _explain(error, device) from error
        if serial in (None, serials[-1]):
            return device
        _dispose(device)
    what = "" if serial is None else f" with serial number {serial}"
    there = f"; there is {', '.join(serials)}" if serials else ""
    url = getattr(backend, "url", "")
    raise LinkLost(
        f"no TakkTile board{what} ({protocol.VENDOR_ID:04x}:{protocol.PRODUCT_ID:04x}) "
        f"{f'at {url}' if url else 'on the USB bus'}{there}",
        "plug it in and check its cable" + (EMULATED if url else ""),
    )


def _serial_of(device: Any) -> str:
    try:
        return str(device.serial_number)
    except ValueError as error:  # pyusb: no language id, since the device may not be opened
        raise usb.core.USBError(str(error), errno=errno.EACCES) from error


def _dispose(device: Any) -> None:
    with contextlib.suppress(usb.core.USBError):  # gone, and so is what there was to release
        usb.util.dispose_resources(device)


def _explain(error: usb.core.USBError, device: Any) -> GraspError:
    if error.errno in _GONE:
        return trouble.unplugged()
    match error.errno:
        case errno.EPIPE:
            return trouble.stalled()
        case errno.EBUSY:
            return LinkLost(
                f"{users_of(device)} uses the tactile board", "end it, then start again"
            )
        case errno.EACCES:
            return LinkLost(
                "this user may not open the tactile board",
                "install the udev rule that `grasp doctor` prints, then replug the board",
            )
        case errno.ETIMEDOUT:
            return DeviceFault(trouble.HUNG, trouble.HUNG_REMEDY)
    why = error.strerror or str(error)
    if error.errno is None and _UNCONFIGURED in why:
        return DeviceFault(
            "the system has not set the tactile board up (no USB configuration), as where its port "
            "cannot supply it",
            "replug it, into a port of the computer or a hub with a supply of its own",
        )
    return DeviceFault(
        f"a USB transfer of the tactile board failed: {why}", "replug it, open it again"
    )


def users_of(device: Any, proc: Path = Path("/proc")) -> str:
    """Who holds the device's node open, as far as this user may see: name and process id."""
    node = f"/dev/bus/usb/{device.bus:03}/{device.address:03}"
    for entry in proc.glob("[0-9]*/fd/*"):
        process = entry.parent.parent
        try:
            if os.readlink(entry) == node and process.name != str(os.getpid()):
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
        except OSError:
            continue
    return "another program"
