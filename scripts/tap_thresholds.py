"""How many of the mallet's blows are heard for how many that move nothing, threshold by threshold.

    python scripts/tap_thresholds.py tcn gru [--taps 16] [--jobs 2]

Taps of the six objects at five strengths as `scripts/last_draw.py` makes them, on seeds that no
draw has, with nobody answering. Each detector hears them once; its packaged rule is then asked with
one threshold after another. The last draw gives two shares by one threshold, and the aim asks for
both at once: this tells what the one costs of the other. Nothing is tuned on it.
"""

import argparse
import itertools
from collections.abc import Iterable, Sequence
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np

from detector.decision import RuleSettings, registered_events
from detector.interface import DETECTORS
from detector.scores.evaluation import stream
from drivers.interfaces import FINGERS
from grasp.cli.options import whole
from grasp.settings import names
from scenarios.campaign.config import load_config
from scenarios.rigs.workers import Workers, results
from scripts.last_draw import SOON_MS, Draw, Struck, all_taps, share

FIRST_SEED = 98_000  # of the taps; no draw, campaign, figure or test has it
FAR_MM, IDLE_MM = 2.0, 0.5
MOST_IDLE = 0.05  # the aim's
THRESHOLDS = tuple(round(t, 2) for t in np.arange(0.3, 0.96, 0.05))


class Heard(NamedTuple):
    """A blow, and what a detector says of each finger from before it on."""

    blow: Struck
    probabilities: np.ndarray[tuple[int, int], np.dtype[np.float64]]  # (n, fingers)


class Asked(NamedTuple):
    """What one threshold makes of all blows."""

    threshold: float
    heard: int  # within 100 ms, of ``far`` that move it 2 mm or more
    far: int
    answered: int  # of ``idle`` that leave it within half a millimetre
    idle: int


def hear(detector: str, blows: Iterable[Struck]) -> list[Heard]:
    config = load_config("can", "simulated", detector)
    made = config.make_detector(FINGERS)
    return [Heard(blow, stream(made, blow.counts)[0]) for blow in blows]


def ask(heard: Sequence[Heard], rule: RuleSettings, threshold: float) -> Asked:
    """Of blows as the last draw counts them."""
    rule = msgspec.structs.replace(rule, threshold=threshold)
    late_ms = np.array([_answer_ms(one, rule) for one in heard])
    moved_mm = np.array([one.blow.moved_mm for one in heard])
    far, idle = moved_mm >= FAR_MM, moved_mm < IDLE_MM
    return Asked(
        threshold, int((late_ms[far] <= SOON_MS).sum()), int(far.sum()),
        int(np.isfinite(late_ms[idle]).sum()), int(idle.sum()),
    )  # fmt: skip


def _answer_ms(one: Heard, rule: RuleSettings) -> float:
    """From first motion to the alarm that begins after the blow; infinite: none."""
    blow = one.blow
    at_s = blow.t_s[registered_events(one.probabilities, rule)[:, 0]]
    after = at_s[(at_s >= blow.struck_s) & (at_s <= blow.until_s)]
    return float(1e3 * (after[0] - blow.onset_s)) if len(after) else np.inf


def at_most_idle(asked: Sequence[Asked], most: float = MOST_IDLE) -> float | None:
    """Share heard where so much of the idle ones is answered: on a straight line between the two
    thresholds about it; None where there is none."""
    shares = sorted((a.answered / a.idle, a.heard / a.far) for a in asked)
    for (low, heard), (high, more) in itertools.pairwise(shares):
        if low <= most < high:
            return heard + (more - heard) * (most - low) / (high - low)
    return None


def table(found: dict[str, list[Asked]], packaged: dict[str, Asked]) -> str:
    heads = [f"`{d}`: {of}" for d in found for of in ("2 mm or more within 100 ms", "idle")]
    lines = [f"| threshold | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for rows in zip(*found.values(), strict=True):
        lines.append(f"| {rows[0].threshold:.2f} | {_cells(rows)} |")
    at = " / ".join(f"{packaged[d].threshold:.3f}" for d in found)
    lines.append(f"| **packaged, {at}** | {_cells(packaged[d] for d in found)} |")
    told = [at_most_idle(asked) for asked in found.values()]
    cells = ["–" if t is None else f"{100 * t:.0f} %" for t in told]
    lines.append(f"| at 5 % of the idle ones | {' | '.join(f'{c} | 5 %' for c in cells)} |")
    return "\n".join(lines)


def _cells(rows: Iterable[Asked]) -> str:
    return " | ".join(f"{share(a.heard, a.far)} | {share(a.answered, a.idle)}" for a in rows)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("detectors", nargs="+", choices=sorted(DETECTORS))
    parser.add_argument("--taps", type=whole(1, 20), default=16, help="of each object and strength")
    parser.add_argument("--jobs", type=whole(1, 64), default=2)
    args = parser.parse_args()
    draw = Draw(FIRST_SEED, args.taps, 0)
    struck = results(partial(all_taps, draw), names("objects"), Workers(args.jobs))
    blows = [blow for of_object in struck for blow in of_object]
    found, packaged = {}, {}
    for name in args.detectors:
        heard, rule = hear(name, blows), load_config("can", "simulated", name).rule
        found[name] = [ask(heard, rule, threshold) for threshold in THRESHOLDS]
        packaged[name] = ask(heard, rule, rule.threshold)
    print(table(found, packaged))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
