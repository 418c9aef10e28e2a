"""`grasp world delay`: how late the paper's network is on a data set, a yardstick."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import need, progress, seed, whole

STEPS = 1500


def add_delay(actions: Any) -> None:
    """Add the verb to those of `grasp world`."""
    text = "train the paper's network on each part of a data set, and say how late it is there"
    parser = actions.add_parser(
        "delay",
        help=text,
        description=text + ", with the paper's rule of two in a row above 0.5, beside the authors' "
        "113 ms at 91.3 %. Needs the extra `train`; one thread, some processor minutes a row.",
    )
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="made by `grasp dataset build`"
    )
    parser.add_argument(
        "--recipe", nargs="+", choices=("dense", "paper"), default=["dense", "paper"],
        help="dense: learns from every sample; paper: from the last of each window, as its authors "
        "did (default: both)",
    )  # fmt: skip
    parser.add_argument(
        "--without", nargs="+", default=[], metavar="TERM",
        help="also the part `compliant` made anew without this term (named as by `calibrate "
        "--check --data --ablate`)",
    )  # fmt: skip
    parser.add_argument(
        "--steps", type=whole(1, 10**6), default=STEPS, metavar="N",
        help="of the optimiser (default: %(default)s, which is short)",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="(default: 0)")
    parser.add_argument("--json", action="store_true", help="the rows as a JSON array")
    parser.set_defaults(handler=delay)


def delay(args: argparse.Namespace) -> int:
    """One training a part, or a term left out, and a recipe."""
    need("train", "torch", "onnx")
    import msgspec

    from scenarios.studies.signal import delay as yardstick

    rows = []
    with progress("training", hidden=args.json) as show:
        for name, recordings in _sets(args):
            for recipe in args.recipe:
                tell = partial(_tell, show, f"{name}, {recipe}")
                made = yardstick.measure(recordings, name, recipe, args.steps, args.seed, tell)
                rows.append(made)
    print(msgspec.json.encode(rows).decode() if args.json else yardstick.table(rows))
    return exits.SUCCESS


def _tell(show: Any, what: str, step: int, steps: int) -> None:
    show(step, steps, what)


def _sets(args: argparse.Namespace) -> Any:
    """Names and recordings: parts as they are, then those without a term."""
    from scenarios.benchmark.data_sets import read_set
    from scenarios.studies.signal import terms
    from scenarios.studies.signal.judge.report import by_part

    if unknown := set(args.without) - set(terms.TERMS):
        raise UsageError(f"no such term: {', '.join(sorted(unknown))}", ", ".join(terms.TERMS))
    found = by_part(read_set(args.data, tell=exits.say))
    yield from ((part or "all", recordings) for part, recordings in found.items())
    for term in args.without:
        config, most = terms.origin_of(args.data), len(found[terms.COMPLIANT])
        jobs = terms.jobs_without(config, terms.TERMS[term], most)
        yield f"without: {term}", list(terms.made(jobs))
