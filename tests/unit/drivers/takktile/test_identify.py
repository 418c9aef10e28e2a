"""Identification of the pressed taxel by the fall from its rest code, in virtual time."""

from collections.abc import Sequence

import numpy as np

from drivers.takktile import identify
from drivers.takktile.identify import REST_FRAMES, TaxelPress
from drivers.takktile.model.board import BoardModel
from drivers.takktile.model.link import ModelUsb
from drivers.takktile.settings import BoardModelSettings, TakkTileSettings

MS = 1_000_000
REST = 400 + np.arange(18)  # rest codes
LEAST = 20

Press = tuple[int, int]  # cell in board order, and how far its code falls


class Fingertips:
    """A board that is read every 10 ms: at rest until rest is taken, then one press per frame."""

    def __init__(
        self, presses: Sequence[Press] = (), cells: Sequence[tuple[int, int]] | None = None
    ) -> None:
        settings = BoardModelSettings() if cells is None else BoardModelSettings(cells=tuple(cells))
        self.board = BoardModel(settings, self._sample)
        self.now_ns = 0
        self._cells = len(settings.cells)
        self._presses = iter(presses)
        self._rested = False

    def _sample(self, t_ns: int):
        codes = REST[: self._cells].astype(np.int16)
        cell, fall = next(self._presses, (0, 0)) if self._rested else (0, 0)
        codes[cell] -= fall
        return lambda: (codes, np.full(self._cells, 500, np.int16))

    def _clock(self) -> int:
        self.now_ns += 10 * MS
        return self.now_ns

    def _rest_taken(self) -> None:
        self._rested = True

    def identified(self, seconds: float = 1.0) -> list[TaxelPress]:
        return list(
            identify.watch(
                ModelUsb(self.board), TakkTileSettings(), seconds, self._rest_taken, LEAST,
                self._clock,
            )
        )  # fmt: skip


def of(*presses: Press) -> list[tuple[int, int, int]]:
    """Row, column and fall of the identified presses."""
    return [(p.row, p.column, p.fall_counts) for p in Fingertips(presses).identified()]


def test_a_press_is_identified_with_its_cell_and_finger() -> None:
    assert Fingertips([(10, 30)]).identified() == [TaxelPress(1, 4, 30, "B", 4)]


def test_a_press_is_reported_once_and_again_when_it_is_stronger_or_another() -> None:
    for presses, reported in [
        ([(4, LEAST - 1)], []),
        ([(4, LEAST)], [(0, 4, LEAST)]),
        ([(4, -200)], []),  # a rising code is not a press
        ([(4, 30), (4, 30), (4, 29), (4, 31)], [(0, 4, 30), (0, 4, 31)]),  # stronger than before
        ([(4, 30), (5, 25)], [(0, 4, 30), (0, 5, 25)]),  # another cell
        ([(4, 30), (4, 0), (4, 25)], [(0, 4, 30), (0, 4, 25)]),  # released between them
    ]:
        assert of(*presses) == reported, (presses, reported)


def test_identification_ends_after_its_time_and_stops_the_board() -> None:
    fingertips = Fingertips()
    assert fingertips.identified(seconds=2.0) == []
    assert fingertips.board.ready_ns is None
    assert 2.0 <= fingertips.now_ns * 1e-9 - REST_FRAMES * 0.02 <= 2.2  # two readings a frame
