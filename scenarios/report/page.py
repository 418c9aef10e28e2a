"""Self-contained HTML pages (template, style, scripts and data in one file), and their tables and
small plots.

Text of a recording is not trusted: Jinja escapes it, data is embedded as JSON without `<`, and the
page's content security policy allows only the scripts that are embedded here.
"""

import base64
import hashlib
import math
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Self

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

PARTS = Path(__file__).parent / "page"
BEGINS = "<!doctype html>\n<!-- made by grasp report -->"  # to recognise a page made by this module
STYLES = ("uplot/uPlot.min.css", "page.css")


def render(template: str, scripts: Sequence[str], connect: str = "'none'", **context: Any) -> str:
    """Render a template of `page/` with scripts of that folder.

    ``connect``: the one address that scripts may contact. ``context``: variables of the template;
    its `data` becomes JSON for the scripts."""
    style = "\n".join(_part(name) for name in STYLES)
    script = "\n".join(_part(name) for name in scripts)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_fingerprint(style)}; "
        f"script-src {_fingerprint(script)}; connect-src {connect}; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _templates().get_template(template)
    # trusted text, not escaped
    parts = {"begins": Markup(BEGINS), "style": Markup(style), "script": Markup(script)}
    return page.render(**parts, policy=Markup(policy), **context)


@cache
def _part(name: str) -> str:
    return (PARTS / name).read_text("utf-8").strip()


def palette(name: str) -> str:
    """A colour of the pages' light scheme, such as ``finger0`` or ``limit``; raises
    KeyError for another name."""
    light, _, _ = _part("page.css").partition("@media")
    colours: dict[str, str] = dict(re.findall(r"--(\w+): ([^;]+)", light))
    return colours[name]


def _fingerprint(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _templates() -> Environment:
    return Environment(
        loader=FileSystemLoader(PARTS), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip


# Plots, which the template `table.html` draws as SVG without scripts

OF_PLOTS = (".chart", ".s0", ".soft", ".limit")  # begin the lines of their style
LEFT, RIGHT, TOP, BOTTOM = 44.0, 350.0, 12.0, 164.0
TICKS = 5


class Axis(msgspec.Struct, frozen=True):
    """An axis from ``low`` to ``high``; values outside are drawn at its ends. No tick is beyond
    ``last_tick``."""

    label: str
    low: float
    high: float
    last_tick: float = math.inf

    def share(self, value: float) -> float:
        """Position of a value, from 0 at ``low`` to 1 at ``high``."""
        inside = min(max(value, self.low), self.high)
        return (inside - self.low) / (self.high - self.low)

    def x(self, value: float) -> float:
        return round(LEFT + self.share(value) * (RIGHT - LEFT), 1)

    def y(self, value: float) -> float:
        return round(BOTTOM - self.share(value) * (BOTTOM - TOP), 1)

    def ticks(self, beyond: float = 1e-9) -> list[float]:
        """About five round numbers, also those less than ``beyond`` steps outside the axis."""
        rough = (self.high - self.low) / TICKS
        unit = 10.0 ** math.floor(math.log10(rough))
        step = next(m * unit for m in (1.0, 2.0, 5.0, 10.0) if m * unit >= rough * 0.999)
        first, last = math.ceil(self.low / step - beyond), math.floor(self.high / step + beyond)
        return [i * step for i in range(first, last + 1) if i * step <= self.last_tick]

    def rounded(self) -> Self:
        """The axis extended until a tick is at each end."""
        low, *_, high = self.ticks(1.0 - 1e-9)
        axis = type(self)(self.label, low, high)
        return axis if axis == self else axis.rounded()


class Mark(msgspec.Struct, frozen=True):
    """A highlighted point with its text and the interval of y: a dot, or a ring."""

    x: float
    y: float
    text: str
    low: float
    high: float
    hollow: bool = False


class Curve(msgspec.Struct, frozen=True):
    """A line of a plot. ``style``: a class of `page.css`; empty: the next colour."""

    name: str
    points: Sequence[tuple[float, float]]
    style: str = ""
    marks: Sequence[Mark] = ()


class Plot(msgspec.Struct, frozen=True):
    """A plot of curves; the ``spans`` of x are shaded. ``hint``: how to read it."""

    title: str
    x: Axis
    y: Axis
    curves: Sequence[Curve]
    spans: Sequence[tuple[float, float]] = ()
    hint: str = ""

    @property
    def height(self) -> int:
        """With the axis and two columns of the legend."""
        return 206 + 14 * math.ceil(len(self.curves) / 2)


def plot_svg(plot: Plot) -> str:
    """The plot as an SVG file, in colours that need no style sheet."""
    lines = [line for line in _part("page.css").splitlines() if line.startswith(OF_PLOTS)]
    style = re.sub(r"var\(--(\w+)\)", lambda name: palette(name[1]), "\n".join(lines))
    return _templates().get_template("plot.svg").render(it=plot, style=Markup(style))


# Tables


class Part(msgspec.Struct, frozen=True):
    """One outcome in a cell's strip. ``kind``: good, bad, excluded or error."""

    text: str
    share: float
    kind: str


class Cell(msgspec.Struct, frozen=True):
    """A table cell: text, with optional content below. ``interval``: low, middle and high of a
    share, drawn as a bar. ``at_s``: an instant of the run, which a click selects."""

    text: str = ""
    small: str = ""
    interval: tuple[float, float, float] | None = None
    parts: Sequence[Part] = ()
    links: Sequence[tuple[str, str]] = ()  # text and address
    code: bool = False
    at_s: float | None = None


class Table(msgspec.Struct, frozen=True):
    """A table; each row has one cell per heading, and the first cell is the row's name."""

    headings: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    hint: str = ""


class Section(msgspec.Struct, frozen=True):
    """A titled section with tables, then plots."""

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
    """The page as HTML. ``origins``: lines on versions and sources of the data."""
    context: dict[str, Any] = {
        "title": title, "facts": facts, "sentence": sentence, "sections": sections,
        "remarks": remarks, "origins": origins, "data": {},
    }  # fmt: skip
    return render("table.html", (), **context)
