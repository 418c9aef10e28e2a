"""USB descriptors of the board, as bytes, and the standard requests that ask for them.

Source: TakkTile-usb firmware, Descriptors.c; USB 2.0 specification, chapter 9.
"""

import struct
from enum import IntEnum

VENDOR_ID, PRODUCT_ID = 0x59E3, 0x74C7
VENDOR_REQUEST = 0xC0  # to the host, vendor, device: every request of the board, even a command
PACKET_BYTES = 64  # full-speed bulk
ENDPOINT_IN = 0x81
ENDPOINT_OUT = 0x02  # declared, but the firmware never takes anything from it
CONFIGURATION = 1
SERIAL = "4A453034383114003F001F"  # of an emulated board: lot, wafer and coordinates, as hex digits

_SERIAL_INDEX = 0xDC  # the XMEGA stack builds this string on the fly
_VENDOR_CLASS = 0xFF
_BULK = 2
_LANGUAGE = 0x0409
_STRINGS = {1: "The Biorobotics Lab", 2: "TakkTile"}

DEVICE = struct.pack(
    "<2BH4B3H4B",
    18, 1, 0x0110, _VENDOR_CLASS, 0, 0, 64, VENDOR_ID, PRODUCT_ID, 0x0200, 1, 2, _SERIAL_INDEX, 1,
)  # fmt: skip
_INTERFACE = struct.pack("<9B", 9, 4, 0, 0, 2, _VENDOR_CLASS, 0, 0, 0)
_ENDPOINTS = struct.pack("<4BHB", 7, 5, ENDPOINT_IN, _BULK, PACKET_BYTES, 0) + struct.pack(
    "<4BHB", 7, 5, ENDPOINT_OUT, _BULK, 32, 0
)
CONFIG = (
    struct.pack("<2BH5B", 9, 2, 9 + len(_INTERFACE + _ENDPOINTS), 1, CONFIGURATION, 0, 0x80, 250)
    + _INTERFACE
    + _ENDPOINTS
)

_STANDARD_IN = 0x80


class _Request(IntEnum):
    GET_STATUS = 0
    GET_DESCRIPTOR = 6
    GET_CONFIGURATION = 8


def answer(request_type: int, request: int, value: int, serial: str) -> bytes | None:
    """Reply to a standard request to the device; None is a STALL."""
    if request_type != _STANDARD_IN:
        return None
    match request, value >> 8, value & 0xFF:
        case (_Request.GET_STATUS, _, _):
            return bytes(2)
        case (_Request.GET_CONFIGURATION, _, _):
            return bytes([CONFIGURATION])
        case (_Request.GET_DESCRIPTOR, 1, _):
            return DEVICE
        case (_Request.GET_DESCRIPTOR, 2, 0):
            return CONFIG
        case (_Request.GET_DESCRIPTOR, 3, 0):
            return struct.pack("<2BH", 4, 3, _LANGUAGE)
        case (_Request.GET_DESCRIPTOR, 3, index):
            return _string({**_STRINGS, _SERIAL_INDEX: serial}.get(index))
    return None


def _string(text: str | None) -> bytes | None:
    if text is None:
        return None
    units = text.encode("utf-16-le")
    return bytes([2 + len(units), 3]) + units
