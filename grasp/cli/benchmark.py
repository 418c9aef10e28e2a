"""`grasp benchmark`: score detectors with the fixed protocol."""

import argparse
import shlex
from typing import Any

import msgspec

from detector.interface import DETECTORS
from grasp.cli import exits
from grasp.cli.detector import check_named
from grasp.cli.options import workers
from grasp.cli.output import progress, show
from grasp.files import make_private_folder, write_whole

FILE, COST, PAGE = "benchmark.json", "cost.json", "benchmark.html"
HEADINGS = (
    "detector", "right, %", "lifts", "taps", "delay p50 / p90, ms", "false alarms / min",
    "lasting slip, %", "AUC", "update, µs",
)  # fmt: skip


def benchmark(args: argparse.Namespace) -> int:
    from scenarios.acquire.config import layout_file
    from scenarios.benchmark.protocol import check_digest, load_protocol
    from scenarios.benchmark.run import Benchmark, BenchmarkFile, cost
    from scenarios.benchmark.streams import ensure_recordings
    from scenarios.campaign.config import load_config

    names = args.detector or list(DETECTORS)
    layout = [path] if (path := layout_file(args.layout)) else []
    files, pool = [*layout, *(args.config or ())], workers(args)
    check_named(names, files, args.set)
    protocol = load_protocol()
    check_digest(protocol, args.split)
    make_private_folder(args.out)
    configs = [load_config("can", "simulated", name, files, args.set).for_lift() for name in names]
    costs = {config.detector_label: cost(config) for config in configs}
    with progress("benchmark", hidden=args.json) as bar:
        folder = args.out / "-".join(filter(None, ("recordings", args.split, args.layout)))
        recordings = ensure_recordings(protocol, args.split, folder, pool, bar, args.layout)

    def report(title: str, done: int, of: int) -> None:
        if done == of:
            exits.print_detail(title)

    bench = Benchmark(protocol, args.split, recordings, args.recording or (), pool, report)
    oracle = bench.oracle(load_config("can", "simulated", "energy").for_lift())
    made = [bench.detector(config) for config in configs]
    file = BenchmarkFile(
        version=protocol.version, split=args.split, seeds=protocol.splits[args.split].digest,
        layout=args.layout, command=shlex.join(["grasp", "benchmark", *names]), detectors=made,
        oracle=oracle,
    )  # fmt: skip
    write_whole(
        args.out / FILE, msgspec.json.format(msgspec.json.encode(file), indent=1), private=True
    )
    write_whole(args.out / COST, msgspec.json.encode(costs), private=True)
    return show(args, file, table(file, costs))


def table(file: Any, costs: dict[str, Any]) -> str:
    """One row a detector, then the oracle."""
    rows: list[tuple[str, ...]] = [HEADINGS]
    for each in file.detectors:
        p, s = each.point, each.streams
        rows.append((
            each.detector, percent(p.right), percent(p.lifts_right), percent(p.taps_right),
            f"{ms(p.delay_p50_ms)} / {ms(p.delay_p90_ms)}", number(s.false_per_min),
            percent(s.sustained), number(s.auc, 3), f"{costs[each.detector].update_us:.0f}",
        ))  # fmt: skip
    first = file.oracle[0]
    rows.append(("oracle", *map(percent, (first.right, first.lifts_right, first.taps_right)),
                 f"{ms(first.delay_p50_ms)} / {ms(first.delay_p90_ms)}", "0", "100", "1", "")
    )  # fmt: skip
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADINGS))]
    return "\n".join(
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows
    )


def percent(figure: Any) -> str:
    if figure.value is None:
        return "–"
    return f"{100 * figure.value:.1f} ({100 * figure.low:.0f}–{100 * figure.high:.0f})"


def number(figure: Any, digits: int = 1) -> str:
    return "–" if figure.value is None else f"{figure.value:.{digits}f}"


def ms(value: float | None) -> str:
    return "never" if value is None else f"{value:.0f}"
