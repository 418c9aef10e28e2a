"""Small plots as numbers for a template to draw in SVG: no script, sharp on paper."""

import math
from collections.abc import Sequence

import msgspec

WIDTH, HEIGHT = 360, 200
LEFT, RIGHT, TOP, BOTTOM = 36.0, 350.0, 12.0, 164.0
TICKS = 5
MOST_POINTS = 200  # of a line: one in two pixels


class Tick(msgspec.Struct, frozen=True):
    """Where, in the plot's units, and what is written there."""

    at: float
    text: str


class Dot(msgspec.Struct, frozen=True):
    """A value with its interval, in the plot's units, and in words."""

    x: float
    y: float
    low: float
    high: float
    words: str


class Line(msgspec.Struct, frozen=True):
    """One of a plot: its name, `x,y x,y ...` of SVG, and dots on it. ``style``: a class of
    `page.css`; empty: the next of its colours."""

    name: str
    points: str
    dots: list[Dot] = []
    style: str = ""


class Span(msgspec.Struct, frozen=True):
    """A part of the x axis that is shaded, in the plot's units."""

    x: float
    width: float


class Plot(msgspec.Struct, frozen=True):
    """Everything that `plot()` of `page/plots.html` draws."""

    title: str
    x_label: str
    y_label: str
    x_ticks: list[Tick]
    y_ticks: list[Tick]
    lines: list[Line]
    spans: list[Span] = []


class Rate(msgspec.Struct, frozen=True):
    """Successes at one place of what was varied; ``interval`` is Wilson's, 95 %."""

    x: float
    label: str
    successes: int
    trials: int
    interval: tuple[float, float]


def shares(title: str, unit: str, named: Sequence[tuple[str, Sequence[float]]]) -> Plot | None:
    """Share of trials, of each name, that had come to a value by x; what never came is infinite and
    leaves its line below 100 %. None where nothing came."""
    finite = [v for _, values in named for v in values if math.isfinite(v)]
    if not finite:
        return None
    low, high = min(0.0, *finite), max(finite)
    high = high if high > low else low + 1.0
    lines = []
    for name, values in named:
        came = sorted(v for v in values if math.isfinite(v))
        if not came:
            continue
        steps = [(came[0], 0.0), *((v, (i + 1) / len(values)) for i, v in enumerate(came))]
        steps.append((high, len(came) / len(values)))
        every = max(1, len(steps) // MOST_POINTS)
        kept = [step for i, step in enumerate(steps) if i % every == 0 or i == len(steps) - 1]
        lines.append(Line(name, _stairs(kept, low, high)))
    return Plot(title, unit, "share of trials", _numbers(low, high), _percents(), lines)


def rates(title: str, unit: str, named: Sequence[tuple[str, Sequence[Rate]]]) -> Plot:
    """Success over what was varied: by number, or by place where it is no number."""
    known = {rate.x: rate.label for _, found in named for rate in found}
    low, high = min(known), max(known)
    margin = 0.04 * (high - low) or 0.5
    low, high = low - margin, high + margin
    lines = []
    for i, (name, found) in enumerate(named):
        aside = 2.0 * (i - (len(named) - 1) / 2)  # so that intervals do not hide one another
        dots = [
            Dot(
                round(_x(rate.x, low, high) + aside, 1),
                _y(rate.successes / rate.trials),
                _y(rate.interval[0]),
                _y(rate.interval[1]),
                f"{name}, {rate.label}: {rate.successes} of {rate.trials}",
            )
            for rate in sorted(found, key=lambda rate: rate.x)
            if rate.trials
        ]
        lines.append(Line(name, " ".join(f"{dot.x},{dot.y}" for dot in dots), dots))
    ticks = [Tick(_x(x, low, high), known[x]) for x in sorted(known)]
    return Plot(title, unit, "success, 95 %", apart(ticks), _percents(), lines)


def apart(ticks: Sequence[Tick]) -> list[Tick]:
    """Those that do not run into the one before."""
    kept: list[Tick] = []
    for tick in ticks:
        room = 3.2 * (len(tick.text) + len(kept[-1].text)) + 4.0 if kept else 0.0
        if not kept or tick.at - kept[-1].at >= room:
            kept.append(tick)
    return kept


def _stairs(steps: Sequence[tuple[float, float]], low: float, high: float) -> str:
    points, before = [], 0.0
    for x, y in steps:
        points += [f"{_x(x, low, high)},{_y(before)}", f"{_x(x, low, high)},{_y(y)}"]
        before = y
    return " ".join(points)


def _x(value: float, low: float, high: float) -> float:
    return round(LEFT + (value - low) / (high - low) * (RIGHT - LEFT), 1)


def _y(share: float) -> float:
    return round(BOTTOM - share * (BOTTOM - TOP), 1)


def _percents() -> list[Tick]:
    return [Tick(_y(share), f"{share:.0%}") for share in (0.0, 0.25, 0.5, 0.75, 1.0)]


def _numbers(low: float, high: float) -> list[Tick]:
    """About five round numbers."""
    rough = (high - low) / TICKS
    magnitude = 10.0 ** math.floor(math.log10(rough))
    step = next(m * magnitude for m in (1.0, 2.0, 5.0, 10.0) if m * magnitude >= rough)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [Tick(_x(i * step, low, high), f"{i * step:g}") for i in range(first, last + 1)]
