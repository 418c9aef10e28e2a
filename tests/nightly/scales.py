"""An emulated lab with what a calibration needs: a scale, weights, a ruler, and their truth."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.campaign.config import load_for_devices
from scenarios.lab.fit import Point, fit_counts
from scenarios.rigs.world_of_seed import any_cell
from scenarios.world.cell import LaidWeight, SimulatedCell
from tests.wire import lab
from tests.wire.lab import QUICK

CONFIRMED = ("--confirm-motion", "--scale")
N_PER_G = 0.00980665
TICK_NS = 10_000_000
LISTENED = 300  # samples of the truth of one weight, after as many in which the rubber settles


class Lab(lab.Lab):
    """An emulated lab whose hand is active, and a scale: what the thumb truly presses with."""

    def __init__(self, endpoints: dict[str, Any], folder: Path) -> None:
        super().__init__(endpoints, folder)
        self.folder = folder

    def newtons(self) -> float:
        return float(self.ask("truth")["truth"]["normal_n"][0])

    def lay(self, newtons: float) -> None:
        """A weight on the thumb's pad, in place of what lay there."""
        self.ask("lay", finger="A", newtons=newtons)

    def played(self, answer: Callable[[str], str], *words: str) -> lab.Done:
        return self.grasp("calibrate", *words, answer=answer)

    def wrote(self, answer: Callable[[str], str], *words: str) -> tuple[str, str]:
        """Of a calibration that ends well, what it showed and said."""
        done = self.played(answer, *words)
        assert done.code == 0, done.err
        return done.out, done.err


def counts_under(forces_n: Sequence[float], *sets: str, seed: int = 0) -> list[float]:
    """What the thumb's pad of `grasp emulate` truly falls by under such weights, each laid on anew,
    without the noise of a single sample."""
    cell = any_cell(load_for_devices("can", "emulated", None, (*QUICK, *sets)), seed)
    assert isinstance(cell, SimulatedCell)
    t_ns = 0

    def heard() -> float:
        nonlocal t_ns
        codes = []
        for _ in range(2 * LISTENED):
            t_ns += TICK_NS
            cell.advance(t_ns)
            codes.append(cell._latch(t_ns)()[0].reshape(3, -1)[0].sum())  # noqa: SLF001
        return float(np.mean(codes[LISTENED:]))

    fallen = []
    for force_n in forces_n:
        cell.lay(LaidWeight(finger="A", newtons=0.0))
        rest = heard()
        cell.lay(LaidWeight(finger="A", newtons=force_n))
        fallen.append(rest - heard())
    return fallen


def true_slope(forces_n: Sequence[float], *sets: str, seed: int = 0) -> float:
    """Counts a newton of that pad, which bends, at those forces: by the line that `grasp calibrate
    force` takes."""
    counts = counts_under(forces_n, *sets, seed=seed)
    rounds = [Point(n, c, r) for r in (1, 2, 3) for n, c in zip(forces_n, counts, strict=True)]
    return fit_counts(rounds).slope
