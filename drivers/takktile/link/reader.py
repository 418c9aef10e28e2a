"""FrameAssembly read with a transfer always pending: the youngest samples that the board can give.

A poll every 10 ms gets frames 10 ms old, because the board converts after each read. A pending read
drains each frame the moment it is ready, at about 200 Hz; every tick takes the newest.
"""

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

import msgspec

from drivers.interfaces import TactileFrame
from drivers.takktile.board import Codes, Missed
from drivers.takktile.fingertips import FrameAssembly
from drivers.takktile.link.receiver import Connect, Receiver
from drivers.takktile.settings import TakkTileSettings


class ReaderStatistics(msgspec.Struct, frozen=True):
    """Since the reader was made."""

    frames: int  # used: at most one a tick
    decimated: int  # good frames that a newer one of the same tick replaced
    empty_ticks: int  # ticks without a new frame
    implausible: int  # a padding bit was set
    too_old: int
    timeouts: int
    wrong_lengths: int
    overruns: int  # frames lost because nobody pumped
    restarts: int  # recoveries by stopping and starting
    reopens: int  # recoveries by opening again: the rest counts were lost


class TactileReader:
    """A ``TactileSensor``; ``start`` and ``stop``, or use it as a context manager.

    ``connect`` gives a link to the board with a serial number, or to any board for None, for
    example ``UsbLink.find``. ``clock`` must be the one that ``pump`` is told the time of.
    """

    def __init__(
        self,
        connect: Connect,
        settings: TakkTileSettings,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._clock = clock
        self._receiver = Receiver(connect, settings, clock)
        self._fingertips = FrameAssembly(settings)
        self._opens = 0
        self._decimated = 0

    def start(self) -> Self:
        """Find and open the board, check the map, begin to read; raises what stands against it."""
        layout = self._receiver.start()
        self._opens = self._receiver.take().opens
        try:
            self._fingertips.arrange(layout)
        except BaseException:
            self._receiver.stop()
            raise
        return self

    def stop(self) -> None:
        """Stop the board and the thread; safe to call twice."""
        self._receiver.stop()
        self._fingertips.forget_rest()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self.stop()

    @property
    def frame(self) -> TactileFrame | None:
        return self._fingertips.frame

    @property
    def latest_raw(self) -> Codes | None:
        """(3, 6) int16 codes of the last good sample, rest or not; None before the first one."""
        return self._fingertips.latest_raw

    @property
    def rest_taken(self) -> bool:
        return self._fingertips.rest_taken

    @property
    def statistics(self) -> ReaderStatistics:
        counts = self._receiver.counts
        missed = self._fingertips.missed
        return ReaderStatistics(
            frames=self._fingertips.frames,
            decimated=self._decimated,
            empty_ticks=missed[Missed.TIMEOUT.value],
            implausible=missed[Missed.IMPLAUSIBLE.value],
            too_old=missed[Missed.TOO_OLD.value],
            **msgspec.structs.asdict(counts),
        )

    def begin_rest(self) -> None:
        # a sample whose conversion had begun before is not part of it
        self._fingertips.begin_rest(self._clock() + self._receiver.conversion_delay_ns)

    def pump(self, now_ns: int) -> None:
        """Take the newest sample; a tick without one repeats the last frame.

        Raises ``LinkLost`` or ``DeviceFault`` for as long as the board is being brought back, and
        ``Refused`` when the sample completes rest counts that cannot be right. After the board has
        been opened again there is no frame until the rest has been taken again.
        """
        batch = self._receiver.take()
        if batch.opens != self._opens:
            self._opens = batch.opens
            self._fingertips.forget_rest()
        self._decimated += max(0, len(batch.readings) - 1)
        self._fingertips.tick(batch.readings[-1] if batch.readings else Missed.TIMEOUT, now_ns)
        if batch.error is not None:
            raise type(batch.error)(batch.error.message, batch.error.remedy)
