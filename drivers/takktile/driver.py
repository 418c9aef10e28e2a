"""Thread-free client of the TakkTile USB board: implements ``TactileSensor``.

The board is host-paced (see ``model``): the frame that a read brings was converted right after the
previous read, so at 100 Hz every sample is 10 ms old, and says so in ``sampled_ns``. ``reader``
keeps a read pending instead, in a thread, and gets younger samples.
"""

import msgspec

from drivers.errors import DeviceFault, LinkLost
from drivers.interfaces import TactileFrame
from drivers.takktile.board import Board, BoardLink, Codes, Transfer
from drivers.takktile.fingertips import FrameAssembly
from drivers.takktile.link import trouble
from drivers.takktile.model import BoardModel, Hung, Stall, Unplugged
from drivers.takktile.settings import TakkTileSettings


class TakkTileStatistics(msgspec.Struct, frozen=True):
    """Reads since the driver was made, by outcome."""

    frames: int
    timeouts: int
    wrong_lengths: int
    implausible: int  # a padding bit was set
    too_old: int  # converted longer ago than max_age_ms: nobody had read for a while


class ModelLink:
    """A ``BoardLink`` to a board model in this process."""

    def __init__(self, model: BoardModel) -> None:
        self._model = model

    def control(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        try:
            return self._model.control(request, value, index, length, now_ns)
        except (Stall, Unplugged, Hung) as error:
            raise _explain(error) from error

    def bulk_read(self, size: int, now_ns: int) -> Transfer | None:
        try:
            data = self._model.bulk_read(size, now_ns)
        except (Stall, Unplugged) as error:
            raise _explain(error) from error
        return None if data is None else Transfer(data, now_ns)


class TakkTileDriver:
    """FrameAssembly on one board. Call ``open`` once, then ``pump`` every 10 ms."""

    def __init__(self, link: BoardLink, settings: TakkTileSettings) -> None:
        self._board = Board(link, settings.conversion_ms)
        self._fingertips = FrameAssembly(settings)

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
    def statistics(self) -> TakkTileStatistics:
        return TakkTileStatistics(frames=self._fingertips.frames, **self._fingertips.missed)

    def open(self, now_ns: int) -> None:
        """Stop, drain, scan, check the map, start; forgets rest counts, also on re-opening."""
        self._fingertips.forget_rest()
        self._fingertips.arrange(self._board.open(now_ns))
        self._board.start(now_ns)

    def close(self, now_ns: int) -> None:
        """Stop sampling; ``open`` starts it again."""
        self._fingertips.forget_rest()
        self._board.close(now_ns)

    def begin_rest(self) -> None:
        self._fingertips.begin_rest(self._board.converted_ns)

    def pump(self, now_ns: int) -> None:
        """Read one sample; a missed one repeats the last frame.

        Raises ``LinkLost`` when the board is gone, ``DeviceFault`` when it stalls and ``Refused``
        when the sample completes rest counts that cannot be right.
        """
        self._fingertips.tick(self._board.read(now_ns), now_ns)


def _explain(error: Stall | Unplugged | Hung) -> DeviceFault | LinkLost:
    match error:
        case Stall():
            return trouble.stalled()
        case Hung():
            return LinkLost(trouble.HUNG, trouble.HUNG_REMEDY)
    return trouble.unplugged()
