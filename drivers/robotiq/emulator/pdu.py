"""The emulated gripper behind its wire: requests in, replies out, framing left to others.

This Modbus layer is written apart from the driver's, so that a mistake of one cannot hide in the
other; what the registers mean is not known here. Source: Robotiq 3-Finger manual, 2014 p. 59 and
75, 2018 p. 46; Modbus application protocol V1.1b3 for the layout of requests and exception codes.
"""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from enum import Enum
from typing import Annotated, Final

import msgspec

from drivers.robotiq.model.gripper import GripperModel

_Meta = msgspec.Meta
MOST_PLANNED = 1000


class Trouble(Enum):
    """What happens to a request that is hit."""

    DROP = "drop"  # carried out, never answered
    DELAY = "delay"  # carried out, answered ``seconds`` later
    GARBLE = "garble"  # carried out, answered with a damaged frame
    SPLIT = "split"  # answered one byte at a time, ``seconds`` apart
    DISCONNECT = "disconnect"  # connection closed instead; RTU: not carried out, no answer
    EXCEPTION = "exception"  # not carried out, answered with exception ``code``; RTU: no answer
    FREEZE = "freeze"  # this and all that follow wait ``seconds``, then are carried out
    DEVICE_FAULT = "device_fault"  # the hand shows fault ``code`` from the next refresh on


