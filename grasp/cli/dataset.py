"""`grasp dataset`: build a data set of labelled recordings, or collect one."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grasp.cli import exits
from grasp.cli.options import add_workers, decimal, progress, whole, workers
from grasp.cli.output import json_line
from grasp.cli.parser import group, verb
from grasp.cli.places import folder_to_fill

HELP = "build and collect data sets of labelled fingertip recordings"


def add_parser(verbs: Any) -> None:
    actions = group(verbs, "dataset", HELP)
    _add_build(actions)
    _add_collect(actions)


def _add_build(actions: Any) -> None:
    parser = verb(actions, "build", build, "make all recordings of a data set, on the simulated "
        "rig", ". The same file gives the same recordings, on any number of processes. An "
        "interrupted build continues where it stopped.")  # fmt: skip
    parser.option("config FILE", "its path, or the name of one of config/datasets: paper, "
        "confusers, grasped-slip, mallet, observer, turning")  # fmt: skip
    parser.option("--out DIR", "folder to fill", folder_to_fill, required=True)
    add_workers(parser)
    parser.option("--share X", "share of the recordings to build, at most 1, with the same "
        "distribution; at least three recordings of each "
        "kind", decimal(1e-4, 1), default=1.0)  # fmt: skip
    parser.option("--seed N", "random seed for other recordings of the same distribution "
        "(default: the file's "
        "seed)", whole(1, 2**31 - 1))  # fmt: skip
    parser.flag("--json", "one JSON object on standard output, nothing else")


def _add_collect(actions: Any) -> None:
    parser = verb(actions, "collect", collect, "make a data set of your own recordings",
        ": labelled samples of acquisitions, and .npz or .csv files. Of each five of a motion on a "
        "surface, three are for training, one for validation, one for test; three put it into each "
        "split.")  # fmt: skip
    parser.option("source RUN|FILE", "folders of `grasp run acquire`, and files of counts (.npz, "
        ".csv)", Path, nargs="+")  # fmt: skip
    parser.option("--out DIR", "folder to fill", folder_to_fill, required=True)
    parser.flag("--json", "one JSON object on standard output, nothing else")


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
