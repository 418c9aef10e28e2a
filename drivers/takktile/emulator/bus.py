"""pyusb back end of an emulated board: forwards every transfer to a ``BoardServer``.

Errors are those of pyusb's libusb 1.0 back end: libusb's code and the errno. Descriptors are those
of the TakkTile-usb firmware, Descriptors.c.

Each request gets one reply on the same connection. A message is its length (4 bytes, big-endian)
and its fields in MessagePack. A pending transfer blocks its connection. Therefore a handle has two:
one for bulk transfers, one for everything else.
"""

import contextlib
import errno
import os
import socket
import threading
from array import array
from collections.abc import Iterator
from enum import IntEnum
from types import SimpleNamespace
from typing import TypeVar
from urllib.parse import urlsplit

import msgspec
import usb.backend
import usb.core

from drivers.errors import on_failure

ENDPOINT_IN, ENDPOINT_OUT = 0x81, 0x02  # the firmware never reads the second
CONFIGURATION = 1
PACKET_BYTES = 64  # full-speed bulk
SERIAL_INDEX = 0xDC  # the XMEGA stack generates this string
_VENDOR_CLASS = 0xFF

_DEVICE = {
    "bLength": 18, "bDescriptorType": 1, "bcdUSB": 0x0110, "bDeviceClass": _VENDOR_CLASS,
    "bDeviceSubClass": 0, "bDeviceProtocol": 0, "bMaxPacketSize0": 64, "idVendor": 0x59E3,
    "idProduct": 0x74C7, "bcdDevice": 0x0200, "iManufacturer": 1, "iProduct": 2,
    "iSerialNumber": SERIAL_INDEX, "bNumConfigurations": 1,
    "bus": 1, "port_number": 1, "port_numbers": (1,), "speed": 2,
}  # fmt: skip
_CONFIG = {
    "bLength": 9, "bDescriptorType": 2, "wTotalLength": 32, "bNumInterfaces": 1,
    "bConfigurationValue": CONFIGURATION, "iConfiguration": 0, "bmAttributes": 0x80,
    "bMaxPower": 250, "extra_descriptors": [],
}  # fmt: skip
_INTERFACE = {
    "bLength": 9, "bDescriptorType": 4, "bInterfaceNumber": 0, "bAlternateSetting": 0,
    "bNumEndpoints": 2, "bInterfaceClass": _VENDOR_CLASS, "bInterfaceSubClass": 0,
    "bInterfaceProtocol": 0, "iInterface": 0, "extra_descriptors": [],
}  # fmt: skip
_ENDPOINT = {
    "bLength": 7, "bDescriptorType": 5, "bmAttributes": 2, "bInterval": 0, "bRefresh": 0,
    "bSynchAddress": 0, "extra_descriptors": [],
}  # fmt: skip
_ENDPOINTS = ((ENDPOINT_IN, PACKET_BYTES), (ENDPOINT_OUT, 32))

_CONNECT_S = 5.0
_GRACE_S = 1.0  # wait beyond a transfer's time-out; after that the server counts as gone
_LENGTH_BYTES = 4
_MAX_BYTES = 1 << 16
_LIBUSB_CODE = {
    errno.EIO: -1, errno.EACCES: -3, errno.ENODEV: -4, errno.ENOENT: -5, errno.EBUSY: -6,
    errno.ETIMEDOUT: -7, errno.EOVERFLOW: -8, errno.EPIPE: -9,
}  # fmt: skip


class Op(IntEnum):
    """Operation of a request."""

    LIST = 0  # replies ``plug_count`` of each board that is plugged in
    OPEN = 1  # index: ``plug_count`` of the board; replies a handle
    CLOSE = 2
    CONFIGURE = 3
    CLAIM = 4
    RELEASE = 5
    CONTROL = 6
    BULK_READ = 7
    CHECK_PRESENT = 8  # fails when the board is gone


class BusRequest(msgspec.Struct, frozen=True, array_like=True):
    """Request for one operation; unused fields are zero."""

    op: Op
    handle: int = 0
    request_type: int = 0
    request: int = 0
    value: int = 0
    index: int = 0
    size: int = 0
    timeout_ms: int = 0  # 0: none


class BusReply(msgspec.Struct, frozen=True, array_like=True):
    """``errno`` as a USB host would report it; 0 is success."""

    errno: int
    data: bytes = b""


Message = TypeVar("Message")


def send(connection: socket.socket, message: object) -> None:
    data = msgspec.msgpack.encode(message)
    connection.sendall(len(data).to_bytes(_LENGTH_BYTES) + data)


def receive(connection: socket.socket, kind: type[Message]) -> Message:
    """Next message; ``OSError`` when the connection ends or the message is malformed."""
    length = int.from_bytes(_receive_exactly(connection, _LENGTH_BYTES))
    if length > _MAX_BYTES:
        raise OSError("not a message of the emulator")
    return decode(_receive_exactly(connection, length), kind)


def decode(data: bytes, kind: type[Message]) -> Message:
    try:
        return msgspec.msgpack.decode(data, type=kind)
    except msgspec.MsgspecError as error:
        raise OSError("not a message of the emulator") from error


def _receive_exactly(connection: socket.socket, size: int) -> bytes:
    data = bytearray()
    while len(data) < size:
        part = connection.recv(size - len(data))
        if not part:
            raise ConnectionResetError("the other side has closed the connection")
        data += part
    return bytes(data)


