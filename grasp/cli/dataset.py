"""`grasp dataset`: build a data set of labelled recordings, or collect one."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits
from grasp.cli.options import add_workers, decimal, folder_to_fill, share, whole, workers
from grasp.cli.output import progress, show
from grasp.cli.parser import Parser


def add_commands(parser: Parser) -> None:
    made = parser.command("build", "make all recordings of a data set, on the simulated rig").runs(
        build, ". The same file gives the same recordings, on any number of processes. An "
        "interrupted build continues where it stopped.")  # fmt: skip
    made.option("config FILE", "its path, or the name of one of config/datasets: paper, "
        "confusers, grasped-slip, mallet, observer, turning")  # fmt: skip
    made.option("--out DIR", "folder to fill", folder_to_fill, required=True)
    add_workers(made)
    made.option("--share X", "share of the recordings to build, at most 1, with the same "
        "distribution; at least three recordings of each kind", decimal(1e-4, 1),
        default=1.0)  # fmt: skip
    made.option("--seed N", "random seed for other recordings of the same distribution "
        "(default: the file's seed)", whole(1, 2**31 - 1))  # fmt: skip
    share(made, "json")
    own = parser.command("collect", "make a data set of your own recordings").runs(
        collect, ": labelled samples of acquisitions, and .npz or .csv files. Of each five of a "
        "motion on a surface, three are for training, one for validation, one for test; three put "
        "it into each split.")  # fmt: skip
    own.option("source RUN|FILE", "folders of `grasp run acquire`, and files of counts (.npz, "
        ".csv)", Path, nargs="+")  # fmt: skip
    own.option("--out DIR", "folder to fill", folder_to_fill, required=True)
    share(own, "json")


def build(args: argparse.Namespace) -> int:
    import msgspec

    from detector.scores.evaluation import WARM_UP_SAMPLES
    from grasp.settings import file_of
    from scenarios.acquire.datasets import build as datasets
    from scenarios.acquire.datasets.plan import load_dataset_config, plan, reduced
    from scenarios.benchmark.scoring import too_short

    config = reduced(load_dataset_config(file_of("datasets", args.config)), args.share)
    if args.seed is not None:
        config = msgspec.structs.replace(config, seed=args.seed)
    jobs = plan(config)
    planned = f"{len(jobs)} recordings"
    if short := sum(job.samples <= WARM_UP_SAMPLES for job in jobs):
        planned += f"; {too_short(short)}: a larger --share makes them longer"
    before, finished = -1, 0
    with progress("recordings", hidden=args.json) as bar:

        def tell(done: int, total: int) -> None:  # earlier builds say nothing of the time left
            nonlocal before, finished
            finished = done
            if before < 0:
                before = done
                exits.say(planned + (f"; {done} are there" if done else ""))
            else:
                bar(done - before, total - before)

        try:
            made = datasets.build(jobs, config, args.out, workers(args), tell)
        except KeyboardInterrupt:
            kept = f"{finished} of {len(jobs)} recordings are in {args.out}"
            return exits.report("interrupted", kept, "run the same command again", args.json)
    samples = sum(job.samples for job in jobs)
    counts = {"recordings": len(jobs), "made": made, "samples": samples}
    text = f"{args.out}: {len(jobs)} recordings, {samples} samples; {made} made now"
    return show(args, {"folder": str(args.out), **counts}, text)


def collect(args: argparse.Namespace) -> int:
    from scenarios.acquire.datasets.collect import collect as collected
    from scenarios.benchmark.data_sets import require_labelled

    for source in args.source:
        require_labelled(source)
    made = collected(args.source, args.out)
    counts = ", ".join(f"{n} for {split}" for split, n in made.counts.items())
    value = {"folder": args.out, "lacking": made.lacking} | dict[Any, Any](made.counts)
    show(args, value, f"{args.out}: {counts}")
    if made.lacking and not args.json:
        for split, kinds in made.lacking.items():
            exits.say(f"none for {split}: {', '.join(kinds)}")
        exits.say("three recordings of a motion on a surface put it into each split")
    return exits.SUCCESS
