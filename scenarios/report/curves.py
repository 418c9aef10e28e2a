"""Small plots of numbers against numbers, beside `charts.py`: lines, dots, shaded spans."""

import itertools
import math
from collections.abc import Sequence

import msgspec

from scenarios.report.charts import BOTTOM, LEFT, RIGHT, TOP, Dot, Line, Plot, Span, Tick, apart

TICKS = 5


class Axis(msgspec.Struct, frozen=True):
    """From ``low`` to ``high``, what lies beyond drawn at the edge; logarithmic where both are
    positive and ``log`` says so."""

    label: str
    low: float
    high: float
    log: bool = False

    def share(self, value: float) -> float:
        """Where a value stands, from 0 at ``low`` to 1 at ``high``."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        at = self._scaled(min(max(value, self.low), self.high))
        return (at - low) / (high - low)

    def ticks(self) -> list[float]:
        """Whole decades, or about five round numbers."""
        if self.log:
            first, last = math.ceil(math.log10(self.low)), math.floor(math.log10(self.high))
            return [10.0**i for i in range(first, last + 1)]
        rough = (self.high - self.low) / TICKS
        magnitude = 10.0 ** math.floor(math.log10(rough))
        step = next(m * magnitude for m in (1.0, 2.0, 5.0, 10.0) if m * magnitude >= rough * 0.999)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [i * step for i in range(first, last + 1)]

    def _scaled(self, value: float) -> float:
        return math.log10(value) if self.log else value


class Mark(msgspec.Struct, frozen=True):
    """A dot with an interval of y, and its words."""

    x: float
    y: float
    low: float
    high: float
    words: str


class Curve(msgspec.Struct, frozen=True):
    """One of a plot. ``stairs``: its y holds until the next x. ``style``: a class of `page.css` in
    place of the next colour."""

    name: str
    points: Sequence[tuple[float, float]] = ()
    marks: Sequence[Mark] = ()
    stairs: bool = False
    style: str = ""


def curves(
    title: str, x: Axis, y: Axis, drawn: Sequence[Curve],
    spans: Sequence[tuple[float, float]] = (), places: dict[float, str] | None = None,
) -> Plot:  # fmt: skip
    """A plot. ``spans`` of x are shaded; ``places``: names of some x in place of numbers."""
    named = places if places is not None else {at: f"{at:g}" for at in x.ticks()}
    return Plot(
        title,
        x.label,
        y.label,
        apart([Tick(_x(at, x), text) for at, text in sorted(named.items())]),
        [Tick(_y(at, y), f"{at:g}") for at in y.ticks()],
        [_line(curve, x, y) for curve in drawn],
        [
            Span(_x(low, x), round(_x(high, x) - _x(low, x), 1))
            for low, high in spans
            if high >= x.low and low <= x.high
        ],
    )


def _line(curve: Curve, x: Axis, y: Axis) -> Line:
    points = [(_x(at, x), _y(value, y)) for at, value in curve.points]
    if curve.stairs:
        corners = [(after[0], before[1]) for before, after in itertools.pairwise(points)]
        points = [p for pair in zip(points, [*corners, points[-1]], strict=True) for p in pair]
    dots = [Dot(_x(m.x, x), _y(m.y, y), _y(m.low, y), _y(m.high, y), m.words) for m in curve.marks]
    return Line(curve.name, " ".join(f"{a},{b}" for a, b in points), dots, curve.style)


def _x(value: float, axis: Axis) -> float:
    return round(LEFT + axis.share(value) * (RIGHT - LEFT), 1)


def _y(value: float, axis: Axis) -> float:
    return round(BOTTOM - axis.share(value) * (BOTTOM - TOP), 1)
