"""Detectors on a draw that nothing was settled on: taps, lifts, data sets, the real clip.

    python scripts/last_draw.py --data DIR... [--recording FILE] [--out FILE.json]
    python scripts/last_draw.py --first-seed 90000 --objects can box        a look on other seeds

Taps of the six objects and of the second half dozen at five strengths are run once, with nobody
answering; every detector hears the same counts and decides by its packaged rule. Lifts are run in
the loop, each with every detector. Prints a Markdown table a kind; whatever it says is reported,
and nothing is tuned on it: looks are taken on other seeds.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import registered_events
from detector.recordings import read
from detector.scores.evaluation import Evaluation, evaluate_recording, stream
from detector.scores.quantiles import Quantiles, quantiles
from grasp.loop import Tick
from grasp.settings import UNSEEN, names
from scenarios.campaign.config import load_config
from scenarios.campaign.paper import wilson
from scenarios.lift import lift
from scenarios.studies.detectors.benchmark import contender, read_split
from scenarios.tap import tap
from scenarios.trial.series import Bench

DETECTORS = ("tcn", "gru", "energy", "psd-fair", "tcn-paper")
STRENGTHS = (0.2, 0.4, 0.6, 0.8, 1.0)  # of the blow that moves the object 7 mm
FIRST_SEED = 50_000  # of the draw; no campaign, figure or test has it
SOON_MS = 100.0
CLASSES = {"2 mm or more": (2.0, np.inf), "1-2 mm": (1.0, 2.0), "0.5-1 mm": (0.5, 1.0),
           "within 0.5 mm": (0.0, 0.5)}  # fmt: skip


class Struck(msgspec.Struct, frozen=True, eq=False):
    """A tap as every detector hears it: frames since the detector was last reset."""

    object: str
    moved_mm: float
    struck_s: float
    onset_s: float
    until_s: float
    t_s: NDArray[np.float64]
    counts: NDArray[np.int16]


class Lifted(msgspec.Struct, frozen=True):
    """A lift in the loop."""

    object: str
    outcome: str
    held: bool
    reaction_ms: float | None
    slip_mm: float | None


def taps(name: str, seeds: range) -> Iterator[Struck]:
    for strength in STRENGTHS:
        words = [f"tap.strength={strength}"]
        config = load_config(name, "simulated", None, None, words).for_tap()
        ticks: list[Tick] = []
        for finished in tap.run_series(config, seeds, Bench(on_tick=ticks.append)):
            r = finished.result
            if r is not None and r.struck_s is not None and r.displacement_m is not None:
                t_s, counts = _since_reset(ticks, r.struck_s)
                onset_s = r.struck_s if r.slip_onset_s is None else r.slip_onset_s
                until_s = r.watched_until_s or np.inf
                yield Struck(
                    name, 1e3 * r.displacement_m, r.struck_s, onset_s, until_s, t_s, counts
                )
            ticks.clear()


def _since_reset(
    ticks: Sequence[Tick], struck_s: float
) -> tuple[NDArray[np.float64], NDArray[np.int16]]:
    first = 0
    for i, tick in enumerate(ticks):
        if tick.decision.reset_detector and tick.t_ns * 1e-9 < struck_s:
            first = i + 1
    heard = [tick for tick in ticks[first:] if tick.frame is not None]
    counts = np.stack([tick.frame.counts for tick in heard if tick.frame is not None])
    return np.array([tick.t_ns * 1e-9 for tick in heard]), counts


def answers_ms(detector: str, struck: Sequence[Struck]) -> NDArray[np.float64]:
    """From each one's first motion to the alarm that begins after the blow; infinite: none."""
    config = load_config("can", "simulated", detector)
    made = config.make_detector(3)
    found = []
    for s in struck:
        p, _ = stream(made, s.counts)
        at_s = s.t_s[registered_events(p, config.rule)[:, 0]]
        after = at_s[(at_s >= s.struck_s) & (at_s <= s.until_s)]
        found.append(1e3 * (after[0] - s.onset_s) if len(after) else np.inf)
    return np.array(found)


def lifts(name: str, detector: str, seeds: range) -> Iterator[Lifted]:
    config = load_config(name, "simulated", detector).for_lift()
    for seed in seeds:
        r = lift.run(config, seed, None).result
        if r is not None:
            slip_mm = None if r.slip_distance_m is None else 1e3 * r.slip_distance_m
            yield Lifted(name, str(r.outcome), bool(r.success), r.reaction_latency_ms, slip_mm)


def share(hits: int, n: int) -> str:
    if not n:
        return "–"
    low, high = wilson(hits, n)
    return f"{hits} of {n} ({100 * hits / n:.0f} % [{100 * low:.0f}, {100 * high:.0f}])"


