"""`grasp dataset`: build a data set of labelled recordings, collect one, say what one holds."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grasp.cli import exits
from grasp.cli.options import add_workers, decimal, progress, whole, workers
from grasp.cli.output import json_line
from grasp.cli.places import folder_to_fill

HELP = "build and describe data sets of labelled fingertip recordings"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("dataset", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _add_build(actions)
    _add_describe(actions)
    _add_collect(actions)


def _add_build(actions: Any) -> None:
    text = "make all recordings of a data set, on the simulated rig"
    parser = actions.add_parser(
        "build",
        help=text,
        description=text + ". The same file gives the same recordings, on any number of processes. "
        "A build that was ended goes on where it was.",
    )
    parser.add_argument(
        "config",
        metavar="FILE",
        help="its path, or the name of one of config/datasets: paper, confusers, grasped-slip, "
        "mallet, observer, turning",
    )
    parser.add_argument(
        "--out", type=folder_to_fill, required=True, metavar="DIR", help="folder to fill"
    )
    add_workers(parser)
    parser.add_argument(
        "--share", type=decimal(1e-4, 1), default=1.0, metavar="X",
        help="build so much of it, at most 1, with the same distribution; of each kind three "
        "recordings at least (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=whole(1, 2**31 - 1), metavar="N",
        help="draw other recordings of the same distribution (default: the file's seed)",
    )  # fmt: skip
    _add_json(parser)
    parser.set_defaults(handler=build)


def _add_describe(actions: Any) -> None:
    text = "counts and statistics of a data set beside the paper's"
    parser = actions.add_parser("describe", help=text, description=text)
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of recordings")
    parser.add_argument(
        "--split", choices=("train", "validation", "test"), help="of this split alone"
    )
    _add_json(parser)
    parser.set_defaults(handler=describe)


def _add_collect(actions: Any) -> None:
    text = "make a data set of your own recordings"
    parser = actions.add_parser(
        "collect", help=text,
        description=text + ": labelled samples of acquisitions, and .npz or .csv files. Of each "
        "five of a motion on a surface, three are for training, one for validation, one for test; "
        "three put it into each split.",
    )  # fmt: skip
    parser.add_argument(
        "source",
        type=Path,
        nargs="+",
        metavar="RUN|FILE",
        help="folders of `grasp run acquire`, and files of counts (.npz, .csv)",
    )
    parser.add_argument(
        "--out", type=folder_to_fill, required=True, metavar="DIR", help="folder to fill"
    )
    _add_json(parser)
    parser.set_defaults(handler=collect)


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, nothing else"
    )


def build(args: argparse.Namespace) -> int:

    import msgspec

    from grasp.settings import file_of
    from scenarios.acquire.datasets import build as datasets
    from scenarios.acquire.datasets.plan import load_dataset_config, plan, reduced

    config = reduced(load_dataset_config(file_of("datasets", args.config)), args.share)
    if args.seed is not None:
        config = msgspec.structs.replace(config, seed=args.seed)
    jobs = plan(config)
    with progress("recordings", hidden=args.json) as show:
        told = _Told(_plan_text(jobs), show)
        try:
            made = datasets.build(jobs, config, args.out, workers(args), told)
        except KeyboardInterrupt:
            kept = f"{told.done} of {len(jobs)} recordings are in {args.out}"
            return exits.report("interrupted", kept, "run the same command again", args.json)
    samples = sum(job.samples for job in jobs)
    if args.json:
        print(json_line({"folder": str(args.out), "recordings": len(jobs), "made": made,
                          "samples": samples}))  # fmt: skip
    else:
        print(f"{args.out}: {len(jobs)} recordings, {samples} samples; {made} made now")
    return exits.SUCCESS


def collect(args: argparse.Namespace) -> int:

    from scenarios.acquire.datasets.collect import collect as collected
    from scenarios.benchmark.data_sets import require_labelled

    for source in args.source:
        require_labelled(source)
    made = collected(args.source, args.out)
    if args.json:
        print(json_line({"folder": str(args.out), **made.counts, "lacking": made.lacking}))
        return exits.SUCCESS
    print(f"{args.out}: " + ", ".join(f"{n} for {split}" for split, n in made.counts.items()))
    for split, kinds in made.lacking.items():
        exits.say(f"none for {split}: {', '.join(kinds)}")
    if made.lacking:
        exits.say("three recordings of a motion on a surface put it into each split")
    return exits.SUCCESS


class _Told:
    """What is to be made, as soon as it is known that it can be, then how far it is; what a build
    before this one made tells nothing of the time left."""

    def __init__(self, plan: str, show: Callable[..., None]) -> None:
        self._plan, self._show = plan, show
        self._before: int | None = None
        self.done = 0

    def __call__(self, done: int, total: int) -> None:
        self.done = done
        if self._before is None:
            self._before = done
            there = f"; {done} are there" if done else ""
            exits.say(f"{self._plan}{there}")
        else:
            self._show(done - self._before, total - self._before)


def _plan_text(jobs: Any) -> str:
    """How many recordings, and how many of them nothing can be scored by."""
    from detector.scores.evaluation import WARM_UP_SAMPLES
    from scenarios.benchmark.scoring import too_short

    short = sum(job.samples <= WARM_UP_SAMPLES for job in jobs)
    many = f"{len(jobs)} recordings"
    return f"{many}; {too_short(short)}: a larger --share makes them longer" if short else many


def describe(args: argparse.Namespace) -> int:
    import msgspec

    from scenarios.acquire.datasets import describe
    from scenarios.benchmark.data_sets import read_set

    recordings = read_set(args.folder, args.split, exits.say)
    figures = describe.describe(recordings)
    if args.json:
        print(msgspec.json.encode(figures).decode())
    else:
        print_figures(figures)
    return exits.SUCCESS


def print_figures(r: Any) -> None:
    """Figures beside the paper's, as tables."""
    from scenarios.acquire.datasets.describe import PAPER_SLIP, PAPER_STATIC

    print(f"{r.recordings} recordings, {r.samples} samples: {r.static} static, {r.slip} slip")
    print(f"paper: {PAPER_STATIC + PAPER_SLIP} samples: {PAPER_STATIC} static, {PAPER_SLIP} slip")
    if r.slip_true is not None:
        print(f"slip_true: {r.slip_true}; equal to the label slip in {r.labels_agree:.1%}")
    if r.moved is not None:
        print(f"moved: {r.moved} samples are 1 mm or more from where they last rested")
    if r.speed_p50_mps is not None:
        print(f"speed where labelled slip: p50 {r.speed_p50_mps * 1e3:.0f}, "
              f"p99 {r.speed_p99_mps * 1e3:.0f} mm/s")  # fmt: skip
    print("splits: " + ", ".join(f"{name} {n}" for name, n in r.splits.items()))
    print(f"\n{'kind':<32}{'recordings':>10}{'samples':>9}{'slip %':>8}{'moved %':>9}{'at 0 %':>8}")
    for name, k in r.kinds.items():
        moved = "-" if k.moved is None else f"{100 * k.moved:.1f}"
        print(f"{name:<32}{k.recordings:>10}{k.samples:>9}{100 * k.slip:>8.1f}{moved:>9}"
              f"{100 * k.at_rail:>8.1f}")  # fmt: skip
    if r.table:
        print(f"\n{'Table I':<12}{'speed':>7}  {'surface':<12}{'samples':>8}{'slip':>8}"
              f"{'%':>7}{'paper':>7}")  # fmt: skip
    for c in r.table:
        paper = "-" if c.paper_percent is None else f"{c.paper_percent:.1f}"
        print(f"{c.motion:<12}{c.speed:>7g}  {c.surface:<12}{c.samples:>8}{c.slip:>8}"
              f"{c.percent:>7.1f}{paper:>7}")  # fmt: skip
