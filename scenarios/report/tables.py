"""Tables and small plots of a page that shows many trials: what `page/table.html` draws. Plots are
numbers that the template draws in SVG: no script, sharp on paper."""

import math
from collections.abc import Sequence
from typing import Any

import msgspec

from scenarios.report.page import render

LEFT, RIGHT, TOP, BOTTOM = 36.0, 350.0, 12.0, 164.0
TICKS = 5


class Tick(msgspec.Struct, frozen=True):
    """Where, in the plot's units, and what is written there."""

    at: float
    text: str


class Line(msgspec.Struct, frozen=True):
    """One of a plot: its name, `x,y x,y ...` of SVG. ``style``: a class of `page.css`; empty: the
    next of its colours. ``dot``: a point on it."""

    name: str
    points: str
    style: str
    dot: tuple[float, float] | None


class Plot(msgspec.Struct, frozen=True):
    """Everything that `plot()` of `page/table.html` draws. ``spans``: shaded, x and width."""

    title: str
    x_label: str
    y_label: str
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    lines: list[Line]
    spans: list[tuple[float, float]]


class Axis(msgspec.Struct, frozen=True):
    """From ``low`` to ``high``, what lies beyond drawn at the edge. ``log``: by decades."""

    label: str
    low: float
    high: float
    log: bool = False

    def share(self, value: float) -> float:
        """Where a value stands, from 0 at ``low`` to 1 at ``high``."""
        inside = min(max(value, self.low), self.high)
        if self.log:
            return math.log(inside / self.low) / math.log(self.high / self.low)
        return (inside - self.low) / (self.high - self.low)

    def x(self, value: float) -> float:
        return round(LEFT + self.share(value) * (RIGHT - LEFT), 1)

    def y(self, value: float) -> float:
        return round(BOTTOM - self.share(value) * (BOTTOM - TOP), 1)

    def ticks(self) -> list[float]:
        """About five round numbers, or the powers of ten."""
        if self.log:
            first, last = math.ceil(math.log10(self.low)), math.floor(math.log10(self.high))
            return [10.0**i for i in range(first, last + 1)]
        rough = (self.high - self.low) / TICKS
        magnitude = 10.0 ** math.floor(math.log10(rough))
        step = next(m * magnitude for m in (1.0, 2.0, 5.0, 10.0) if m * magnitude >= rough * 0.999)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [i * step for i in range(first, last + 1)]


class Curve(msgspec.Struct, frozen=True):
    """What `curves` draws as a line."""

    name: str
    points: Sequence[tuple[float, float]]
    style: str = ""
    dot: tuple[float, float] | None = None


def curves(
    title: str, x: Axis, y: Axis, drawn: Sequence[Curve], spans: Sequence[tuple[float, float]] = ()
) -> Plot:
    """A plot. ``spans`` of x are shaded."""
    lines = [
        Line(
            c.name, " ".join(f"{x.x(at)},{y.y(value)}" for at, value in c.points), c.style,
            c.dot and (x.x(c.dot[0]), y.y(c.dot[1])),
        )
        for c in drawn
    ]  # fmt: skip
    return Plot(
        title, x.label, y.label,
        [Tick(x.x(at), f"{at:g}") for at in x.ticks()],
        [Tick(y.y(at), f"{at:g}") for at in y.ticks()], lines,
        [(x.x(a), round(x.x(b) - x.x(a), 1)) for a, b in spans if b >= x.low and a <= x.high],
    )  # fmt: skip


# Tables


class Part(msgspec.Struct, frozen=True):
    """One outcome of a cell, as a share of a strip. ``kind``: good, bad, apart or error."""

    text: str
    share: float
    kind: str


class Cell(msgspec.Struct, frozen=True):
    """One of a table: text, with what may stand below it. ``interval``: low, middle and high of a
    share, drawn as a bar."""

    text: str = ""
    small: str = ""
    interval: tuple[float, float, float] | None = None
    parts: Sequence[Part] = ()
    links: Sequence[tuple[str, str]] = ()  # text and address
    code: bool = False


class Table(msgspec.Struct, frozen=True):
    """Its rows as long as its headings; the first cell of a row is its name."""

    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    hint: str = ""


class Section(msgspec.Struct, frozen=True):
    """Tables, then plots, under a title."""

    title: str
    tables: Sequence[Table] = ()
    plots: Sequence[Plot] = ()
    hint: str = ""
    code: str = ""


def cells(*texts: str) -> list[Cell]:
    return [Cell(text) for text in texts]


def table_page(
    title: str, facts: str, sentence: str, sections: Sequence[Section],
    remarks: Sequence[str] = (), origins: Sequence[str] = (),
) -> str:  # fmt: skip
    """The page. ``origins``: lines on where it comes from."""
    context: dict[str, Any] = {
        "title": title, "facts": facts, "sentence": sentence, "sections": sections,
        "remarks": remarks, "origins": origins, "data": {},
    }  # fmt: skip
    return render("table.html", (), **context)
