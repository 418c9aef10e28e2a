"""The thread that keeps a read pending on the board.

A read drains each frame the moment it is ready, at about 200 Hz; a tick takes the newest.
"""

import threading
import time
from collections.abc import Callable

from drivers.errors import DeviceFault
from drivers.takktile.protocol import Layout
from drivers.takktile.receiver import Connect, Readings, Receiver, ReceiverCounts
from drivers.takktile.settings import TakkTileSettings

_JOIN_S = 4.0  # some control requests to a hung board, each with its time-out


class ReadingThread:
    """A ``FrameLink`` in wall time: pumps a ``Receiver``, whose reads block until a frame comes.

    ``connect`` gives the board with a serial number, or any board for None, for example
    ``UsbLink.find``. ``clock`` must be the one that ``pump`` is told the time of.
    """

    def __init__(
        self,
        connect: Connect,
        settings: TakkTileSettings,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._receiver = Receiver(connect, settings.conversion_ms, clock)
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()

    @property
    def counts(self) -> ReceiverCounts:
        return self._receiver.counts

    @property
    def converting_ns(self) -> int:
        return self._receiver.converting_ns

    def take(self) -> Readings:
        return self._receiver.take()

    def start(self) -> Layout:
        layout = self._receiver.open()
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
        receiver = self._receiver
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
