"""A gripper on Modbus RTU: the model behind a pseudo-terminal, with framing and CRC of its own.

Slave 9 alone is answered, and errors are answered by silence (Robotiq 3-Finger manual, 2014 p. 59).
Frame layout and CRC: Modbus over serial line V1.02, 2.5.1.
"""

import contextlib
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from typing import Final, Self

from drivers.robotiq.emulator.pdu import (
    Guard,
    RtuGripper,
    Trouble,
    Unanswerable,
    WireFault,
    WireFaults,
    damaged,
)
from drivers.robotiq.emulator.tcp import OnFrame, hand_of
from drivers.robotiq.model.gripper import GripperModel, HandSettings

SLAVE: Final = 9
_SILENCE_S: Final = 0.05  # ends a frame that is not whole; far above 3.5 characters, as on a PC
_KEEP_UP_S: Final = 0.01
_JOIN_S: Final = 5.0
_MOST_BYTES: Final = 4096
_SHORT: Final = 8  # slave, function, two words, CRC
_SIZE_AT: Final = {16: 6, 23: 10}  # where a request tells how many bytes of values follow


def crc(data: bytes) -> bytes:
    """Cyclic redundancy check as it stands at the end of a frame, low byte first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ (0xA001 if register & 1 else 0)
    return register.to_bytes(2, "little")


def _frame_length(received: bytes | bytearray) -> int | None:
    """Length of the request that the bytes begin with; None until they tell."""
    if len(received) < 2:
        return None
    at = _SIZE_AT.get(received[1])
    if at is None:
        return _SHORT
    return at + 1 + received[at] + 2 if len(received) > at else None


class RtuEmulator:
    """Serves a hand on a pseudo-terminal, from a thread of its own; ``port`` is its name.

    Arguments are those of ``GripperEmulator``.
    """

    def __init__(
        self,
        model: GripperModel | HandSettings,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        lock: Guard | None = None,
        advance: Callable[[int], None] | None = None,
        on_frame: OnFrame | None = None,
    ) -> None:
        self.hand = hand_of(model, clock, lock, advance)
        self.faults = WireFaults()
        self.port = ""
        self.requests = 0
        self._gripper = RtuGripper(self.hand)
        self._on_frame = on_frame
        self._received = bytearray()
        self._master = self._slave = -1
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> Self:
        """Open the pseudo-terminal and serve it."""
        self._master, self._slave = os.openpty()  # our end of the slave keeps the line open
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, name="gripper-rtu-emulator")
        self._thread.start()
        return self

    def stop(self) -> None:
        """End the thread and close the pseudo-terminal."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stopping.set()
        thread.join(_JOIN_S)
        os.close(self._master)
        os.close(self._slave)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        heard_s = time.monotonic()
        readable = select.poll()
        readable.register(self._master, select.POLLIN)
        while not self._stopping.is_set():
            ready = readable.poll(_KEEP_UP_S * 1e3)
            self.hand.keep_up()
            now_s = time.monotonic()
            if ready:
                self._received += os.read(self._master, _MOST_BYTES)
                heard_s = now_s
                self._serve_all()
            elif now_s - heard_s > _SILENCE_S:
                self._received.clear()

    def _serve_all(self) -> None:
        while (length := _frame_length(self._received)) is not None:
            if len(self._received) < length:
                return
            frame = bytes(self._received[:length])
            del self._received[:length]
            if crc(frame[:-2]) != frame[-2:]:
                self._received.clear()  # the next frame begins after a silence
            elif frame[0] == SLAVE:
                self._serve(frame)

    def _serve(self, frame: bytes) -> None:
        self.requests += 1
        if self._on_frame is not None:
            self._on_frame(frame)
        fault = self.faults.take(frame[1], self.hand.clock())
        if fault is None:
            self._send(self._reply(frame))
        elif fault.trouble not in (Trouble.DISCONNECT, Trouble.EXCEPTION):
            self._hit(frame, fault)

    def _hit(self, frame: bytes, fault: WireFault) -> None:
        """Troubles of a request that is carried out all the same; the line waits meanwhile."""
        if fault.trouble is Trouble.FREEZE:
            self._stopping.wait(fault.seconds)
        elif fault.trouble is Trouble.DEVICE_FAULT:
            self.hand.inject_fault(fault.code)
        reply = self._reply(frame)
        if fault.trouble is Trouble.DELAY:
            self._stopping.wait(fault.seconds)
        elif fault.trouble is Trouble.GARBLE:
            reply = damaged(reply)
        if fault.trouble is Trouble.SPLIT:
            for at in range(len(reply)):
                self._send(reply[at : at + 1])
                self._stopping.wait(fault.seconds)
        elif fault.trouble is not Trouble.DROP:
            self._send(reply)

    def _reply(self, frame: bytes) -> bytes:
        """Empty where the gripper is silent."""
        try:
            answer = bytes([SLAVE]) + self._gripper.answer(frame[1:-2])
        except Unanswerable:
            return b""
        return answer + crc(answer)

    def _send(self, data: bytes) -> None:
        """What nobody reads is lost, as on a line."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)
