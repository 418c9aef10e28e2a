"""Why blows that move nothing are answered more often by the mallet than in validation.

    python scripts/idle_blows.py tcn gru --data data/confusers data/grasped-slip [--taps 4]

Blows that left what is held within half a millimetre: those of the data sets' splits `validation`
and `test`, on drawn objects, and taps of the mallet on the six objects as
`scripts/last_draw.py` strikes them, on seeds that no draw has. Of each: how often a detector by its
packaged rule registers slip within half a second, which is how long a recording's blow is watched,
and within the three of a tap; how often it does in as long before the blow; how far the blow moved
the object, and how far the fingertips then stand from where they stood (rms of the hand's taxels);
and the share that validation's own shares, by that distance, would give. Of the data sets' blows
also by kind, and by how far the contact slid while they lasted, to and fro: what a blow leaves
within half a millimetre may have slid further and come back. `--taps 0` leaves the mallet out.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from detector.blows import UNMOVED_M, WATCHED_S, blows_of
from detector.decision import registered_events
from detector.recordings import Recording
from detector.scores.evaluation import WARM_UP_SAMPLES, stream
from detector.scores.quantiles import quantile
from drivers.interfaces import PERIOD_S
from grasp.settings import names
from scenarios.benchmark.scoring import read_split
from scenarios.campaign.config import load_config
from scenarios.campaign.paper import wilson
from scenarios.rigs.workers import Workers, results
from scripts.last_draw import Draw, all_taps

FIRST_SEED = 95_000  # of the taps; no draw, campaign, figure or test has it
WATCHED_TAP_S = 3.0
SLID_MM = (0.3, 0.6, 1.0)
CLASSES = 4  # of how far the fingertips stand off, by validation's quantiles
REST, AFTER = slice(-15, -1), slice(6, 16)  # samples around the blow


class Idle(NamedTuple):
    """A blow that moved nothing."""

    moved_mm: float
    shift_counts: float
    answered: dict[str, tuple[bool, bool, bool]]  # within 0.5 s, within 3 s; in 0.5 s before
    kind: str = "tap"
    slid_mm: float = np.nan  # of the contact, to and fro; of a tap nobody noted it


def of_recordings(recordings: Sequence[Recording], detectors: Sequence[str]) -> Iterator[Idle]:
    for r in recordings:
        idle = [b for b in blows_of(r) if b.moved_m < UNMOVED_M and b.struck >= WARM_UP_SAMPLES]
        if not idle:
            continue
        starts = {name: _starts(name, r.counts) for name in detectors}
        kinds = _kinds(r)
        for b in idle:
            yield Idle(
                1e3 * b.moved_m, _shift(r.counts, b.struck),
                {n: _answered(at, r.t_s, b.struck, b.until, b.until) for n, at in starts.items()},
                kinds[b.struck], _slid_mm(r, b.struck, b.until),
            )  # fmt: skip


def _kinds(r: Recording) -> dict[int, str]:
    """Of the act that fell last before a sample."""
    acts = r.metadata.acts if r.metadata else ()
    at = np.searchsorted(r.t_s - r.t_s[0], [act.t_s for act in acts], side="right")
    return {int(k): act.kind for k, act in zip(at, acts, strict=True)}


def _slid_mm(r: Recording, struck: int, until: int) -> float:
    if r.contact_speed_mps is None:
        return np.nan
    return 1e3 * PERIOD_S * float(np.abs(r.contact_speed_mps[struck:until]).sum())


def of_taps(draw: Draw, detectors: Sequence[str], workers: Workers) -> Iterator[Idle]:
    for taps in results(partial(all_taps, draw), names("objects"), workers):
        for s in taps:
            struck = int(np.searchsorted(s.t_s, s.struck_s, side="right"))
            if 1e-3 * s.moved_mm >= UNMOVED_M or struck + AFTER.stop > len(s.t_s):
                continue
            soon = int(np.searchsorted(s.t_s, s.struck_s + WATCHED_S, side="right"))
            end = int(np.searchsorted(s.t_s, min(s.until_s, s.struck_s + WATCHED_TAP_S)))
            heard = {
                n: _answered(_starts(n, s.counts), s.t_s, struck, soon, end) for n in detectors
            }
            yield Idle(s.moved_mm, _shift(s.counts, struck), heard)


def _starts(name: str, counts: NDArray[np.int16]) -> NDArray[np.intp]:
    config = load_config("can", "simulated", name)
    p, _ = stream(config.make_detector(counts.shape[1]), counts)
    return registered_events(p, config.rule)[:, 0]


def _answered(
    starts: NDArray[np.intp], t_s: NDArray[np.float64], struck: int, soon: int, end: int
) -> tuple[bool, bool, bool]:
    before = int(np.searchsorted(t_s, t_s[struck] - WATCHED_S))
    spans = ((struck, soon), (struck, end), (before, struck))
    first, whole, earlier = (bool(((starts >= a) & (starts < b)).any()) for a, b in spans)
    return first, whole, earlier


def _shift(counts: NDArray[np.int16], struck: int) -> float:
    rest = counts[max(0, struck + REST.start) : struck + REST.stop].astype(np.float64)
    later = counts[struck + AFTER.start : struck + AFTER.stop].astype(np.float64)
    return float(np.sqrt(((later.mean(axis=0) - rest.mean(axis=0)) ** 2).mean()))


def table(every: dict[str, list[Idle]], detectors: Sequence[str]) -> str:
    known = np.sort([i.shift_counts for i in every["validation"]])
    borders = [quantile(known, k / CLASSES) for k in range(1, CLASSES)]
    heads = (
        "blows",
        "n",
        "moved it, mm, p50 / p90",
        "fingertips off, counts, p50 / p90",
        *(
            f"`{d}`: {w}"
            for d in detectors
            for w in ("within 0.5 s", "within 3 s", "in 0.5 s before", "by validation's shares")
        ),
    )
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for title, idle in every.items():
        cells = [title, str(len(idle)), _two([i.moved_mm for i in idle], 2),
                 _two([i.shift_counts for i in idle], 1)]  # fmt: skip
        for d in detectors:
            cells += [share(idle, d, which) for which in range(3)]
            cells.append(f"{100 * foretold(idle, every['validation'], d, borders):.0f} %")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(
        [*lines, "", by_class(every, detectors, borders), "", by_course(every, detectors)]
    )


def by_class(
    every: dict[str, list[Idle]], detectors: Sequence[str], borders: Sequence[float]
) -> str:
    ends = ["0", *(f"{b:.1f}" for b in borders), ""]
    titles = [f"{low}-{high}" for low, high in pairwise(ends)]
    lines = [f"| within 0.5 s, fingertips off by, counts | {' | '.join(titles)} |",
             "|---" * (len(titles) + 1) + "|"]  # fmt: skip
    for title, idle in every.items():
        classes = np.digitize([i.shift_counts for i in idle], borders)
        for d in detectors:
            hit = np.array([i.answered[d][0] for i in idle])
            cells = [f"{int(hit[classes == k].sum())} of {int((classes == k).sum())}"
                     for k in range(CLASSES)]  # fmt: skip
            lines.append(f"| {title}, `{d}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def by_course(every: dict[str, list[Idle]], detectors: Sequence[str]) -> str:
    """Of the data sets' blows together: by kind, and by how far the contact slid."""
    idle = [i for its in every.values() for i in its if np.isfinite(i.slid_mm)]
    lines = [f"| blows | n | slid, mm, p50 / p90 | {' | '.join(f'`{d}`' for d in detectors)} |",
             "|---" * (len(detectors) + 3) + "|"]  # fmt: skip
    parts = {kind: [i for i in idle if i.kind == kind] for kind in sorted({i.kind for i in idle})}
    for low, high in pairwise((0.0, *SLID_MM, np.inf)):
        parts[f"slid {low:g}-{high:g} mm"] = [i for i in idle if low <= i.slid_mm < high]
    for d in detectors:
        parts[f"answered by `{d}`"] = [i for i in idle if i.answered[d][0]]
    for title, its in parts.items():
        heard = [str(sum(i.answered[d][0] for i in its)) for d in detectors]
        slid = _two([i.slid_mm for i in its], 2) if its else "–"
        lines.append(f"| {title} | {len(its)} | {slid} | {' | '.join(heard)} |")
    return "\n".join(lines)