def of(q: Quantiles | None, digits: int = 0) -> str:
    return "–" if q is None else " / ".join(f"{v:.{digits}f}" for v in (q.p50, q.p90, q.p99))


def tap_table(struck: Sequence[Struck], answers: dict[str, NDArray[np.float64]]) -> str:
    moved = np.array([s.moved_mm for s in struck])
    held = np.array([s.object for s in struck])
    lines = ["| detector | 2 mm or more, within 100 ms | 1-2 mm | 0.5-1 mm | "
             "within 0.5 mm (false) | ms after first motion, p50 / p90 / p99 of those of 2 mm | "
             "worst object |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for name, delay in answers.items():
        cells, soon = [], delay <= SOON_MS
        for title, (low, high) in CLASSES.items():
            which = (moved >= low) & (moved < high)
            heard = soon if title == "2 mm or more" else np.isfinite(delay)
            cells.append(share(int((which & heard).sum()), int(which.sum())))
        far = moved >= CLASSES["2 mm or more"][0]
        worst = min((float(soon[far & (held == o)].mean()), str(o)) for o in sorted(set(held[far])))
        lines.append(f"| `{name}` | {' | '.join(cells)} | {of(quantiles(delay[far]))} | "
                     f"{worst[1]} {100 * worst[0]:.0f} % |")  # fmt: skip
    return "\n".join(lines)


def lift_table(lifted: dict[str, list[Lifted]]) -> str:
    lines = ["| detector | held | force rises after onset, ms, p50 / p90 / p99 | slipped, mm | "
             "otherwise |", "|---|---|---|---|---|"]  # fmt: skip
    for name, every in lifted.items():
        reaction = quantiles(r.reaction_ms for r in every if r.slip_mm is not None)
        slipped = quantiles(r.slip_mm for r in every if r.slip_mm is not None)
        lost = [r.outcome for r in every if not r.held]
        other = ", ".join(f"{lost.count(o)} {o}" for o in sorted(set(lost)))
        held = share(sum(r.held for r in every), len(every))
        lines.append(f"| `{name}` | {held} | {of(reaction)} | {of(slipped, 1)} | {other or '–'} |")
    return "\n".join(lines)


def data_table(detectors: Sequence[str], folders: Sequence[Path], clip: Path | None) -> str:
    lines = ["| detector | data | accuracy, % | AUC | recall | false a minute, hand | delay, ms, "
             "p50 / p90 / p99 | us |", "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    parts = [[folder] for folder in folders] + [list(folders)]
    for name in detectors:
        for part in parts:
            s = contender(name, read_split(part, "test"), "test").evaluation()
            lines.append(_row(name, "all" if len(part) > 1 else part[0].name, s))
        if clip is not None:
            config = load_config("can", "simulated", name)
            s = evaluate_recording(config.make_detector(1), config.rule, read(clip))
            lines.append(_row(name, "real clip", s))
    return "\n".join(lines)


def _row(name: str, data: str, s: Evaluation) -> str:
    low, high = s.intervals.get("auc", (np.nan, np.nan))
    return (f"| `{name}` | {data} | {100 * s.accuracy:.1f} | {s.auc or 0:.3f} [{low:.3f}, "
            f"{high:.3f}] | {s.event_recall or 0:.3f} | {s.false_events_per_min_hand or 0:.2f} | "
            f"{of(s.delay_ms)} | {s.compute_us.p50 if s.compute_us else 0:.0f} |")  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--data", type=Path, nargs="*", default=[])
    parser.add_argument("--recording", type=Path)
    parser.add_argument("--detectors", nargs="+", default=DETECTORS)
    parser.add_argument(
        "--objects", nargs="+", default=[*names("objects"), *names(f"objects/{UNSEEN}")]
    )
    parser.add_argument("--taps", type=int, default=8, help="an object and strength")
    parser.add_argument("--lifts", type=int, default=10, help="an object and detector")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    struck = [
        s for o in args.objects
        for s in taps(o, range(args.first_seed, args.first_seed + args.taps))
    ]  # fmt: skip
    answers = {d: answers_ms(d, struck) for d in args.detectors} if struck else {}
    print(f"{len(struck)} taps\n\n{tap_table(struck, answers)}\n" if struck else "", flush=True)
    seeds = range(args.first_seed, args.first_seed + args.lifts)
    lifted = {d: [r for o in args.objects for r in lifts(o, d, seeds)] for d in args.detectors}
    print(lift_table(lifted), flush=True)
    if args.data:
        print(f"\n{data_table(args.detectors, args.data, args.recording)}", flush=True)
    if args.out is not None:
        rows = [{"object": s.object, "moved_mm": s.moved_mm,
                 "answers_ms": {d: float(a[i]) for d, a in answers.items()}}
                for i, s in enumerate(struck)]  # fmt: skip
        args.out.write_bytes(msgspec.json.encode({"taps": rows, "lifts": lifted}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
