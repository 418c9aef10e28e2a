"""What calibrations at an emulated lab recover of what is known there: a table of docs/hardware.md.

    python scripts/recovered.py                the verbs, once, against an emulated lab
    python scripts/recovered.py --coverage 40  how often an interval holds the truth, virtual time

The verbs of `grasp calibrate` and `grasp tactile watch`, each in a process of its own, their
questions answered from what the cell truly presses with, weighs and travels. The hand is not as any
packaged file has it. What `noise` finds in a hold of two minutes is held against one of 20 minutes
of the same cell in virtual time.

Coverage takes the same readings by the same code on the simulated rig, of as many seeds, and the
level of holds of two minutes, nine to every tenth seed, against that of all of them.
"""

import argparse
import math
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from detector.scores.unlabelled import SETTLED, hold_of
from drivers.errors import UsageError
from scenarios.benchmark.label_free import rule_of
from scenarios.campaign.config import RunConfig, load_config
from scenarios.lab.fingertips import Touch, taken_rest
from scenarios.lab.fit import Line
from scenarios.lab.hand import Hand
from scenarios.lab.scale import Presser
from scenarios.lab.sessions import ROUNDS, Weighing, _press_by_counts
from scenarios.rigs.opening import open_rig
from scenarios.world.cell import LaidWeight, SimulatedCell
from tests.wire.scenarios.lab.scales import CONFIRMED, N_PER_G, Lab, true_slope
from tests.wire.scenarios.lab.terminal import grasp
from tests.wire.scenarios.test_rigs import QUICK, emulate

TRUE_N, TRUE_MM = 12.5, 0.73
HAND = (f"hand.least_force_n={TRUE_N}", "hand.force_exponent=1.3", f"hand.m_per_count={TRUE_MM}e-3")
ALMOST_MM = 75.0  # of travel, short of the can
WEIGHTS_G = (150, 50, 250, 100, 200, 120)
MISTYPED = {100: 310}
HOLD_S, LONG_S = 120.0, 1200.0
BUDGET = 0.5  # false events a minute, as the verb's
DETECTOR = "tcn"
MOST_N, TOUCH_N = 15.0, 0.3
MISSED = 0.0, 0.04  # of ticks: on a machine that has time, and on a busy one
Counts = NDArray[np.int16]


class Row(NamedTuple):
    """Of the table."""

    quantity: str
    verb: str
    truth: str
    recovered: str
    stated: str


def of_hand(lab: Lab) -> list[Row]:
    """Force of byte 0, and travel of a count."""
    lab.cell.ask("place")

    def person(question: str) -> str:
        if "where is the fingertip" in question:
            travel_mm = 1e3 * lab.cell.ask("truth")["travel_m"][0]
            return f"{round(2 * (150.0 - travel_mm)) / 2:g} mm"  # a ruler, from a mark of its own
        if "Take the scale away" in question:
            lab.cell.ask("take")
            return ""
        return f"{5 * round(lab.newtons() / N_PER_G / 5):.0f} g"  # in steps of 5 g

    places = ("--places", "10", "30", "50", "70", "90")
    words = ("hand", "--up-to", "16", *places, "--out", str(lab.folder / "hand.toml"))
    shown, said = lab.wrote(person, *words, *CONFIRMED)
    (lab.folder / "own.toml").write_text(
        said[said.index("for your own file") :].partition("\n\n")[2]
    )
    mean, below = _found(r"presses, ([\d.]+) N, .*95 % below ([\d.]+)", shown)
    um, low, high = _found(r"places, (\d+) um a count \[(\d+), (\d+)\]", shown)
    return [
        Row("force of byte 0, N", "calibrate hand", f"{TRUE_N:.2f}", f"{mean:.2f}",
            f"95 % of presses below {below:.2f}"),
        Row("travel of a count, mm", "calibrate hand --places", f"{TRUE_MM:.3f}",
            f"{um / 1e3:.3f}", f"{low / 1e3:.3f} to {high / 1e3:.3f} (95 %, bend)"),
    ]  # fmt: skip


def of_weights(lab: Lab) -> list[Row]:
    """Counts a newton by weights that are laid on, one mistyped."""
    lab.cell.ask("take")
    asked: list[str] = []
    laid: list[int] = []

    def person(question: str) -> str:
        if "contradicts" in question:
            asked.append(f"reading {question.split()[1].strip(',')}, after {len(laid)}")
            return f"{next(iter(MISTYPED))} g"
        lab.lay(0.0)
        if len(laid) == len(WEIGHTS_G):
            return ""
        laid.append(WEIGHTS_G[len(laid)])
        lab.lay(laid[-1] * N_PER_G)
        time.sleep(1.0)
        return f"{MISTYPED.get(laid[-1], laid[-1])} g"

    words = ("force", "--finger", "A", "--out", str(lab.folder / "weights.toml"))
    shown, _ = lab.wrote(person, *words)
    truth = true_slope([grams * N_PER_G for grams in WEIGHTS_G], *HAND)
    ((right, wrong),) = MISTYPED.items()
    return [
        _counts(shown, "calibrate force", truth),
        Row("a mistyped weight", "calibrate force", f"reading {WEIGHTS_G.index(right) + 1}: "
            f"{right} g, typed {wrong} g", "; ".join(asked) or "not asked about", "asked again"),
    ]  # fmt: skip


