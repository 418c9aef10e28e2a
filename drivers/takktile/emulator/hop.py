"""The hop between the emulator's USB back end and its server: nothing that a TakkTile knows.

Each request gets one reply on the same connection. A message is its length (4 bytes, big-endian)
and its fields in MessagePack. A transfer that takes long blocks its connection, so that one handle
needs two: one for bulk transfers, one for everything else.
"""

import socket
from enum import IntEnum
from typing import Annotated, TypeVar

import msgspec

_LENGTH_BYTES = 4
_MOST_BYTES = 1 << 16


class Op(IntEnum):
    """What the back end asks for; named as in pyusb's ``IBackend``."""

    LIST = 0  # the boards plugged in
    OPEN = 1  # index: ``plugs`` of the board meant; replies a handle
    CLOSE = 2
    SET_CONFIGURATION = 3
    SET_ALTSETTING = 4
    CLAIM = 5
    RELEASE = 6
    CONTROL = 7
    BULK_READ = 8
    BULK_WRITE = 9
    CLEAR_HALT = 10
    RESET = 11


_Field = Annotated[int, msgspec.Meta(ge=0, lt=1 << 31)]
_Size = Annotated[int, msgspec.Meta(ge=0, le=_MOST_BYTES)]


class HopRequest(msgspec.Struct, frozen=True, array_like=True):
    """One operation; fields that it does not use are zero."""

    op: Op
    handle: _Field = 0
    request_type: _Field = 0  # or the endpoint of a bulk transfer
    request: _Field = 0
    value: _Field = 0
    index: _Field = 0
    size: _Size = 0
    timeout_ms: _Field = 0  # 0: none


class HopReply(msgspec.Struct, frozen=True, array_like=True):
    """``errno`` as a USB host would report it; 0 is success."""

    errno: int
    data: bytes = b""


class Listed(msgspec.Struct, frozen=True, array_like=True):
    """One board on the emulated bus."""

    plugs: int
    device: bytes  # descriptors
    config: bytes


Message = TypeVar("Message")


def send(connection: socket.socket, message: object) -> None:
    data = encode(message)
    connection.sendall(len(data).to_bytes(_LENGTH_BYTES) + data)


def receive(connection: socket.socket, kind: type[Message]) -> Message:
    """Next message; ``OSError`` when the connection ends or what comes is no message."""
    length = int.from_bytes(_exactly(connection, _LENGTH_BYTES))
    if length > _MOST_BYTES:
        raise OSError("not a message of the emulator")
    return decode(_exactly(connection, length), kind)


def encode(message: object) -> bytes:
    return msgspec.msgpack.encode(message)


def decode(data: bytes, kind: type[Message]) -> Message:
    try:
        return msgspec.msgpack.decode(data, type=kind)
    except msgspec.MsgspecError as error:
        raise OSError("not a message of the emulator") from error


def _exactly(connection: socket.socket, size: int) -> bytes:
    data = bytearray()
    while len(data) < size:
        part = connection.recv(size - len(data))
        if not part:
            raise ConnectionResetError("the other side has closed the connection")
        data += part
    return bytes(data)
