"""`grasp detector windows`, `ablations`, `table3`, `latency`: the paper's study of detection."""

import argparse
import itertools
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.options import need, one_by_one, progress, whole
from grasp.cli.pictures import add_picture, write_numbers
from grasp.cli.rules import check_named

WINDOWS = (10, 30, 50, 70, 100)
STEPS = 1500


def add_parser(actions: Any) -> None:
    _add_windows(actions)
    _add_ablations(actions)
    _add_table3(actions)
    _add_latency(actions)


def _add_windows(actions: Any) -> None:
    text = "the paper's network in windows of several lengths: accuracy, delay, cost"
    parser = actions.add_parser(
        "windows", help=text,
        description=text + ". All are trained anew on the same budget, and scored on the split "
        "`test` with the paper's rule. Needs the extras `train` and `charts`.",
    )  # fmt: skip
    parser.add_argument(
        "--windows", type=whole(2, 100), nargs="+", default=WINDOWS, metavar="N",
        help=f"samples of 10 ms (default: {' '.join(map(str, WINDOWS))})",
    )  # fmt: skip
    _add_training(parser)
    add_picture(parser, "windows")
    parser.set_defaults(handler=windows)


def _add_ablations(actions: Any) -> None:
    text = "the paper's network without layer norm, and with each augmentation or none"
    parser = actions.add_parser(
        "ablations", help=text,
        description=text + ". All are trained anew on the same budget, and scored on the split "
        "`test` with the paper's rule. Needs the extra `train`.",
    )  # fmt: skip
    _add_training(parser)
    parser.set_defaults(handler=ablations)


def _add_training(parser: argparse.ArgumentParser) -> None:
    _add_data(parser)
    parser.add_argument(
        "--steps", type=whole(1, 10**7), default=STEPS, metavar="N",
        help="of each training, 3,200 samples a step (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--seeds", type=whole(1, 100), default=2, metavar="N", help="(default: %(default)s)"
    )
    parser.add_argument(
        "--networks", type=Path, metavar="DIR",
        help="keep the weights here; what is there already is not trained again",
    )  # fmt: skip