def of_presses(lab: Lab) -> list[Row]:
    """Counts a newton by the finger's own presses."""
    lab.cell.ask("place")
    typed: list[float] = []

    def person(question: str) -> str:
        if "almost touch" in question:
            return f"{int(ALMOST_MM / TRUE_MM)}"
        if (force_n := lab.newtons()) <= TOUCH_N:
            return ""
        typed.append(round(force_n, 2))
        return f"{typed[-1]:.2f} N"

    out = str(lab.folder / "force.toml")
    words = ("force", "--press", "--up-to", f"{MOST_N:g}", "--out", out, *CONFIRMED)
    shown, _ = lab.wrote(person, *words)
    most = _found(r"readings of a scale, [\d.]+ to ([\d.]+) N", shown)[0]
    truth = true_slope(sorted({n for n in typed if n <= most}), *HAND)
    return [_counts(shown, "calibrate force --press", truth)]


def of_noise(lab: Lab) -> list[Row]:
    """Noise of a taxel, and the level of the rule that a still hold allows."""
    lab.cell.ask("take")
    lab.done("gripper", "open")
    own = lab.folder / "own.toml"
    config = load_config("can", "simulated", DETECTOR, None, (*QUICK, *HAND))
    true_counts = math.hypot(config.fingertip.noise_counts, 12**-0.5)  # and rounding
    watched = grasp("tactile", "watch", "--seconds", "10", "--config", str(lab.file))
    noise = [float(row[-1]) for line in watched.stdout.splitlines()
             if len(row := line.split()) == 5 and row[0] in "ABC"]  # fmt: skip

    def person(question: str) -> str:
        lab.cell.ask("place")
        return ""

    shown, _ = lab.wrote(
        person, "noise", "--seconds", f"{HOLD_S:g}", "--detector", DETECTOR, "--out",
        str(lab.folder / "rule.toml"), "--confirm-motion", "--config", str(own),
    )  # fmt: skip
    level, low, high = _found(r"Level (-?[\d.]+) \[(-?[\d.]+), (-?[\d.]+)\]", shown)
    return [
        Row("noise of a taxel, counts", "tactile watch", f"{true_counts:.2f}",
            f"{np.median(noise):.2f}", f"{min(noise):.2f} to {max(noise):.2f} of 18 taxels"),
        Row(f"level of the rule ({DETECTOR})", "calibrate noise --seconds 120",
            f"{level_of_a_long_hold(own):.2f} (20 minutes)", f"{level:.2f}",
            f"{low:.2f} to {high:.2f} (95 %)"),
    ]  # fmt: skip


def level_of_a_long_hold(own: Path) -> float:
    """In virtual time, closed by the same code as the verb's."""
    config: RunConfig = load_config("can", "simulated", DETECTOR, [own], (*QUICK, *HAND))
    counts = long_hold(config, 0)
    return rule_of(config, [(counts, *hold_of(counts))], BUDGET).level


def long_hold(config: RunConfig, seed: int) -> Counts:
    """Counts (n, 3, taxels) of one, and of the open hand after it."""
    with open_hand(config, seed) as (_, rig, touch):
        hand = Hand(config, rig.devices.gripper, touch, rig.clock, "")
        hand.close((255, 255, 255), _nothing)
        held = hand.feel(LONG_S, _nothing)
        hand.move((0, 0, 0), _nothing)
        return np.concatenate([held, hand.feel(2.0, _nothing)])


@contextmanager
def open_hand(config: RunConfig, seed: int) -> Iterator[tuple[SimulatedCell, Any, Touch]]:
    """With the object between its fingers, in virtual time; its fingertips' rest is taken."""
    with open_rig(config, seed, paced=False) as rig:
        tips: Any = rig.devices.tactile
        assert isinstance(rig.cell, SimulatedCell)  # noqa: S101
        yield rig.cell, rig, Touch(tips, taken_rest(tips, rig.clock), 10**9)


# Coverage


class Person:
    """Answers at once; ``answer`` may let time pass. What was read rightly is typed again."""

    def __init__(self, answer: Callable[[], str]) -> None:
        self._answer, self._asked, self._typed = answer, "", ""

    def say(self, text: str) -> None:
        self._asked = text

    def poll(self) -> str | None:
        if "type it again" not in self._asked:
            self._typed = self._answer()
        return self._typed


def by_presses(config: RunConfig, seed: int) -> tuple[Line, float]:
    """What is stated of a pad that its own finger presses, and its true slope."""
    with open_hand(config, seed) as (cell, rig, touch):
        presser = Presser(rig.devices.gripper, rig.clock, "A", MOST_N)

        def says() -> str:
            force_n = cell.truth().normal_n[0]
            return f"{force_n:.2f} N" if force_n > TOUCH_N else ""

        weighing = Weighing(touch, rig.clock, "A", MOST_N, Person(says), _nothing, presser.look)
        near = int(ALMOST_MM / TRUE_MM)
        for weighing.round in range(1, ROUNDS + 1):
            presser.to(near)
            weighing.railed = False
            _press_by_counts(presser, near, weighing)
        return weighing.fit(), _true(weighing, seed)


