"""The pyusb back end of an emulated board: forwards every transfer to a ``BoardServer``.

Errors are those that pyusb's libusb 1.0 back end raises: libusb's code and the errno.
"""

import contextlib
import errno
import os
import socket
import struct
import threading
from array import array
from collections.abc import Iterator
from types import SimpleNamespace
from urllib.parse import urlsplit

import usb.backend
import usb.core

from drivers.takktile.emulator import hop
from drivers.takktile.emulator.hop import HopReply, HopRequest, Listed, Op

_CONNECT_S = 5.0
_GRACE_S = 1.0  # beyond a transfer's own time-out: then the server is gone
_FULL_SPEED = 2  # libusb_speed
_LIBUSB_CODE = {
    errno.EIO: -1,
    errno.EINVAL: -2,
    errno.EACCES: -3,
    errno.ENODEV: -4,
    errno.ENOENT: -5,
    errno.EBUSY: -6,
    errno.ETIMEDOUT: -7,
    errno.EOVERFLOW: -8,
    errno.EPIPE: -9,
}
_HEADER = ("bLength", "bDescriptorType")
_DEVICE_FIELDS = (
    *_HEADER, "bcdUSB", "bDeviceClass", "bDeviceSubClass", "bDeviceProtocol", "bMaxPacketSize0",
    "idVendor", "idProduct", "bcdDevice", "iManufacturer", "iProduct", "iSerialNumber",
    "bNumConfigurations",
)  # fmt: skip
_CONFIG_FIELDS = (
    *_HEADER, "wTotalLength", "bNumInterfaces", "bConfigurationValue", "iConfiguration",
    "bmAttributes", "bMaxPower",
)  # fmt: skip
_INTERFACE_FIELDS = (
    *_HEADER, "bInterfaceNumber", "bAlternateSetting", "bNumEndpoints", "bInterfaceClass",
    "bInterfaceSubClass", "bInterfaceProtocol", "iInterface",
)  # fmt: skip
_ENDPOINT_FIELDS = (*_HEADER, "bEndpointAddress", "bmAttributes", "wMaxPacketSize", "bInterval")
_CONFIG_BYTES, _INTERFACE_BYTES, _ENDPOINT_BYTES = 9, 9, 7


