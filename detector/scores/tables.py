"""The paper's tables of detection, its figures beside ours.

Theirs are of a real fingertip, ours of a simulated one: two columns, no contest.
"""

from collections.abc import Mapping, Sequence

from detector.scores.cells import ROWS, SURFACES, Cell, CellTable, Estimate, Key, Row
from detector.scores.evaluation import Evaluation
from detector.scores.variance import Variance

# accuracy, precision, recall, F1, each weighted over both classes, per cent
PAPER_METHODS = {
    "psd": (57.4, 57.9, 57.4, 57.5),
    "freq-cnn-paper": (86.0, 86.0, 86.0, 86.0),
    "tcn-paper": (91.3, 91.4, 91.4, 91.4),
}
# weighted F1 of the TCN, per cent, a column a surface
PAPER_CELLS = {
    ("primary", 0.05): (92.5, 88.8, 78.7, 94.0),
    ("primary", 0.075): (94.9, 88.0, 90.0, 90.3),
    ("primary", 0.1): (95.7, 84.5, 87.8, 92.1),
    ("oblique", 0.05): (94.0, 88.9, 87.1, 93.2),
    ("oblique", 0.075): (96.6, 89.3, 93.7, 92.2),
    ("oblique", 0.1): (96.4, 88.6, 93.5, 93.4),
    ("rotation", 0.0): (84.6, 74.5, 84.0, 86.1),
}
PAPER_OF_ROWS = {
    ("primary", 0.05): 89.7, ("primary", 0.075): 91.6, ("primary", 0.1): 93.1,
    ("oblique", 0.05): 91.5, ("oblique", 0.075): 93.1, ("oblique", 0.1): 93.8,
    ("rotation", 0.0): 81.5,
}  # fmt: skip
PAPER_OF_SURFACES = (94.0, 88.9, 88.0, 91.9)
STATEMENT = (
    "The paper's figures are of a real fingertip, ours of a simulated one: they cannot be compared "
    "with one another, only within their column."
)


def methods_table(sheets: Sequence[Evaluation]) -> str:
    """Table II as Markdown: a row a detector, `theirs | ours`."""
    lines = [
        "| detector | accuracy | precision | recall | F1 |",
        "|---|---|---|---|---|",
    ]
    for s in sheets:
        ours = [100 * v for v in (s.accuracy, s.weighted_precision, s.accuracy, s.weighted_f1)]
        theirs: Sequence[float | None] = PAPER_METHODS.get(s.detector, (None,) * 4)
        cells = [
            f"{'–' if t is None else format(t, '.1f')} / {o:.1f}"
            for t, o in zip(theirs, ours, strict=True)
        ]
        lines.append(f"| `{s.detector}` | {' | '.join(cells)} |")
    return "\n".join([*lines, "", f"Paper / ours, per cent. {STATEMENT}"])


def confusions_table(sheets: Sequence[Evaluation]) -> str:
    """Confusion matrices as Markdown, a row a detector: shares of either label, per cent."""
    lines = [
        "| detector | static: called static | called slip | slip: called static | called slip |",
        "|---|---|---|---|---|",
    ]
    for s in sheets:
        c = s.confusion
        rows = ((c.static_static, c.static_slip), (c.slip_static, c.slip_slip))
        cells = [f"{n} ({100 * n / max(sum(row), 1):.1f})" for row in rows for n in row]
        lines.append(f"| `{s.detector}` | {' | '.join(cells)} |")
    return "\n".join([*lines, "", "Samples, and per cent of those with that label."])


def variances_table(found: Sequence[Variance]) -> str:
    """Variance of predictions as Markdown, and each one's above that of the paper's network."""
    lines = ["| detector | variance within a label | above `tcn-paper` |", "|---|---|---|"]
    base = next((v for v in found if v.detector == "tcn-paper"), None)
    for v in found:
        above = "–"
        if base is not None and v is not base:
            above = _said((v.drawn - base.drawn).estimate, 1.0, 3)
        lines.append(f"| `{v.detector}` | {_said(v.estimate, 1.0, 3)} | {above} |")
    return "\n".join(lines)


def cells_table(table: CellTable) -> str:
    """Table III as Markdown: F1 by motion, speed and surface, `theirs / ours [95 %]`; then delays,
    then what becomes of the paper's statements."""
    cells = {(c.motion, c.speed_mps, c.surface): c for c in table.cells}
    lines = [
        f"| `{table.detector}` | {' | '.join(SURFACES)} | mean |",
        "|---|" + "---|" * (len(SURFACES) + 1),
    ]
    for row, mean in zip(ROWS, table.of_rows, strict=True):
        ours = [cells[(*row, surface)].f1 for surface in SURFACES] + [mean]
        theirs = (*PAPER_CELLS[row], PAPER_OF_ROWS[row])
        lines.append(f"| {_named(row)} | {_beside(theirs, ours)} |")
    lines.append(f"| mean | {_beside(PAPER_OF_SURFACES, table.of_surfaces)} | |")
    said = "Weighted F1, paper's TCN / this detector [95 % over recordings], per cent. Their means "
    said += "weigh by samples, ours by cells."
    least = min(c.recordings for c in table.cells)
    lines += ["", f"{said} At least {least} recordings a cell.", "", _delays(table, cells)]
    return "\n".join([*lines, "", _statements(table)])


def _delays(table: CellTable, cells: Mapping[Key, Cell]) -> str:
    lines = [
        f"| `{table.detector}`, delay | {' | '.join(SURFACES)} |",
        "|---|" + "---|" * len(SURFACES),
    ]
    for row in ROWS:
        told = []
        for c in (cells[(*row, surface)] for surface in SURFACES):
            q = c.delay_ms
            delays = "–" if q is None else f"{q.p50:.0f} / {q.p90:.0f} / {q.p99:.0f}"
            told.append(f"{delays}; {c.missed} of {c.slips}")
        lines.append(f"| {_named(row)} | {' | '.join(told)} |")
    return "\n".join(
        [*lines, "", "ms from the label's rise, 50 / 90 / 99 % of all slips; how many were missed."]
    )


def _statements(table: CellTable) -> str:
    lines = [f"| the paper says | `{table.detector}` | points of F1, 95 % |", "|---|---|---|"]
    for s in table.statements:
        told = "; ".join(f"{name} {_said(d, 100.0, 1)}" for name, d in s.differences.items())
        lines.append(f"| {s.text} | **{s.verdict}** | {told} |")
    return "\n".join(lines)


def _named(row: Row) -> str:
    motion, speed = row
    return f"{motion} {100 * speed:g} cm/s" if speed else f"{motion} 1 rad/s"


def _beside(theirs: Sequence[float], ours: Sequence[Estimate]) -> str:
    return " | ".join(f"{t:.1f} / {_said(o, 100.0, 1)}" for t, o in zip(theirs, ours, strict=True))


def _said(e: Estimate, times: float, digits: int) -> str:
    value, low, high = (f"{times * x:.{digits}f}" for x in (e.value, *e.interval))
    return f"{value} [{low}, {high}]"
