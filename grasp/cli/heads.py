"""`grasp detector heads` and `train-heads`: how fast, which way, sliding or turning."""

import argparse
from pathlib import Path
from typing import Any

from grasp.cli import exits
from grasp.cli.options import need, network_path, seed, whole
from grasp.cli.places import file_to_write, must_be_writable

SETS = "folders made by `grasp dataset build` that know how a fingertip moves"


def add_parser(actions: Any) -> None:
    _add_evaluate(actions)
    _add_train(actions)


def _add_evaluate(actions: Any) -> None:
    text = "what heads tell of slips, beside what can be told without them"
    parser = actions.add_parser(
        "heads", help=text,
        description=text + ": speed, direction, sliding or turning. Markdown tables, with 95 % "
        "intervals over recordings; then whether the true speed of a lift's slip would size a "
        "step of force.",
    )  # fmt: skip
    _add_common(parser)
    parser.add_argument(
        "--split", choices=("validation", "test"), default="test", help="(default: %(default)s)"
    )
    parser.set_defaults(handler=evaluate)


def _add_train(actions: Any) -> None:
    text = "train heads on the state of a network, which stays as it is (extra `train`)"
    parser = actions.add_parser(
        "train-heads", help=text,
        description=text + ". One thread. Learns from the split `train` and is scored on `test`. A "
        "detector has the heads that lie beside its weights as NAME.heads.json.",
    )  # fmt: skip
    _add_common(parser)
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="(default: %(default)s)")
    parser.add_argument("--steps", type=whole(1, 10**6), metavar="N", help="optimiser steps")
    parser.add_argument(
        "--out",
        type=file_to_write,
        metavar="FILE.heads.json",
        help="(default: NAME.heads.json here)",
    )
    parser.set_defaults(handler=train)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("network", metavar="NAME|FILE.onnx", help="packaged name, or a file")
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR", help=SETS
    )  # fmt: skip


def evaluate(args: argparse.Namespace) -> int:
    from detector.heads import read_heads
    from detector.network_file import read_network, weights_digest
    from drivers.errors import UsageError
    from scenarios.benchmark.data_sets import read_set
    from scenarios.studies.detectors.kinds import compared, sizing_table, sizings, table

    weights = network_path(args.network)
    loaded = read_network(weights)
    teller = read_heads(weights, weights_digest(weights), loaded)
    if teller is None:
        raise UsageError(f"{args.network} has no heads", "train some: `grasp detector train-heads`")
    print(table(compared(loaded, teller, args.data, args.split)))
    lifts = sizings([r for folder in args.data for r in read_set(folder, tell=exits.say)])
    if lifts:
        print(f"\n{sizing_table(lifts)}")
    return exits.SUCCESS


def train(args: argparse.Namespace) -> int:
    need("train", "torch")
    from detector.heads import SUFFIX, Teller, width_of
    from detector.network_file import read_network, weights_digest
    from detector.recordings import read_dataset
    from detector.scores.heads import felt
    from detector.training.heads import STEPS, HeadSettings, train_heads, write_heads
    from detector.training.sequences import digest
    from scenarios.benchmark.data_sets import require_whole
    from scenarios.studies.detectors.kinds import compared, table, with_scores
    from scenarios.trial.result import versions

    weights = network_path(args.network)
    out = args.out or Path(f"{weights.stem}{SUFFIX}")
    must_be_writable(out)
    loaded = read_network(weights)
    width_of(loaded)  # refused before hours of data, not after
    require_whole(args.data)
    recordings = [read_dataset(folder, "train") for folder in args.data]
    used = digest([r for each in recordings for r in each])
    made = train_heads(
        [felt(loaded, each) for each in recordings],
        HeadSettings(args.seed, args.steps or STEPS),
        weights_digest(weights), used, versions()["commit"],
    )  # fmt: skip
    rows = compared(loaded, Teller(made), args.data, "test")
    write_heads(with_scores(made, rows), out)
    print(table(rows))
    print(out)
    return exits.SUCCESS
