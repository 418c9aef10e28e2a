"""Short connections to a controller's RTDE and dashboard ports, with deadlines.

Framing: UR's Real-Time Data Exchange (RTDE) guide.
"""

import contextlib
import socket
import struct
import time
from collections.abc import Mapping
from typing import IO, Self

DASHBOARD_PORT, SCRIPT_PORT, RTDE_PORT = 29999, 30003, 30004
CHECK_CONNECTION = "check power, cable and address of the robot's controller"
_HANG_UP_S = 0.2
_MAX_LINE_BYTES = 1024


class Rtde:
    """RTDE connection for a few requests; they raise OSError and ValueError."""

    def __init__(self, host: str, timeout_s: float) -> None:
        self._socket = socket.create_connection((host, RTDE_PORT), timeout_s)
        self._file = self._socket.makefile("rb")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Wait briefly for the controller to disconnect too, so that claims are free again."""
        deadline = time.monotonic() + _HANG_UP_S
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            self._socket.settimeout(_HANG_UP_S)
            while time.monotonic() < deadline and self._socket.recv(_MAX_LINE_BYTES):
                pass
        self._file.close()
        self._socket.close()

    def request(self, kind: bytes, body: bytes = b"") -> bytes:
        """Body of the reply of the same kind; other packets (messages) are skipped."""
        self.send(kind, body)
        return self.wait(kind)

    def send(self, kind: bytes, body: bytes) -> None:
        """Send a packet that has no reply."""
        self._socket.sendall(struct.pack(">Hc", 3 + len(body), kind) + body)

    def wait(self, kind: bytes) -> bytes:
        """Body of the next packet of a kind."""
        while True:
            size, found = struct.unpack(">Hc", _exactly(self._file, 3))
            if size < 3:
                raise ValueError(f"RTDE packet of {size} bytes")
            body = _exactly(self._file, size - 3)
            if found == kind:
                return body

    def subscribe(self, frequency_hz: float, names: Mapping[str, str]) -> None:
        """Subscribe to these fields, sent as packets of kind U."""
        types = self.request(b"O", struct.pack(">d", frequency_hz) + ",".join(names).encode())[1:]
        if b"NOT_FOUND" in types or self.request(b"S") != b"\x01":
            raise ValueError(f"it does not send {','.join(names)}: {types.decode()}")


class Dashboard:
    """Dashboard connection: one command, one reply; raises OSError and ValueError."""

    def __init__(self, host: str, timeout_s: float) -> None:
        self._socket = socket.create_connection((host, DASHBOARD_PORT), timeout_s)
        self._file = self._socket.makefile("rb")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._socket.close()

    def line(self) -> str:
        line = self._file.readline(_MAX_LINE_BYTES)
        if not line.endswith(b"\n"):
            raise ValueError("no end of line" if line else "the peer hung up")
        return line.decode("utf-8", "replace").strip()

    def request(self, command: str) -> str:
        self._socket.sendall(command.encode() + b"\n")
        return self.line()


def _exactly(stream: IO[bytes], count: int) -> bytes:
    data = stream.read(count)
    if len(data) < count:
        raise ConnectionError("the peer hung up")
    return data


def reason(error: Exception) -> str:
    """Text of the error of a connection."""
    return "no reply in time" if isinstance(error, TimeoutError) else str(error) or "no reply"
