"""Link to a board through pyusb: USB discovery, transfers, and the reading thread.

A USB time-out becomes None; every other libusb error becomes a ``GraspError`` with a remedy. After
a replug the pyusb ``Device`` is invalid, and the board has to be found again.
"""

import contextlib
import errno
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import usb.core
import usb.util

from drivers.errors import DeviceFault, GraspError, LinkLost
from drivers.takktile import protocol
from drivers.takktile.protocol import PRODUCT_ID, VENDOR_ID, Layout
from drivers.takktile.receiver import (
    READ_TIMEOUT_MS,
    Connect,
    Receiver,
    Transfer,
    hung,
    stalled,
    unplugged,
)
from drivers.takktile.settings import TakkTileSettings

CONTROL_TIMEOUT_MS = 1000  # a scan takes 5 ms; a hung firmware never answers
_JOIN_S = 4.0  # several control requests to a hung board, each with its time-out
_INTERFACE = 0
EMULATED = "; usb.url is an emulated board's: the emulator prints a new one at each start"
_UNCONFIGURED = "Configuration not set"  # message of pyusb, without an errno
_UNPLUGGED_ERRNOS = (errno.ENODEV, errno.EIO, errno.ENOENT, errno.ESHUTDOWN)

DEVICES = Path("/sys/bus/usb/devices")
IDS = f"{VENDOR_ID:04x}:{PRODUCT_ID:04x}"
RULE_FILE = "/etc/udev/rules.d/60-takktile.rules"
RULE = (
    f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{VENDOR_ID:04x}", ATTR{{idProduct}}=="{PRODUCT_ID:04x}",'
    ' MODE="0660", TAG+="uaccess"'
)
INSTALL = (
    f"echo '{RULE}' | sudo tee {RULE_FILE} && sudo udevadm control --reload && "
    "sudo udevadm trigger --subsystem-match=usb"
)


class UsbLink:
    """An opened and claimed board. One thread may read while another sends a control request."""

    def __init__(
        self,
        device: Any,
        clock: Callable[[], int] = time.monotonic_ns,
        read_timeout_ms: int = READ_TIMEOUT_MS,
        control_timeout_ms: int = CONTROL_TIMEOUT_MS,
    ) -> None:
        """``device``: a pyusb ``Device``, which the link will close; see ``find``."""
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

        ``backend``: a pyusb back end, whose ``url``, if any, appears in error messages; None is the
        machine's libusb.
        """
        return cls(_find(serial, backend), clock, read_timeout_ms, control_timeout_ms)

    @property
    def serial(self) -> str:
        return self._serial

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            reply = self._opened().ctrl_transfer(
                protocol.REQUEST_TYPE, request, value, index, length, self._control_timeout_ms
            )
        except usb.core.USBTimeoutError as error:
            raise hung() from error
        except usb.core.USBError as error:
            raise self._explain(error) from error
        return bytes(reply)

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        """Data of one transfer; None when it timed out without a byte. After a time-out with some
        bytes pyusb returns those without notice: compare the length."""
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
        """Release the board; safe to call twice."""
        self._closed = True
        _dispose(self._device)

    def _opened(self) -> Any:
        """The device; ``LinkLost`` once closed, since pyusb would reopen it silently."""
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
            usb.core.find(find_all=True, backend=backend, idVendor=VENDOR_ID, idProduct=PRODUCT_ID)
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
    there = f"; found: {', '.join(serials)}" if serials else ""
    url = getattr(backend, "url", "")
    raise LinkLost(
        f"no TakkTile board{what} ({IDS}) {f'at {url}' if url else 'on the USB bus'}{there}",
        "plug it in and check its cable" + (EMULATED if url else ""),
    )


def _serial_of(device: Any) -> str:
    try:
        return str(device.serial_number)
    except ValueError as error:  # pyusb: no language id, since the device may not be opened
        raise usb.core.USBError(str(error), errno=errno.EACCES) from error


def _dispose(device: Any) -> None:
    with contextlib.suppress(usb.core.USBError):  # an unplugged board has nothing to release
        usb.util.dispose_resources(device)


def _explain(error: usb.core.USBError, device: Any) -> GraspError:
    if error.errno in _UNPLUGGED_ERRNOS:
        return unplugged()
    match error.errno:
        case errno.EPIPE:
            return stalled()
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
            return hung()
    why = error.strerror or str(error)
    if error.errno is None and _UNCONFIGURED in why:
        return DeviceFault(
            "the system has not set up the tactile board (no USB configuration); its port may not "
            "supply enough power",
            "replug it into a port of the computer or a hub with its own power supply",
        )
    return DeviceFault(
        f"a USB transfer of the tactile board failed: {why}", "replug it, open it again"
    )


def users_of(device: Any, proc: Path = Path("/proc")) -> str:
    """Program that has the device's node open, as far as this user may see: name, process id."""
    node = f"/dev/bus/usb/{device.bus:03}/{device.address:03}"
    for entry in proc.glob("[0-9]*/fd/*"):
        process = entry.parent.parent
        try:
            if os.readlink(entry) == node and process.name != str(os.getpid()):
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
        except OSError:
            continue
    return "another program"


class ReadingThread:
    """``FrameLink`` in wall time. Keeps a read pending, so that each frame is read as soon as it is
    ready, at about 200 Hz.

    ``connect`` returns the board with a serial number, or any board for None, for example
    ``UsbLink.find``. ``clock`` must be the clock of the times given to ``poll``.
    """

    def __init__(
        self,
        connect: Connect,
        settings: TakkTileSettings,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.receiver = Receiver(connect, settings.conversion_ms, clock)
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()

    def start(self) -> Layout:
        layout = self.receiver.open()
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, name="takktile-reader", daemon=True)
        self._thread.start()
        return layout

    def stop(self) -> None:
        if self._thread is None:
            return
        self._stopping.set()
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            raise DeviceFault("a USB transfer of the tactile board does not end", "unplug it")
        self._thread = None

    def _run(self) -> None:
        receiver = self.receiver
        try:
            while not self._stopping.is_set():
                if pause_ns := receiver.receive():
                    self._stopping.wait(pause_ns * 1e-9)
        except BaseException as bug:
            receiver.report(
                DeviceFault(f"reading the tactile board failed: {bug!r}", "report this")
            )
            raise
        finally:
            receiver.close()


class BoardNode(msgspec.Struct, frozen=True):
    """Device node of a board, serial number (empty: none), and whether this user may open it."""

    node: str
    serial: str
    allowed: bool


def boards(devices: Path = DEVICES) -> Iterator[BoardNode]:
    """The boards that are plugged in."""
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