class _Connection:
    """Connection to the server, one request at a time."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._lock = threading.Lock()
        try:
            self._socket = socket.create_connection(address, _CONNECT_S)
        except OSError as error:
            raise _usb_error(errno.ENODEV) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def request(self, request: BusRequest) -> bytes:
        """Data of the reply; a lost server counts as an unplugged device."""
        try:
            with self._lock:
                endless = request.op is Op.BULK_READ and not request.timeout_ms
                limit_s = request.timeout_ms * 1e-3 + _GRACE_S
                self._socket.settimeout(None if endless else limit_s)
                send(self._socket, request)
                reply = receive(self._socket, BusReply)
        except OSError as error:
            self.close()
            raise _usb_error(errno.ENODEV) from error
        if reply.errno:
            raise _usb_error(reply.errno)
        return reply.data

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits for a reply
        self._socket.close()


class _Handle:
    """An opened board."""

    def __init__(self, address: tuple[str, int], plug_count: int) -> None:
        self._control = _Connection(address)
        with on_failure(self._control.close):
            self._number = decode(self._control.request(BusRequest(Op.OPEN, index=plug_count)), int)
            self._bulk = _Connection(address)

    def request(self, op: Op, **fields: int) -> bytes:
        connection = self._bulk if op is Op.BULK_READ else self._control
        try:
            return connection.request(BusRequest(op, self._number, **fields))
        except usb.core.USBError as error:
            if error.errno == errno.ENODEV:  # no later request waits for an unplugged board
                self._control.close()
                self._bulk.close()
            raise

    def close(self) -> None:
        with contextlib.suppress(usb.core.USBError):  # it may be gone already
            self._control.request(BusRequest(Op.CLOSE, self._number))
        self._control.close()
        self._bulk.close()


class EmulatedBus(usb.backend.IBackend):  # type: ignore[misc] # pyusb has no types
    """USB bus with the board of a ``BoardServer``; empty without a server.

    A device is represented by the ``plug_count`` of the board.
    """

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme != "tcp" or parts.hostname is None or parts.port is None:
            raise ValueError(f"{url}: the address of an emulated board is tcp://HOST:PORT")
        self._address = parts.hostname, parts.port
        self.url = url  # shown in the error when no board is found

    def _finalize_object(self) -> None:
        """Do nothing: no connection is open between handles."""

    def enumerate_devices(self) -> Iterator[int]:
        try:
            connection = _Connection(self._address)
        except usb.core.USBError:
            return iter(())
        try:
            return iter(decode(connection.request(BusRequest(Op.LIST)), list[int]))
        except usb.core.USBError:  # the server does not reply
            return iter(())
        finally:
            connection.close()

    def get_parent(self, dev: int) -> None:
        return None

    def get_device_descriptor(self, dev: int) -> SimpleNamespace:
        # a new address after each replug, as on Linux
        return SimpleNamespace(**_DEVICE, address=dev % 127 + 1)

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        _only_first(config)
        return SimpleNamespace(**_CONFIG)

    def get_interface_descriptor(
        self, dev: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        _only_first(intf, alt, config)
        return SimpleNamespace(**_INTERFACE)

    def get_endpoint_descriptor(
        self, dev: int, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        _only_first(intf, alt, config)
        address, packet_bytes = _ENDPOINTS[ep]
        return SimpleNamespace(**_ENDPOINT, bEndpointAddress=address, wMaxPacketSize=packet_bytes)

    def open_device(self, dev: int) -> _Handle:
        return _Handle(self._address, dev)

    def close_device(self, dev_handle: _Handle) -> None:
        dev_handle.close()

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        dev_handle.request(Op.CONFIGURE, value=config_value)

    def get_configuration(self, dev_handle: _Handle) -> int:
        dev_handle.request(Op.CHECK_PRESENT)
        return CONFIGURATION

    def set_interface_altsetting(self, dev_handle: _Handle, intf: int, altsetting: int) -> None:
        dev_handle.request(Op.CHECK_PRESENT)

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        dev_handle.request(Op.CLAIM, index=intf)

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        dev_handle.request(Op.RELEASE, index=intf)

    def ctrl_transfer(
        self,
        dev_handle: _Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: "array[int]",
        timeout: int,
    ) -> int:
        reply = dev_handle.request(
            Op.CONTROL, request_type=bmRequestType, request=bRequest, value=wValue, index=wIndex,
            size=len(data), timeout_ms=timeout,
        )  # fmt: skip
        return _fill(data, reply)

    def bulk_read(
        self, dev_handle: _Handle, ep: int, intf: int, buff: "array[int]", timeout: int
    ) -> int:
        return _fill(buff, dev_handle.request(Op.BULK_READ, size=len(buff), timeout_ms=timeout))

    def clear_halt(self, dev_handle: _Handle, ep: int) -> None:
        dev_handle.request(Op.CHECK_PRESENT)  # the firmware's halts last for one transfer

    def is_kernel_driver_active(self, dev_handle: _Handle, intf: int) -> bool:
        return False  # no kernel driver knows this vendor class


def backend(url: str) -> EmulatedBus:
    """Back end for ``usb.core.find(backend=...)``, for the board served at ``tcp://HOST:PORT``."""
    return EmulatedBus(url)


def _usb_error(code: int) -> usb.core.USBError:
    kind = usb.core.USBTimeoutError if code == errno.ETIMEDOUT else usb.core.USBError
    return kind(os.strerror(code), _LIBUSB_CODE.get(code, -99), code)


def _only_first(*indices: int) -> None:
    if any(indices):
        raise IndexError("the board has one configuration, one interface, one alternate setting")


def _fill(buffer: "array[int]", reply: bytes) -> int:
    buffer[: len(reply)] = array("B", reply)
    return len(reply)
