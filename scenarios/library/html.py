"""Results as a notebook shows them: a sentence, a small picture, a table; no script, no request."""

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from scenarios.report.run_record import RunRecord

WIDTH, HEIGHT = 640, 90
MOST_POINTS = 320
COLOURS = ("#c0392b", "#2471a3", "#1e8449")  # of fingers A, B, C
Floats = NDArray[np.float64]


def table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table of HTML; everything in it is escaped."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(str(value))}</td>' for value in row)}</tr>" for row in rows
    )
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table>"
    )


def trial(run: RunRecord, verdict: str) -> str:
    """The verdict, and force and probability of slip over the run, with limit and threshold."""
    known = run.truth is not None
    force_n = run.felt_n if run.truth is None else run.truth.normal_n
    rule = run.config.rule
    what = "true force" if known else "felt force"
    limit_n = run.config.guard.force_limit_n
    plots = (
        picture(f"{what}, N (limit {limit_n:g})", run.t_s, force_n, limit_n, 1.2 * limit_n),
        picture(f"slip probability (threshold {rule.threshold:g})", run.t_s, run.probabilities,
                rule.threshold, 1.0),
    )  # fmt: skip
    return f"<div><p>{escape(verdict)}</p>{''.join(plots)}</div>"


def picture(title: str, t_s: Floats, values: Floats, bound: float, high: float) -> str:
    """An SVG of (n, 3) values from 0 to ``high`` over (n,) times, with a dashed line at a bound."""
    every = max(1, len(t_s) // MOST_POINTS)
    x = np.interp(t_s[::every], (t_s[0], t_s[-1]), (0, WIDTH))
    lines = "".join(
        f'<path d="{_path(x, values[::every, finger], high)}" fill="none" stroke="{colour}"/>'
        for finger, colour in enumerate(COLOURS)
    )
    at = HEIGHT * (1.0 - bound / high)
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT + 16}" width="{WIDTH}" role="img">'
        f"<title>{escape(title)}</title>"
        f'<text y="{HEIGHT + 13}" font-size="11" fill="currentColor">{escape(title)}, '
        f"{t_s[0]:.1f} to {t_s[-1]:.1f} s; A red, B blue, C green</text>"
        f'<line x1="0" x2="{WIDTH}" y1="{at:.1f}" y2="{at:.1f}" stroke="gray" '
        f'stroke-dasharray="4"/>{lines}</svg>'
    )


def _path(x: Floats, values: Floats, high: float) -> str:
    """Points that are known, joined; a gap begins a new stroke."""
    y = HEIGHT * (1.0 - np.clip(values, 0.0, high) / high)
    words, drawn = list[str](), False
    for at, down in zip(x, y, strict=True):
        known = bool(np.isfinite(down))
        if known:
            words.append(f"{'L' if drawn else 'M'}{at:.1f} {down:.1f}")
        drawn = known
    return "".join(words)
