"""What kind of slip it is: heads beside what can be told without them, and whether knowing the
speed would size a step of force."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.heads import Heads, Scores, Teller
from detector.network_file import LoadedNetwork
from detector.recordings import Recording, Split
from detector.scores.heads import Figure, Score, felt, score, told_by_heads, told_without
from scenarios.acquire.datasets.bodies import relaxed_n
from scenarios.acquire.datasets.grasped import lift_config
from scenarios.benchmark.data_sets import read_set
from scenarios.world.contact import GRAVITY_MPS2

Floats = NDArray[np.float64]
HEADS = "heads"
LIFTS = "grasped_slip"  # the cause of lifts of what is too heavy
AFTER_SAMPLES = (5, 10, 15)  # since slip began


class Row(msgspec.Struct, frozen=True):
    """What one of them tells of one set."""

    data: str
    by: str
    score: Score


def compared(
    loaded: LoadedNetwork, teller: Teller, folders: Sequence[Path], split: Split
) -> list[Row]:
    """Heads, and baselines that have learnt from the split `train` of the set that they are asked
    about."""
    rows = []
    for folder in folders:
        learnt = felt(loaded, read_set(folder, "train"))
        asked = felt(loaded, read_set(folder, split))
        told = told_without(learnt, asked) | {HEADS: told_by_heads(teller, asked)}
        rows += [Row(folder.name, by, score(each, asked)) for by, each in told.items()]
    return rows


def scores_of(rows: Sequence[Row]) -> Scores:
    """Those of the heads, as their file has them."""
    return {
        f"{row.data}: {name}": figure
        for row in rows
        if row.by == HEADS
        for name, figure in msgspec.structs.asdict(row.score).items()
        if figure is not None
    }


def table(rows: Sequence[Row]) -> str:
    """Markdown."""
    lines = [
        "| data | told by | speed, times too fast or slow, median | its logarithm, R2 | direction, "
        "one of eight | or one beside it | turning, AUC |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        figures = msgspec.structs.astuple(row.score)
        lines.append(f"| {row.data} | {row.by} | {' | '.join(map(_text, figures))} |")
    return "\n".join(lines)


def _text(figure: Figure | None) -> str:
    return "–" if figure is None else "{:.2f} [{:.2f}, {:.2f}]".format(*figure)


class Sizing(msgspec.Struct, frozen=True):
    """Rank correlations over lifts of what a grip cannot carry, so long after slip began: of the
    true speed with what it should carry over what it does, and with the arm's acceleration."""

    after_ms: float
    lifts: int
    with_load: float
    with_acceleration: float


def sizings(recordings: Sequence[Recording]) -> list[Sizing]:
    """Whether somebody who knew the speed of a lift's slip could tell how much force is missing."""
    lifts = [r for r in recordings if r.metadata and r.metadata.cause == LIFTS and r.slip.any()]
    found = []
    for after in AFTER_SAMPLES:
        seen = [facts for r in lifts if (facts := _facts(r, after)) is not None]
        if len(seen) > 2:
            speed, load, acceleration = np.array(seen).T
            correlations = (_ranked(speed, load), _ranked(speed, acceleration))
            found.append(Sizing(10.0 * after, len(seen), *correlations))
    return found


def _facts(recording: Recording, after: int) -> tuple[float, float, float] | None:
    at = int(recording.slip.argmax()) + after
    metadata, velocity = recording.metadata, recording.velocity_mps
    if metadata is None or velocity is None or at >= len(recording.t_s):
        return None
    config = lift_config(metadata, None, turns=False)
    body, hand = config.object, config.hand
    grip_n = relaxed_n(body, config.contact, hand.m_per_count, body.grip_counts)
    load = body.mass_kg * GRAVITY_MPS2 / (body.friction_static * sum(grip_n))
    speed = float(np.hypot(*velocity[at]))
    return speed, load, config.controller.lift_acceleration_mps2


def _ranked(a: Floats, b: Floats) -> float:
    one, other = (np.argsort(np.argsort(x)) - 0.5 * (len(x) - 1) for x in (a, b))
    return float((one * other).sum() / (one**2).sum())


def sizing_table(found: Sequence[Sizing]) -> str:
    """Markdown."""
    lines = [
        "| after slip began, ms | lifts | rank correlation of the true speed with the load | with "
        "the arm's acceleration |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {s.after_ms:.0f} | {s.lifts} | {s.with_load:.2f} | {s.with_acceleration:.2f} |"
        for s in found
    ]
    return "\n".join(lines)


def with_scores(heads: Heads, rows: Sequence[Row]) -> Heads:
    """The file with what it has come to."""
    return msgspec.structs.replace(heads, scores=scores_of(rows))
