"""The fingertips, thread-free: implements ``TactileSensor`` on whatever link brings frames.

The board is host-paced: it converts after each read, so a poll every 10 ms would get frames 10 ms
old. Every link therefore keeps a read pending, and ``pump`` takes the newest of what has come.
"""

from types import TracebackType
from typing import Protocol, Self

import msgspec

from drivers.interfaces import TactileFrame
from drivers.takktile.board import Codes, Missed
from drivers.takktile.fingertips import FrameAssembly
from drivers.takktile.protocol import Layout
from drivers.takktile.receiver import Readings, ReceiverCounts
from drivers.takktile.settings import TakkTileSettings


class FrameLink(Protocol):
    """Brings frames of a board, by ``receiver``: ``link.thread`` in wall time, a model's link in
    virtual time."""

    @property
    def counts(self) -> ReceiverCounts: ...

    @property
    def converting_ns(self) -> int:
        """What time the conversion tells of that now goes on."""
        ...

    def start(self) -> Layout:
        """Find and open the board and begin to read; raises what stands against it."""
        ...

    def stop(self) -> None:
        """Stop reading and stop the board; safe to call twice."""
        ...

    def take(self) -> Readings:
        """What has come since the last time; never waits."""
        ...


class TakkTileStatistics(msgspec.Struct, frozen=True):
    """Since the driver was made."""

    frames: int  # used: at most one a tick
    decimated: int  # good frames that a newer one of the same tick replaced
    empty_ticks: int  # ticks without a new frame
    implausible: int  # a padding bit was set
    too_old: int  # converted longer ago than max_age_ms
    timeouts: int
    wrong_lengths: int
    overruns: int  # frames lost because nobody pumped
    restarts: int  # recoveries by stopping and starting
    reopens: int  # recoveries by opening again: the rest counts were lost


class TakkTileDriver:
    """Fingertips on one board; ``start`` and ``stop``, or use it as a context manager.

    Call ``pump`` every 10 ms.
    """

    def __init__(self, link: FrameLink, settings: TakkTileSettings) -> None:
        self._link = link
        self._fingertips = FrameAssembly(settings)
        self._opens = 0
        self._decimated = 0

    def start(self) -> Self:
        """Open the board, check the map, begin to read; raises what stands against it."""
        layout = self._link.start()
        self._opens = self._link.take().opens
        try:
            self._fingertips.arrange(layout)
        except BaseException:
            self._link.stop()
            raise
        return self

    def stop(self) -> None:
        """Stop the board; safe to call twice."""
        self._link.stop()
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
        """(3, taxels) int16 codes of the last good sample, rest or not; None before the first."""
        return self._fingertips.latest_raw

    @property
    def rest_taken(self) -> bool:
        return self._fingertips.rest_taken

    @property
    def statistics(self) -> TakkTileStatistics:
        missed = self._fingertips.missed
        return TakkTileStatistics(
            frames=self._fingertips.frames,
            decimated=self._decimated,
            empty_ticks=missed[Missed.TIMEOUT.value],
            implausible=missed[Missed.IMPLAUSIBLE.value],
            too_old=missed[Missed.TOO_OLD.value],
            **msgspec.structs.asdict(self._link.counts),
        )

    def begin_rest(self) -> None:
        # a sample whose conversion had begun before is not part of it
        self._fingertips.begin_rest(self._link.converting_ns)

    def pump(self, now_ns: int) -> None:
        """Take the newest sample; a tick without one repeats the last frame.

        Raises ``LinkLost`` or ``DeviceFault`` for as long as the board is being brought back, and
        ``Refused`` when the sample completes rest counts that cannot be right. After the board has
        been opened again there is no frame until the rest has been taken again.
        """
        batch = self._link.take()
        if batch.opens != self._opens:
            self._opens = batch.opens
            self._fingertips.forget_rest()
        self._decimated += max(0, len(batch.readings) - 1)
        self._fingertips.tick(batch.readings[-1] if batch.readings else Missed.TIMEOUT, now_ns)
        if batch.error is not None:
            raise type(batch.error)(batch.error.message, batch.error.remedy)
