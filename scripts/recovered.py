"""What calibrations at an emulated lab recover of what is known there: a table of docs/hardware.md.

    python scripts/recovered.py

The verbs of `grasp calibrate` and `grasp tactile watch`, each in a process of its own, their
questions answered from what the cell truly presses with, weighs and travels. The hand is not as any
packaged file has it. What `noise` finds in a hold of two minutes is held against one of 20 minutes
of the same cell in virtual time.
"""

import math
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from detector.scores.unlabelled import hold_of
from scenarios.campaign.config import RunConfig, load_config
from scenarios.lab.hand import Hand
from scenarios.lab.touch import Touch, taken_rest
from scenarios.rigs.opening import open_rig
from scenarios.studies.detectors.unlabelled import rule_of
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
        if (force_n := lab.newtons()) <= 0.3:
            return ""
        typed.append(round(force_n, 2))
        return f"{typed[-1]:.2f} N"

    out = str(lab.folder / "force.toml")
    words = ("force", "--press", "--up-to", "15", "--out", out, *CONFIRMED)
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
    with open_rig(config, 0, paced=False) as rig:
        tips, clock = rig.devices.tactile, rig.clock
        rest = taken_rest(tips, clock)  # type: ignore[arg-type]  # a driver of ours, on this rig
        touch = Touch(tips, rest, 10**9)  # type: ignore[arg-type]
        hand = Hand(config, rig.devices.gripper, touch, clock, "")
        hand.close((255, 255, 255), print)
        held = hand.feel(LONG_S, print)
        hand.move((0, 0, 0), print)
        counts = np.concatenate([held, hand.feel(2.0, print)])
    return rule_of(config, [(counts, *hold_of(counts))], BUDGET).level


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
