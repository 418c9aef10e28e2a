"""The bound as lines, detectors as points and thin lines. Needs the extra `charts`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grasp.files import save_figure
from scenarios.studies.detectors.figures import in_colour
from scenarios.studies.detectors.observer import BLOW_TITLES, LIFT_TITLES, TIMES_S, Told
from scenarios.studies.detectors.observer_study import Study

STYLES = (":", "--", "-")  # of the classes, rising


def draw_observer(found: Study, out: Path) -> None:
    """Blows by time, hits against idle blows, lifts by time; the observer in black."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams["svg.hashsalt"] = "grasp"
    figure, (blows, trade, lifts) = plt.subplots(1, 3, figsize=(13, 4.4), layout="constrained")
    _by_time(blows, found.blows, BLOW_TITLES[1:])
    for name, colour in in_colour(found.detectors):
        _line(blows, found.detectors[name], BLOW_TITLES[-1], colour, f"{name}, 2 mm or more")
    blows.set(
        xlabel="ms since the blow, whose time is known", ylabel="hits at 5 % of idle blows, %",
        title="blows", xscale="log",
    )  # fmt: skip
    _trade(trade, found)
    _by_time(lifts, found.lifts, LIFT_TITLES[1:])
    for name, colour in in_colour(found.detectors):
        for title, style in zip(LIFT_TITLES[1:], STYLES, strict=True):
            own = [p for p in found.lift_points if (p.detector, p.title) == (name, title)]
            lifts.plot(
                [1e3 * p.within_s for p in own], [100 * p.hits for p in own], color=colour,
                lw=0.9, ls=style, marker="o", ms=3,
            )  # fmt: skip
    lifts.set(
        xlabel="ms since the first motion", ylabel="hits, %", xscale="log",
        title="lifts (detectors by their own rule)",
    )  # fmt: skip
    for panel in (blows, lifts):  # a scale that is set puts its own ticks
        marks = [1e3 * t for t in TIMES_S]
        panel.set_xticks(marks, [f"{m:.0f}" for m in marks])
        panel.minorticks_off()
    for panel in (blows, trade, lifts):
        panel.set_ylim(0, 101)
        panel.legend(fontsize=7, frameon=False)
    save_figure(figure, out, dpi=120)
    plt.close(figure)


def _by_time(panel: Any, every: Sequence[Told], titles: Sequence[str]) -> None:
    for title, style in zip(titles, STYLES, strict=True):
        _line(panel, every, title, "black", f"observer, {title}", style, 1.8)


def _line(
    panel: Any, every: Sequence[Told], title: str, colour: str, label: str, style: str = "-",
    width: float = 0.9,
) -> None:  # fmt: skip
    own = [t for t in every if t.title == title]
    panel.plot(
        [1e3 * t.time_s for t in own], [100 * t.hits for t in own], color=colour, ls=style,
        lw=width, label=label,
    )  # fmt: skip


def _trade(panel: Any, found: Study) -> None:
    colours = {"observer": "black"} | dict(in_colour(found.detectors))
    for name, curve in found.curves.items():
        panel.plot(
            [100 * idle for idle, _ in curve], [100 * hit for _, hit in curve], color=colours[name],
            lw=1.8 if name == "observer" else 0.9, label=name,
        )  # fmt: skip
    for name in found.detectors:
        own = next(p for p in found.points if (p.detector, p.title) == (name, BLOW_TITLES[-1]))
        panel.plot(100 * own.idle, 100 * own.hits, "o", color=colours[name], ms=6)
    panel.set(
        xlabel="idle blows registered, %", ylabel="of those of 2 mm or more, within 100 ms, %",
        title="blows (points: by their own rule)", xlim=(0, 30),
    )  # fmt: skip