class _Connection:
    """One request at a time."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._lock = threading.Lock()
        try:
            self._socket = socket.create_connection(address, _CONNECT_S)
        except OSError as error:
            raise _usb_error(errno.ENODEV) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def ask(self, request: HopRequest) -> bytes:
        """Data of the reply; a server that is gone is a device that is gone."""
        try:
            with self._lock:
                limit_s = request.timeout_ms * 1e-3 + _GRACE_S
                endless = request.op in (Op.BULK_READ, Op.BULK_WRITE) and not request.timeout_ms
                self._socket.settimeout(None if endless else limit_s)
                hop.send(self._socket, request)
                reply = hop.receive(self._socket, HopReply)
        except OSError as error:
            self.close()
            raise _usb_error(errno.ENODEV) from error
        if reply.errno:
            raise _usb_error(reply.errno)
        return reply.data

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes whoever waits for a reply
        self._socket.close()


class _Handle:
    """An opened board: bulk transfers may block, so they have a connection of their own."""

    def __init__(self, address: tuple[str, int], board: Listed) -> None:
        self._control = _Connection(address)
        try:
            opened = self._control.ask(HopRequest(Op.OPEN, index=board.plugs))
            self._number = hop.decode(opened, int)
            self._bulk = _Connection(address)
        except BaseException:
            self._control.close()
            raise

    def ask(self, op: Op, **fields: int) -> bytes:
        connection = self._bulk if op in (Op.BULK_READ, Op.BULK_WRITE) else self._control
        try:
            return connection.ask(HopRequest(op, self._number, **fields))
        except usb.core.USBError as error:
            if error.errno == errno.ENODEV:  # what is gone is asked nothing more, nor waited for
                self._control.close()
                self._bulk.close()
            raise

    def close(self) -> None:
        with contextlib.suppress(usb.core.USBError):  # it may be gone already
            self._control.ask(HopRequest(Op.CLOSE, self._number))
        self._control.close()
        self._bulk.close()


class EmulatedBus(usb.backend.IBackend):  # type: ignore[misc] # pyusb has no types
    """A USB bus with the one board of a ``BoardServer``; empty when nobody serves."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme != "tcp" or parts.hostname is None or parts.port is None:
            raise ValueError(f"{url}: the address of an emulated board is tcp://HOST:PORT")
        self._address = parts.hostname, parts.port
        self.url = url  # names it where no board is found there

    def _finalize_object(self) -> None:
        """Nothing is held open between handles."""

    def enumerate_devices(self) -> Iterator[Listed]:
        try:
            connection = _Connection(self._address)
        except usb.core.USBError:
            return iter(())
        try:
            return iter(hop.decode(connection.ask(HopRequest(Op.LIST)), list[Listed]))
        except usb.core.USBError:  # it listens, and says nothing
            return iter(())
        finally:
            connection.close()

    def get_parent(self, dev: Listed) -> None:
        return None

    def get_device_descriptor(self, dev: Listed) -> SimpleNamespace:
        fields = _unpack(_DEVICE_FIELDS, "<2BH4B3H4B", dev.device)
        # a new address after each replug, as Linux gives out
        place = {"bus": 1, "address": dev.plugs % 127 + 1, "port_number": 1, "port_numbers": (1,)}
        return SimpleNamespace(**fields, **place, speed=_FULL_SPEED)

    def get_configuration_descriptor(self, dev: Listed, config: int) -> SimpleNamespace:
        _only_first(config)
        return _descriptor(_CONFIG_FIELDS, "<2BH5B", dev.config)

    def get_interface_descriptor(
        self, dev: Listed, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        _only_first(intf, alt, config)
        return _descriptor(_INTERFACE_FIELDS, "<9B", dev.config[_CONFIG_BYTES:])

    def get_endpoint_descriptor(
        self, dev: Listed, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        _only_first(intf, alt, config)
        at = _CONFIG_BYTES + _INTERFACE_BYTES + ep * _ENDPOINT_BYTES
        if ep < 0 or at >= len(dev.config):
            raise IndexError(f"no endpoint {ep}")
        found = _descriptor(_ENDPOINT_FIELDS, "<4BHB", dev.config[at:])
        found.bRefresh = found.bSynchAddress = 0
        return found

    def open_device(self, dev: Listed) -> _Handle:
        return _Handle(self._address, dev)

    def close_device(self, dev_handle: _Handle) -> None:
        dev_handle.close()

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        dev_handle.ask(Op.SET_CONFIGURATION, value=config_value)

    def get_configuration(self, dev_handle: _Handle) -> int:
        reply = dev_handle.ask(Op.CONTROL, request_type=0x80, request=8, size=1)
        if not reply:  # of another request, where something on the way repeats answers
            raise _usb_error(errno.EIO)
        return reply[0]

    def set_interface_altsetting(self, dev_handle: _Handle, intf: int, altsetting: int) -> None:
        dev_handle.ask(Op.SET_ALTSETTING, index=intf, value=altsetting)

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        dev_handle.ask(Op.CLAIM, index=intf)

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        dev_handle.ask(Op.RELEASE, index=intf)

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
        reply = dev_handle.ask(
            Op.CONTROL,
            request_type=bmRequestType,
            request=bRequest,
            value=wValue,
            index=wIndex,
            size=len(data),
            timeout_ms=timeout,
        )
        return _fill(data, reply)

    def bulk_read(
        self, dev_handle: _Handle, ep: int, intf: int, buff: "array[int]", timeout: int
    ) -> int:
        reply = dev_handle.ask(Op.BULK_READ, request_type=ep, size=len(buff), timeout_ms=timeout)
        return _fill(buff, reply)

    def bulk_write(
        self, dev_handle: _Handle, ep: int, intf: int, data: "array[int]", timeout: int
    ) -> int:
        dev_handle.ask(Op.BULK_WRITE, request_type=ep, size=len(data), timeout_ms=timeout)
        return len(data)

    def clear_halt(self, dev_handle: _Handle, ep: int) -> None:
        dev_handle.ask(Op.CLEAR_HALT, request_type=ep)

    def reset_device(self, dev_handle: _Handle) -> None:
        dev_handle.ask(Op.RESET)

    def is_kernel_driver_active(self, dev_handle: _Handle, intf: int) -> bool:
        return False  # no kernel driver knows this vendor class

    def detach_kernel_driver(self, dev_handle: _Handle, intf: int) -> None:
        raise _usb_error(errno.ENOENT)

    def attach_kernel_driver(self, dev_handle: _Handle, intf: int) -> None:
        raise _usb_error(errno.ENOENT)


def backend(url: str) -> EmulatedBus:
    """Back end for ``usb.core.find(backend=...)`` on the board served at ``tcp://HOST:PORT``."""
    return EmulatedBus(url)


def _usb_error(code: int) -> usb.core.USBError:
    kind = usb.core.USBTimeoutError if code == errno.ETIMEDOUT else usb.core.USBError
    return kind(os.strerror(code), _LIBUSB_CODE.get(code, -99), code)


def _unpack(names: tuple[str, ...], layout: str, data: bytes) -> dict[str, int]:
    try:
        return dict(zip(names, struct.unpack_from(layout, data), strict=True))
    except struct.error as error:
        raise _usb_error(errno.EIO) from error


def _descriptor(names: tuple[str, ...], layout: str, data: bytes) -> SimpleNamespace:
    return SimpleNamespace(**_unpack(names, layout, data), extra_descriptors=[])


def _only_first(*indices: int) -> None:
    if any(indices):
        raise IndexError("the board has one configuration, one interface, one alternate setting")


def _fill(buffer: "array[int]", reply: bytes) -> int:
    buffer[: len(reply)] = array("B", reply)
    return len(reply)
