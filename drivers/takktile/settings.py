"""Settings of the TakkTile driver."""

from typing import Annotated

import msgspec

from drivers.interfaces import KIT_TAXELS
from drivers.takktile.protocol import COLUMNS, ROWS

CellIndex = tuple[
    Annotated[int, msgspec.Meta(ge=0, lt=ROWS)], Annotated[int, msgspec.Meta(ge=0, lt=COLUMNS)]
]
MOST_TAXELS = ROWS * COLUMNS // 3  # of a finger: three share a board
FingerCells = Annotated[tuple[CellIndex, ...], msgspec.Meta(min_length=1, max_length=MOST_TAXELS)]
RestCode = Annotated[int, msgspec.Meta(ge=0, le=1023)]
FingerRest = tuple[RestCode, ...]


def _row(row: int) -> FingerCells:
    return tuple((row, column) for column in range(KIT_TAXELS))


class TakkTileSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the fingertips are wired to the board, and what the driver accepts from it."""

    cells: Annotated[
        tuple[FingerCells, FingerCells, FingerCells],
        msgspec.Meta(
            description="(row, column) of every taxel of fingers A, B, C, as many of each; "
            "assumed: row r is finger r in column order, the kit's wiring is not documented"
        ),
    ] = (_row(0), _row(1), _row(2))
    conversion_ms: Annotated[
        float,
        msgspec.Meta(
            ge=3.0,
            le=7.0,
            description="ms from the start of a conversion to its reading; the MPL115A2 needs up "
            "to 3 ms, and with 18 cells to read it must fit into 10 ms",
        ),
    ] = 3.0
    stale_after_missed: Annotated[
        int,
        msgspec.Meta(
            ge=1, le=100, description="missed samples in a row that make the sensor stale"
        ),
    ] = 5
    max_age_ms: Annotated[
        float,
        msgspec.Meta(
            ge=15.0,
            le=1000.0,
            description="ms since conversion above which a sample counts as missed: the board "
            "holds a frame for as long as nobody reads it; assumed, five periods of 100 Hz",
        ),
    ] = 50.0
    rest_samples: Annotated[
        int, msgspec.Meta(ge=50, le=1000, description="samples whose median is the rest code")
    ] = 50
    rest_max_std_counts: Annotated[
        float,
        msgspec.Meta(
            gt=0.0,
            le=20.0,
            description="counts, standard deviation of a taxel at rest; untouched taxels measure "
            "0.2 to 0.8 in the recordings of Grover et al. 2022",
        ),
    ] = 1.5
    rest_min_counts: Annotated[
        int,
        msgspec.Meta(
            ge=0,
            le=1023,
            description="lowest rest code of an unloaded taxel; unloaded parts read 420 to 480 "
            "(Grover et al. 2022), a loaded one reads lower",
        ),
    ] = 400
    rest_max_counts: Annotated[
        int,
        msgspec.Meta(ge=0, le=1023, description="highest rest code of an unloaded taxel; assumed"),
    ] = 512
    rest_reference: Annotated[
        tuple[FingerRest, FingerRest, FingerRest] | None,
        msgspec.Meta(
            description="rest codes of this hand on a known unloaded day, fingers A, B, C"
        ),
    ] = None
    rest_reference_tolerance_counts: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=100.0,
            description="counts that a rest code may differ from rest_reference; assumed, 10 K of "
            "warming (1.6 counts/K) and some weather (8 counts/kPa)",
        ),
    ] = 20.0

    @property
    def taxels(self) -> int:
        """Of a fingertip."""
        return len(self.cells[0])

    def __post_init__(self) -> None:
        counts = {len(finger) for finger in (*self.cells, *(self.rest_reference or ()))}
        if len(counts) > 1:
            raise ValueError("cells, rest_reference: every finger must have as many taxels")
        mapped = [cell for finger in self.cells for cell in finger]
        twice = {cell for cell in mapped if mapped.count(cell) > 1}
        if twice:
            raise ValueError(f"cells: {sorted(twice)} named for more than one taxel")
        if self.rest_min_counts >= self.rest_max_counts:
            raise ValueError(
                f"rest_min_counts {self.rest_min_counts} is not below rest_max_counts "
                f"{self.rest_max_counts}: no fingertip could rest"
            )


class UsbSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which board to open."""

    serial: Annotated[
        str, msgspec.Meta(description="serial number of the board; any: the first one found")
    ] = ""
    url: Annotated[
        str, msgspec.Meta(description="tcp://HOST:PORT of an emulated board; empty: the USB bus")
    ] = ""