def foretold(
    idle: Sequence[Idle], known: Sequence[Idle], detector: str, borders: Sequence[float]
) -> float:
    """What validation's share of each class would make of these."""
    of_known = np.digitize([i.shift_counts for i in known], borders)
    hit = np.array([i.answered[detector][0] for i in known])
    shares = np.array([
        hit[of_known == k].mean() if (of_known == k).any() else hit.mean() for k in range(CLASSES)
    ])  # fmt: skip
    return float(shares[np.digitize([i.shift_counts for i in idle], borders)].mean())


def share(idle: Sequence[Idle], detector: str, which: int) -> str:
    hits = sum(i.answered[detector][which] for i in idle)
    low, high = wilson(hits, len(idle))
    return f"{hits} ({100 * hits / len(idle):.1f} % [{100 * low:.1f}, {100 * high:.1f}])"


def _two(values: Sequence[float], digits: int) -> str:
    ordered = sorted(values)
    return " / ".join(f"{quantile(ordered, q):.{digits}f}" for q in (0.5, 0.9))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("detectors", nargs="+")
    parser.add_argument("--data", type=Path, nargs="+", required=True, metavar="DIR")
    parser.add_argument("--taps", type=int, default=4, help="of the mallet, an object and strength")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    every = {
        split: list(of_recordings(read_split(args.data, split), args.detectors))
        for split in ("validation", "test")
    }
    if args.taps:
        draw = Draw(FIRST_SEED, args.taps, 0)
        every["the mallet's"] = list(of_taps(draw, args.detectors, Workers(args.jobs)))
    print(table(every, args.detectors))
    return 0


if __name__ == "__main__":
    sys.exit(main())