def _add_table3(actions: Any) -> None:
    text = "the paper's table by motion, speed and surface, with intervals and its five statements"
    parser = actions.add_parser(
        "table3", help=text,
        description=text + ", as Markdown. Each cell needs five recordings: a set built for it by "
        "`grasp dataset build paper --seed N`.",
    )  # fmt: skip
    parser.add_argument(
        "detector", nargs="*", metavar="NAME|FILE.onnx", default=("tcn-paper",),
        help="(default: tcn-paper)",
    )  # fmt: skip
    _add_data(parser)
    parser.add_argument(
        "--split", choices=("test", "all"), default="all",
        help="what to score; all is fair on a set of a seed of its own (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--swept-on", type=Path, nargs="+", default=(), metavar="DIR",
        help="sweep the thresholds of detectors of one number on the split `train` of these, as "
        "`table2` does (default: the packaged thresholds)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="one JSON object a detector")
    parser.set_defaults(handler=table3)


def _add_latency(actions: Any) -> None:
    text = "how long after its beginning each slip is registered, beside the paper's 113 ms"
    parser = actions.add_parser(
        "latency", help=text,
        description=text + ", by the detector's own rule on the split `test`. Needs the extra "
        "`charts`.",
    )  # fmt: skip
    parser.add_argument(
        "detector", nargs="?", default="tcn-paper", metavar="NAME", help="(default: %(default)s)"
    )
    _add_data(parser)
    parser.add_argument(
        "--label", choices=("slip", "slip_true"), default="slip",
        help="beginning: of the fingertip's motion, as in the paper, or of the contact's own "
        "(default: %(default)s)",
    )  # fmt: skip
    add_picture(parser, "latency")
    parser.set_defaults(handler=latency)


def _add_data(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR",
        help="folders of `grasp dataset build`, or `collect`",
    )  # fmt: skip


def windows(args: argparse.Namespace) -> int:
    need("train", "torch", "onnx")
    need("charts", "matplotlib")
    from scenarios.studies.detectors.variants import table, window_variants
    from scenarios.studies.detectors.window_figure import draw_windows

    rows = _trained(args, window_variants(args.windows))
    draw_windows(rows, args.out)
    write_numbers(args.out, rows)
    print(table(rows))
    print(args.out)
    return exits.SUCCESS


def ablations(args: argparse.Namespace) -> int:
    need("train", "torch", "onnx")
    from scenarios.studies.detectors.variants import ABLATIONS, table

    print(table(_trained(args, ABLATIONS)))
    return exits.SUCCESS


def _trained(args: argparse.Namespace, variants: Any) -> list[Any]:
    """A row for every variant and seed; all variants of a seed before the next."""
    from scenarios.benchmark.data_sets import require_whole
    from scenarios.benchmark.scoring import read_split
    from scenarios.studies.detectors.variants import Sets, train

    require_whole(args.data)
    sets = Sets(*(read_split(args.data, split) for split in ("train", "validation", "test")))
    rows = []
    with _folder(args.networks) as folder, progress("training") as show:
        for seed, variant in itertools.product(range(args.seeds), variants):
            tell = partial(_tell, show, f"{variant.name}, seed {seed}")
            rows.append(train(variant, args.steps, seed, sets, folder, tell))
    return rows


def _tell(show: Any, what: str, step: int, steps: int) -> None:
    show(step, steps, what)


@contextmanager
def _folder(kept: Path | None) -> Iterator[Path]:
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        yield kept
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def table3(args: argparse.Namespace) -> int:
    import msgspec

    from detector.scores.cells import cell_table, require_cells
    from detector.scores.tables import cells_table
    from scenarios.benchmark.scoring import named, read_split

    check_named(args.detector)
    both = {folder.resolve() for folder in args.data} & {f.resolve() for f in args.swept_on}
    if both and args.split == "all":
        text = f"{min(both)}: its split train would be swept on and scored"
        raise UsageError(text, "--split test, or a set of another seed")
    recordings = read_split(args.data, args.split, exits.say)
    require_cells(recordings)
    _tell_learnt(recordings)
    for name, tell in one_by_one(args.detector, "streaming", hidden=args.json):
        m = named(name, recordings, args.split, args.swept_on, tell=tell)
        tell_swept(m, args.swept_on)
        found = cell_table(m.detector.name, m.detector.threshold, m.config.rule, m.streams)
        print(msgspec.json.encode(found).decode() if args.json else cells_table(found) + "\n")
    return exits.SUCCESS


def _tell_learnt(recordings: Sequence[Any]) -> None:
    """Warn of recordings that the packaged networks have learnt from, or were chosen and tuned by:
    what is scored on them is no test of these."""
    from scenarios.benchmark.data_sets import learnt_from

    if known := learnt_from(recordings):
        exits.report_line(
            f"{known} of {len(recordings)} recordings are of those that the packaged networks have "
            "learnt from, or were tuned on"
        )
        exits.say("--split test, or a set of another seed, tests them")


def tell_swept(made: Any, swept_on: Sequence[Path]) -> None:
    """Which threshold a detector of one number has been given."""
    from scenarios.benchmark.scoring import threshold_of
    from scenarios.trial.config import FORMULAS

    if swept_on and made.config.detector_name in FORMULAS:
        setting, value = threshold_of(made.config)
        exits.say(f"{made.label}: {setting}={value:.4g}, swept")


def latency(args: argparse.Namespace) -> int:
    need("charts", "matplotlib")
    from scenarios.benchmark.scoring import contender, read_split
    from scenarios.studies.detectors.latency import latency as measure
    from scenarios.studies.detectors.latency_figure import draw_latency

    check_named([args.detector])
    recordings = read_split(args.data, "test", exits.say)
    for name, tell in one_by_one([args.detector], "streaming", hidden=False):
        found = measure(contender(name, recordings, "test", args.label, tell=tell))
    draw_latency(found, args.out)
    write_numbers(args.out, found)
    print(latency_text(found))
    print(args.out)
    return exits.SUCCESS


def latency_text(found: Any) -> str:
    """Delays as a person reads them."""
    q = found.of_all
    return (
        f"{found.detector}, {found.rule}, label {found.label}: mean of those caught "
        f"{found.mean_ms:.0f} ms (authors: 113); of all p50 {q.p50:.0f} p90 {q.p90:.0f} p99 "
        f"{q.p99:.0f} ms; {found.missed} of {q.count} missed, "
        f"{100 * found.later_than_authors:.0f} % later than 113 ms; false events a minute of a "
        f"hand {found.false_per_min_hand:.1f}, accuracy {100 * found.accuracy:.1f} %"
    )
