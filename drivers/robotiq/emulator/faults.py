"""What can go wrong on the emulated wire, planned by time or by count of requests."""

import threading
from enum import Enum
from typing import Annotated

import msgspec

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
