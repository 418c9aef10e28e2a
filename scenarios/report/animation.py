"""Animation of a slip in slow motion: fingers and object beside force, slip probability and slip.

It needs the true motion of the object, which only simulated and emulated rigs record.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import BadFile, UsageError
from drivers.interfaces import FINGER_NAMES
from scenarios.report.export import COLOURS, LIMIT_COLOUR, Floats, pyplot, title
from scenarios.report.page import palette
from scenarios.report.run_record import RunRecord, TrueWorld, read_run

BEFORE_S, AFTER_S = 0.2, 0.9  # shown around the onset of slip
FRAMES_A_SECOND = 12  # of one control step each
SLOWER = 100 / FRAMES_A_SECOND
STRIPE_MM = 4.0  # marks on the object make its motion visible
HALF_HEIGHT_MM, HALF_OBJECT_MM, PAD_MM, LENGTH_MM_A_N = 22.0, 12.0, 7.0, 1.6
LEFT, RIGHT = (0,), (1, 2)  # the thumb presses against the other two fingers

Draw = Callable[[int], None]  # shows one control step


def animate_run(path: Path, out: Path) -> None:
    """Write an animated GIF of a run's first slip. Raises BadFile as ``read_run``, and for a run
    without a true slip."""
    plt, run = pyplot(), read_run(path)
    from matplotlib.animation import FuncAnimation, PillowWriter

    truth = run.truth
    opened_s = [c.t_ns * 1e-9 for c in run.phases if c.phase == "release.open"]
    # a released object slides too, which is no slip of a grasp
    if truth is None or truth.onset_s is None or truth.onset_s >= min(opened_s, default=math.inf):
        raise BadFile(
            str(path),
            "shows no slip",
            "choose a run on an emulated or simulated rig in which the object slips",
        )
    span = np.searchsorted(run.t_s, (truth.onset_s - BEFORE_S, truth.onset_s + AFTER_S))
    steps = np.arange(span[0], span[1])
    figure, axes = plt.subplot_mosaic(
        [["hand", "force"], ["hand", "probability"], ["hand", "slip"]], figsize=(7.2, 3.8),
        width_ratios=(1, 1.6), layout="constrained",
    )  # fmt: skip
    figure.suptitle(f"{title(run)} ({SLOWER:.0f} times slower)", fontsize=9)
    draws = [_motion(axes["hand"], run, truth), *_curves(axes, run, truth, steps)]

    def show(frame: int) -> list[Any]:
        for draw in draws:
            draw(int(steps[frame]))
        return []

    frames = FuncAnimation(figure, show, frames=len(steps))
    frames.save(out, writer=PillowWriter(fps=FRAMES_A_SECOND), dpi=90)
    plt.close(figure)


def frame_drawer() -> Callable[[float, Floats, str], NDArray[np.uint8]]:
    """A function that draws one picture (height, width, 3) from the slip distance in m, the true
    forces of the fingers in N, and a text. Raises UsageError without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        remedy = "make install-exports, or elsewhere pip install 'grasp-controller[exports]'"
        raise UsageError("pictures need matplotlib, which is not installed", remedy) from None
    canvas = FigureCanvasAgg(Figure(figsize=(2.8, 3.8), dpi=100, layout="constrained"))
    sketch = _sketch(canvas.figure.subplots())

    def draw(slip_m: float, normal_n: Floats, text: str) -> NDArray[np.uint8]:
        sketch(slip_m, normal_n, text)
        canvas.draw()  # type: ignore[no-untyped-call]
        return np.array(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]

    return draw


def _motion(axes: Any, run: RunRecord, truth: TrueWorld) -> Draw:
    """The sketch of a recorded control step."""
    sketch = _sketch(axes)
    begins = [change.t_ns * 1e-9 for change in run.phases]

    def draw(i: int) -> None:
        phase = run.phases[np.searchsorted(begins, run.t_s[i] + 1e-9, side="right") - 1].phase
        text = f"{phase}\n{1e3 * (run.t_s[i] - (truth.onset_s or 0.0)):+.0f} ms"
        sketch(truth.slip_m[i], truth.normal_n[i], text)

    return draw