class WireFault(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One planned trouble: whom it hits is the conjunction of its conditions."""

    trouble: Trouble
    function: (
        Annotated[int, _Meta(ge=1, le=127, description="requests with this function; None: all")]
        | None
    ) = None
    from_ns: Annotated[
        int, _Meta(ge=0, description="not before this time of the emulator's clock, ns")
    ] = 0
    skip: Annotated[int, _Meta(ge=0, description="spare so many requests first")] = 0
    times: Annotated[int, _Meta(ge=1, description="hit so many requests")] = 1
    seconds: Annotated[float, _Meta(ge=0, le=60, description="delay, freeze or spacing, s")] = 0.0
    code: Annotated[
        int, _Meta(ge=0, le=255, description="exception code, or fault of the hand")
    ] = 4


class _Planned:
    def __init__(self, fault: WireFault) -> None:
        self.fault = fault
        self.skip = fault.skip
        self.left = fault.times

    def hits(self, function: int, now_ns: int) -> bool:
        fault = self.fault
        if now_ns < fault.from_ns or fault.function not in (None, function):
            return False
        if self.skip:
            self.skip -= 1
            return False
        self.left -= 1
        return True


class WireFaults:
    """The plan. Any thread may add to it; a request takes the first fault that hits it."""

    def __init__(self) -> None:
        self._planned: list[_Planned] = []
        self._lock = threading.Lock()

    def add(self, fault: WireFault) -> None:
        """Raises ValueError where too many are planned."""
        with self._lock:
            if len(self._planned) >= MOST_PLANNED:
                raise ValueError(f"{MOST_PLANNED} faults are planned: no more are taken")
            self._planned.append(_Planned(fault))

    def clear(self) -> None:
        with self._lock:
            self._planned.clear()

    def take(self, function: int, now_ns: int) -> WireFault | None:
        """The fault that hits a request, if any."""
        with self._lock:
            for planned in self._planned:
                if planned.hits(function, now_ns):
                    if not planned.left:
                        self._planned.remove(planned)
                    return planned.fault
        return None


def damaged(frame: bytes) -> bytes:
    """A frame that no receiver can take for a good one: every byte inverted."""
    return bytes(255 - byte for byte in frame)


Guard = AbstractContextManager[object]  # a lock of any kind

ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3

_SPACE: Final = 8  # registers each way
_MOST_READ: Final = 125
_MOST_WRITTEN: Final = 123
_MOST_WRITTEN_WITH_READ: Final = 121


class Hand:
    """A gripper model and its time, shared with whoever else moves it.

    ``advance(now_ns)`` brings the model, and what it touches, to a time; it is called with the
    lock held.
    """

    def __init__(
        self,
        model: GripperModel,
        clock: Callable[[], int],
        lock: Guard | None = None,
        advance: Callable[[int], None] | None = None,
    ) -> None:
        self.model = model
        self.clock = clock
        self.lock: Guard = lock if lock is not None else threading.Lock()
        self._advance = advance if advance is not None else model.advance

    def write(self, first: int, words: list[int]) -> None:
        with self.lock:
            self.model.write(first, words, self._now_ns())

    def read(self, first: int, count: int) -> tuple[int, ...]:
        with self.lock:
            return self.model.read(self._now_ns())[first : first + count]

    def inject_fault(self, code: int) -> None:
        """Show a fault from the next refresh on; 0 takes it back."""
        with self.lock:
            self._now_ns()
            self.model.inject_fault(code)

    def keep_up(self) -> None:
        """Bring a hand that moves to now, so that no request has to wait for a long stretch."""
        with self.lock:
            if self.model.moving:
                self._now_ns()

    def _now_ns(self) -> int:
        now_ns = self.clock()
        self._advance(now_ns)
        return now_ns


class Unanswerable(Exception):
    """A request that gets an exception reply, or silence where there are none."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


def _word(data: bytes, at: int) -> int:
    return data[at] * 256 + data[at + 1]


def _words(data: bytes) -> list[int]:
    return [_word(data, at) for at in range(0, len(data), 2)]


def _listed(words: tuple[int, ...]) -> bytes:
    return bytes([2 * len(words)]) + b"".join(word.to_bytes(2, "big") for word in words)


def _need(true: bool, code: int) -> None:
    if not true:
        raise Unanswerable(code)


def _block(first: int, count: int, start: int) -> int:
    """Offset of registers within a block that starts at ``start``."""
    _need(start <= first and first + count <= start + _SPACE, ILLEGAL_ADDRESS)
    return first - start


class _Registers:
    """Requests that both grippers know, at the addresses of one of them."""

    command_start: int
    status_start: int

    def __init__(self, hand: Hand) -> None:
        self._hand = hand

    def read(self, request: bytes) -> bytes:
        """Function, first register, count: five bytes."""
        _need(len(request) == 5, ILLEGAL_VALUE)
        return request[:1] + self._status(_word(request, 1), _word(request, 3))

    def preset_multiple(self, request: bytes) -> bytes:
        """Function 16, first register, count, bytes to follow, values."""
        _need(len(request) >= 6, ILLEGAL_VALUE)
        self._write(_word(request, 1), _word(request, 3), request[5], request[6:], _MOST_WRITTEN)
        return request[:5]

    def _status(self, first: int, count: int) -> bytes:
        _need(1 <= count <= _MOST_READ, ILLEGAL_VALUE)
        return _listed(self._hand.read(_block(first, count, self.status_start), count))

    def _write(self, first: int, count: int, size: int, values: bytes, most: int) -> None:
        _need(1 <= count <= most and size == 2 * count == len(values), ILLEGAL_VALUE)
        self._hand.write(_block(first, count, self.command_start), _words(values))


class TcpGripper(_Registers):
    """Functions 4 and 16 alone; both blocks start at 0 (manual p. 75)."""

    command_start = 0x0000
    status_start = 0x0000

    def answer(self, request: bytes) -> bytes:
        function = request[0]
        if function == 4:
            return self.read(request)
        if function == 16:
            return self.preset_multiple(request)
        raise Unanswerable(ILLEGAL_FUNCTION)


class RtuGripper(_Registers):
    """Functions 3, 6, 16 (manual p. 59) and 23 (2018 p. 46)."""

    command_start = 0x03E8
    status_start = 0x07D0

    def answer(self, request: bytes) -> bytes:
        function = request[0]
        if function == 3:
            return self.read(request)
        if function == 6:
            _need(len(request) == 5, ILLEGAL_VALUE)
            self._write(_word(request, 1), 1, 2, request[3:], 1)
            return request
        if function == 16:
            return self.preset_multiple(request)
        if function == 23:
            return self._read_write(request)
        raise Unanswerable(ILLEGAL_FUNCTION)

    def _read_write(self, request: bytes) -> bytes:
        """The write comes first: read first, count, write first, count, size, values."""
        _need(len(request) >= 10, ILLEGAL_VALUE)
        first, count = _word(request, 5), _word(request, 7)
        self._write(first, count, request[9], request[10:], _MOST_WRITTEN_WITH_READ)
        return request[:1] + self._status(_word(request, 1), _word(request, 3))
