"""The picture of a frontier: success against each axis. Needs the extra `charts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp.files import save_figure
from scenarios.campaign.frontier import Frontier, Line

PANELS = (
    ("friction",), ("mass",), ("speed",), ("pull",), ("wider", "narrower"), ("taxels", "gain"),
)  # fmt: skip
COLOURS = ("#1f5f99", "#d98e04", "#7a5195", "#3a7d44", "#b5432a", "#8c6d31")
DASHED = ("narrower", "gain")  # second of their panels
LEVELS = (0.95, 0.5)


def draw_frontier(found: Sequence[Frontier], out: Path) -> None:
    """A panel an axis; a line a profile and detector, with 95 % intervals; the bound as a band."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    lines = [line for each in found for line in each.lines]
    whose = list(dict.fromkeys((line.profile, line.detector) for line in lines))
    of_panels = [[line for line in lines if line.axis in names] for names in PANELS]
    shown = [each for each in of_panels if each]
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure, panels = plt.subplots(
        rows, columns, figsize=(1 + 4 * columns, 3.75 * rows), sharey=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for panel, own in zip(panels.flat, shown, strict=False):
        for line in own:
            _draw_line(panel, line, COLOURS[whose.index((line.profile, line.detector)) % 6])
        _finish(panel, own)
    for panel in panels.flat[len(shown) :]:
        panel.set_visible(False)
    for panel in panels[:, 0]:
        panel.set_ylabel("held in spite of slip")
    panels[0, 0].legend(fontsize=7, loc="lower left")
    figure.suptitle("How much harder a lift may become, simulated", fontsize=11)
    save_figure(figure, out, dpi=110)
    plt.close(figure)


def _draw_line(panel: Any, line: Line, colour: str) -> None:
    tried = [each for each in line.tried if each.value is not None and each.tested]
    x = [each.value for each in tried]
    rate = [each.held / each.tested for each in tried]
    below = [max(0.0, r - each.interval[0]) for r, each in zip(rate, tried, strict=True)]
    above = [max(0.0, each.interval[1] - r) for r, each in zip(rate, tried, strict=True)]
    dashed = line.axis in DASHED
    panel.errorbar(
        x, rate, [below, above], color=colour, marker="o" if not dashed else "s", ms=3.5, lw=1,
        ls="--" if dashed else "-", elinewidth=0.7, capsize=2,
        label=f"{line.profile}, {line.detector}",
    )  # fmt: skip


def _finish(panel: Any, lines: Sequence[Line]) -> None:
    for line in {line.axis: line for line in lines}.values():
        low, high = line.bound
        dashed = line.axis in DASHED
        panel.axvspan(low, high, color="#00000014", lw=0, hatch="//" if dashed else None)
        first = high if line.axis == "friction" else low  # object that reaches its bound first
        panel.axvline(first, color="black", lw=0.6, ls="--" if dashed else "-")
    for level in LEVELS:
        panel.axhline(level, color="black", lw=0.4, ls=":")
    titles = list(dict.fromkeys(line.title for line in lines))
    marks = ["" if len(titles) == 1 else " (dashed)" if i else " (solid)" for i in range(2)]
    panel.set_title(", ".join(t + m for t, m in zip(titles, marks, strict=False)), fontsize=9)
    panel.set_xlabel(lines[0].unit)
    panel.set_ylim(-0.03, 1.05)
    if any(line.axis == "friction" for line in lines):
        panel.invert_xaxis()  # harder to the right, as everywhere