def by_weights(config: RunConfig, seed: int) -> tuple[Line, float]:
    """As ``by_presses``, under weights that a person lays on, one second before each is typed."""
    with open_hand(config, seed) as (cell, rig, touch):
        grams = iter((*WEIGHTS_G, None))

        def says() -> str:
            cell.lay(LaidWeight(finger="A", newtons=0.0))
            if (laid := next(grams)) is None:
                return ""
            cell.lay(LaidWeight(finger="A", newtons=laid * N_PER_G))
            weighing.settle()
            return f"{laid} g"

        weighing = Weighing(touch, rig.clock, "A", MOST_N, Person(says), _nothing)
        while weighing.ask(""):
            pass
        return weighing.fit(), _true(weighing, seed)


def _true(weighing: Weighing, seed: int) -> float:
    return true_slope(sorted({point.force_n for point in weighing.points}), *HAND, seed=seed)


def _nothing(text: str) -> None: ...


def levels(config: RunConfig, seed: int) -> Iterator[tuple[bool, ...]]:
    """Whether the interval of each two minutes of a long hold holds the level of all of it; for
    each share of ticks that have no frame of their own."""
    counts = long_hold(config, seed)
    held, load = hold_of(counts)
    truth = rule_of(config, [(counts, held, load)], BUDGET).level
    drawn, length = np.random.default_rng(seed).random(len(counts)), round(HOLD_S * 100)
    heard = [_repeated(counts, drawn < missed) for missed in MISSED]
    for first in range(held.start, held.stop - length + 1, length):
        inner = slice(SETTLED, length - SETTLED)
        parts = [(each[first : first + length], inner, load) for each in heard]
        intervals = [rule_of(config, [part], BUDGET).interval for part in parts]
        yield tuple(low <= truth <= high for low, high in intervals)


def _repeated(counts: Counts, missed: NDArray[np.bool_]) -> Counts:
    """In such a tick the frame of the one before it, as whoever listens at 100 Hz has it."""
    own = np.where(missed, 0, np.arange(len(counts)))
    return counts[np.maximum.accumulate(own)]


def coverage(count: int) -> None:
    config: RunConfig = load_config("can", "simulated", DETECTOR, None, (*QUICK, *HAND))
    print("| 95 % interval | holds the truth | refused | half of it | off by: median, most |"
          "\n|---|---|---|---|---|", flush=True)  # fmt: skip
    for title, by in (("`calibrate force`", by_weights), ("`calibrate force --press`", by_presses)):
        lines, refused = [], 0
        for seed in range(count):
            try:
                lines.append(by(config, seed))
            except UsageError:  # no file is written
                refused += 1
        within = sum(line.interval[0] <= truth <= line.interval[1] for line, truth in lines)
        off = [abs(line.slope / truth - 1.0) for line, truth in lines]
        wide = np.median([line.interval[1] / line.slope - 1.0 for line, _ in lines])
        print(f"| {title} | {within} of {len(lines)} | {refused} | {wide:.1%} | "
              f"{np.median(off):.1%}, {max(off):.1%} |", flush=True)  # fmt: skip
    found = [held for seed in range(-(-count // 10)) for held in levels(config, seed)]
    for missed, held in zip(MISSED, zip(*found, strict=True), strict=True):
        title = f"`calibrate noise`, two minutes, {missed:.0%} of ticks without a frame"
        print(f"| {title} | {sum(held)} of {len(held)} | | | |", flush=True)


def _counts(shown: str, verb: str, truth: float) -> Row:
    slope, low, high = _found(r"([\d.]+) counts a newton \[([\d.]+), ([\d.]+)\]", shown)
    return Row("counts a newton", verb, f"{truth:.1f}", f"{slope:.1f}",
               f"{low:.1f} to {high:.1f} (95 %)")  # fmt: skip


def _found(pattern: str, shown: str) -> list[float]:
    found = re.search(pattern, shown)
    if found is None:
        raise ValueError(f"no {pattern!r} in {shown!r}")
    return list(map(float, found.groups()))


def main() -> int:
    parser = argparse.ArgumentParser(description="What calibrations recover.")
    parser.add_argument("--coverage", type=int, metavar="N", help="of so many seeds")
    if count := parser.parse_args().coverage:
        coverage(count)
        return 0
    print("| quantity | `grasp` | true | recovered | stated |\n|---|---|---|---|---|", flush=True)
    sets = [word for text in HAND for word in ("--set", text)]
    with tempfile.TemporaryDirectory() as folder, emulate(*sets) as endpoints:
        lab = Lab(endpoints, Path(folder))
        lab.done("gripper", "activate", "--empty")
        for rows in (of_hand, of_weights, of_presses, of_noise):
            for row in rows(lab):
                line = row._replace(verb=f"`{row.verb}`")
                print(f"| {' | '.join(line)} |", flush=True)
        lab.cell.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
