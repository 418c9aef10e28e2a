"""Settings of the TakkTile driver and of its connection."""

from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import KIT_TAXELS
from drivers.takktile.protocol import COLUMNS, ROWS, Cell

MAX_TAXELS = ROWS * COLUMNS // 3  # of a finger: three share a board
REST_SAMPLES = 50  # the rest code is their median
REST_REFERENCE_TOLERANCE_COUNTS = 20.0  # assumed: 10 K of warming (1.6 counts/K), air pressure
FingerCells = Annotated[tuple[Cell, ...], Meta(min_length=1, max_length=MAX_TAXELS)]
FingerRest = tuple[int, ...]


def _row(row: int) -> FingerCells:
    return tuple((row, column) for column in range(KIT_TAXELS))


class TakkTileSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Wiring of the fingertips to the board, and limits of valid data."""

    cells: Annotated[
        tuple[FingerCells, FingerCells, FingerCells],
        Meta(
            description="(row, column) of every taxel of fingers A, B, C, equally many of each; "
            "assumed: row r is finger r in column order, the kit's wiring is not documented"
        ),
    ] = (_row(0), _row(1), _row(2))
    rest_reference: Annotated[
        tuple[FingerRest, FingerRest, FingerRest] | None,
        Meta(description="codes of this unloaded hand, fingers A, B, C; null: unknown"),
    ] = None
    conversion_ms: Annotated[
        float,
        Meta(
            ge=3, le=7, description="ms from the start of a conversion to its reading; MPL115A2: 3"
        ),
    ] = 3.0  # conversion and reading of 18 cells must fit into 10 ms
    stale_after_missed: Annotated[
        int, Meta(ge=1, le=100, description="missed samples in a row that make the sensor stale")
    ] = 5
    max_age_ms: Annotated[
        float, Meta(ge=15, le=1000, description="older samples count as missed; assumed, 5 periods")
    ] = 50.0  # the board keeps a frame until it is read
    rest_max_std_counts: Annotated[
        float, Meta(gt=0, le=20, description="counts, std of a taxel at rest; Grover 2022: 0.8")
    ] = 1.5
    rest_min_counts: Annotated[
        int, Meta(ge=0, le=1023, description="lowest code of an unloaded taxel; Grover 2022: 420")
    ] = 400  # a loaded taxel reads lower
    rest_max_counts: Annotated[
        int, Meta(ge=0, le=1023, description="highest code of an unloaded taxel; assumed")
    ] = 512

    @property
    def taxels(self) -> int:
        """Number of taxels of a fingertip."""
        return len(self.cells[0])

    def __post_init__(self) -> None:
        counts = {len(finger) for finger in (*self.cells, *(self.rest_reference or ()))}
        if len(counts) > 1:
            raise ValueError("cells, rest_reference: all fingers must have equally many taxels")
        mapped = [cell for finger in self.cells for cell in finger]
        if any(row not in range(ROWS) or column not in range(COLUMNS) for row, column in mapped):
            raise ValueError(f"cells: a row is 0 to {ROWS - 1}, a column 0 to {COLUMNS - 1}")
        twice = {cell for cell in mapped if mapped.count(cell) > 1}
        if twice:
            raise ValueError(f"cells: {sorted(twice)} named for more than one taxel")
        if self.rest_min_counts >= self.rest_max_counts:
            raise ValueError(
                f"rest_min_counts {self.rest_min_counts} is not below rest_max_counts "
                f"{self.rest_max_counts}: no fingertip could rest"
            )


class UsbSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """USB board to open."""

    serial: Annotated[
        str, Meta(description="serial number of the USB board; any: the first board found")
    ] = ""
    url: Annotated[
        str, Meta(description="tcp://HOST:PORT of an emulated board; empty: the USB board")
    ] = ""


class BoardModelSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Properties that differ between boards."""

    cells: Annotated[
        tuple[Cell, ...],
        Meta(min_length=1, description="(row, column) of the board's cells, in row-major order"),
    ] = tuple((row, column) for row in range(3) for column in range(6))  # the Robotiq kit