def _sketch(axes: Any) -> Callable[[float, Floats, str], None]:
    """Side view in the frame of the hand: the object sinks by the true slip distance, and each
    arrow is as long as the true force of the fingers on its side."""
    low = -4 * HALF_HEIGHT_MM
    marks = np.arange(low, -low, STRIPE_MM)
    axes.set(xlim=(-32, 32), ylim=(-HALF_HEIGHT_MM, HALF_HEIGHT_MM), xticks=[], yticks=[])
    axes.axvspan(-HALF_OBJECT_MM, HALF_OBJECT_MM, color=palette("body"), lw=0)
    stripes = axes.hlines(marks, -HALF_OBJECT_MM, HALF_OBJECT_MM, color=palette("soft"), lw=1.5)
    arrows = []
    for side, fingers, name in ((-1, LEFT, "A (thumb)"), (1, RIGHT, "B + C")):
        colour = COLOURS[name[0]]
        edge = side * HALF_OBJECT_MM
        axes.fill_between(sorted((edge, edge + side * 3)), -PAD_MM, PAD_MM, color=colour, lw=0)
        axes.text(edge + side * 1, PAD_MM + 1.5, name, ha="left" if side > 0 else "right",
                  fontsize=8, color=colour)  # fmt: skip
        arrow = axes.annotate(
            "", (edge + side * 3, 0), (edge + side * 8, 0),
            arrowprops={"arrowstyle": "->", "color": colour, "lw": 2},
        )  # fmt: skip
        arrows.append((arrow, edge + side * 3.2, side, list(fingers)))
    text = axes.text(0, HALF_HEIGHT_MM - 1, "", ha="center", va="top", fontsize=9,
                     bbox={"facecolor": "white", "edgecolor": "none"})  # fmt: skip

    def draw(slip_m: float, normal_n: Floats, words: str) -> None:
        down = -1e3 * slip_m
        stripes.set_segments(
            [((-HALF_OBJECT_MM, y + down), (HALF_OBJECT_MM, y + down)) for y in marks]
        )
        for arrow, start, side, fingers in arrows:
            length_mm = LENGTH_MM_A_N * max(0.2, normal_n[fingers].sum())
            arrow.set_position((start + side * length_mm, 0))
        text.set_text(words)

    return draw


def _curves(axes: Any, run: RunRecord, truth: TrueWorld, steps: Any) -> list[Draw]:
    """Curves that grow with time: true force and probability of each finger, and true slip."""
    ms = 1e3 * (run.t_s - (truth.onset_s or 0.0))
    limit_n = run.config.guard.force_limit_n
    colours = [COLOURS[name] for name in FINGER_NAMES]
    plots = (
        (axes["force"], truth.normal_n, colours, "true force, N", (0, 1.15 * limit_n)),
        (axes["probability"], run.probabilities, colours, "slip probability", (-0.05, 1.05)),
        (axes["slip"], 1e3 * truth.slip_m[:, None], ["black"], "slip, mm",
         (-0.2, 1.2 * max(1.0, 1e3 * float(truth.slip_m[steps].max())))),
    )  # fmt: skip
    axes["force"].axhline(limit_n, color=LIMIT_COLOUR, lw=1, ls="--")
    axes["slip"].set_xlabel("time after slip began, ms", fontsize=8)
    growing = []
    for where, values, each, label, limits in plots:
        where.set(xlim=(ms[steps[0]], ms[steps[-1]]), ylim=limits)
        where.set_ylabel(label, fontsize=8)
        where.tick_params(labelsize=7)
        where.axvline(0, color=LIMIT_COLOUR, lw=0.8)
        if where is not axes["slip"]:
            where.set_xticklabels([])
        growing += [
            (where.plot([], [], color=colour, lw=1.6)[0], values[:, k])
            for k, colour in enumerate(each)
        ]

    def draw(i: int) -> None:
        for line, values in growing:
            line.set_data(ms[steps[0] : i + 1], values[steps[0] : i + 1])

    return [draw]
