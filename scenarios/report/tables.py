"""Tables and plots of a page that shows many trials: what `page/table.html` draws."""

from collections.abc import Sequence
from typing import Any

import msgspec

from scenarios.report.charts import Plot
from scenarios.report.page import render


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
