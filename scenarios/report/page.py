"""Pages that open from disk: template, style, scripts and data in one file that loads nothing, and
the tables and small plots on them.

Text of a recording is not trusted: Jinja escapes it, data travel as JSON without `<`, and the
page's policy lets a browser run only the scripts that were put in here.
"""

import base64
import hashlib
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

PARTS = Path(__file__).parent / "page"
BEGINS = "<!doctype html>\n<!-- made by grasp report -->"  # how a page of ours is told from others
STYLES = ("uplot/uPlot.min.css", "page.css")


def render(template: str, scripts: Sequence[str], connect: str = "'none'", **context: Any) -> str:
    """The page of a template in `page/`, with scripts of that folder. ``connect``: the one address
    that they may contact. ``context`` goes to the template; its `data` becomes JSON for scripts."""
    style = "\n".join(_part(name) for name in STYLES)
    script = "\n".join(_part(name) for name in scripts)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_fingerprint(style)}; "
        f"script-src {_fingerprint(script)}; connect-src {connect}; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _templates().get_template(template)
    # none of this is foreign text
    own = {"begins": Markup(BEGINS), "style": Markup(style), "script": Markup(script)}
    return page.render(**own, policy=Markup(policy), **context)


@cache
def _part(name: str) -> str:
    return (PARTS / name).read_text("utf-8").strip()


def _fingerprint(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _templates() -> Environment:
    return Environment(
        loader=FileSystemLoader(PARTS), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip


# Plots: numbers that the template `table.html` draws in SVG, without scripts

LEFT, RIGHT, TOP, BOTTOM = 36.0, 350.0, 12.0, 164.0
TICKS = 5


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
        unit = 10.0 ** math.floor(math.log10(rough))
        step = next(m * unit for m in (1.0, 2.0, 5.0, 10.0) if m * unit >= rough * 0.999)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [i * step for i in range(first, last + 1)]


class Curve(msgspec.Struct, frozen=True):
    """A line of a plot. ``style``: a class of `page.css`; empty: the next of its colours. ``dot``:
    a point on it."""

    name: str
    points: Sequence[tuple[float, float]]
    style: str = ""
    dot: tuple[float, float] | None = None


class Plot(msgspec.Struct, frozen=True):
    """``spans`` of x are shaded."""

    title: str
    x: Axis
    y: Axis
    curves: Sequence[Curve]
    spans: Sequence[tuple[float, float]] = ()


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
