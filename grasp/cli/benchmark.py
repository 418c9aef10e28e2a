"""`grasp benchmark`: score detectors with the fixed protocol."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec

from detector.loading import DETECTORS, SECTIONS
from detector.recordings import Recording
from drivers.errors import UsageError
from grasp.cli import exits
from grasp.cli.commands import BenchmarkOptions
from grasp.cli.detector import check_named, warn_of_untuned_rule
from grasp.cli.options import check_writable, workers
from grasp.cli.output import progress, show
from grasp.files import PRIVATE_FILE, Holder, locked, make_private_folder, write_whole

CHANGEABLE = {*SECTIONS, "rule", "source"}  # sections that are not the protocol's
HEADINGS = (
    "detector", "right, %", "lifts, %", "taps, %", "delay p50 / p90, ms", "false alarms / min",
    "lasting slip, %", "AUC", "update, µs",
)  # fmt: skip


def benchmark(args: BenchmarkOptions) -> int:
    from scenarios.acquire.config import layout_file
    from scenarios.benchmark.protocol import check_digest, load_protocol
    from scenarios.benchmark.run import Benchmark, costs_of
    from scenarios.benchmark.score_file import (
        BENCHMARK,
        COST,
        ScoreFile,
        Source,
        scores_of_others,
        write_scores,
    )
    from scenarios.benchmark.streams import ensure_recordings
    from scenarios.campaign.config import load_config
    from scenarios.report.page import BEGINS

    names, pool = list(dict.fromkeys(args.detector or DETECTORS)), workers(args)
    layout = [path] if (path := layout_file(args.layout)) else []
    _check_settings(args)
    protocol = load_protocol()
    check_digest(protocol, args.split)
    real = _real(args.recording or ())
    configs = _configs(names, [*layout, *(args.config or ())], args.set)
    costs = costs_of(configs, real, pool)
    make_private_folder(args.out)
    made: list[Any] = []
    out = args.out / BENCHMARK
    check_writable(out)
    check_writable(out.with_suffix(".html"), BEGINS)
    seeds = protocol.splits[args.split].digest
    source = Source("benchmark", args.split, "slip", protocol.version, seeds, args.layout)
    try:
        with locked(args.out / ".lock", PRIVATE_FILE, _busy), _shown(hidden=args.json) as report:
            others, kept_costs = scores_of_others(out, source, list(costs))
            costs = kept_costs | costs
            title = filter(None, ("recordings", args.split, Path(args.layout).stem))
            folder = args.out / "-".join(title)
            recordings = ensure_recordings(
                protocol, args.split, folder, pool,
                lambda done, of: report("recordings", done, of), args.layout,
            )  # fmt: skip
            bench = Benchmark(protocol, args.split, recordings, real, pool, report)
            ideal = load_config("can", "simulated", "energy", layout).for_lift()
            oracle = bench.kept_oracle(ideal, folder / f"oracle-{seeds}.json")
            for config in configs:
                made.append(bench.detector(config))
                command, every = _command(args, names), [*others, *made]
                file = ScoreFile(source=source, command=command, detectors=every, oracle=oracle)
                write_scores(out, file)
                write_whole(args.out / COST, msgspec.json.encode(costs), private=True)
    except KeyboardInterrupt:
        kept = "interrupted before any detector was measured", "run it again: recordings are kept"
        if made:
            kept = (f"interrupted; {len(made)} of {len(names)} detectors are in {out}",
                    "run the others with the same --out")  # fmt: skip
        return exits.report("interrupted", *kept, args.json)
    from grasp.cli.recordings import write_page

    pages = [write_page(out), *_chart(file, costs, out)]
    text = "\n".join([table(file, costs), "", *failures(file), "", *map(str, (out, *pages))])
    return show(args, {**msgspec.to_builtins(file), "cost": costs}, text)


def _busy(holder: Holder | None) -> UsageError:
    who = "" if holder is None else f" (process {holder.pid}, since {holder.since})"
    return UsageError(f"another benchmark writes to this folder{who}", "wait, or give --out")


def _check_settings(args: BenchmarkOptions) -> None:
    """Raise UsageError for settings of the user that the protocol fixes."""
    from scenarios.rigs.calibration import user_layers

    for layer in user_layers(args.config, args.set):
        if fixed := ", ".join(sorted(layer.table.keys() - CHANGEABLE)):
            raise UsageError(
                f"{layer.source} sets {fixed}, which the protocol of the benchmark fixes",
                "leave it out (also of $GRASP_CONFIG): only detector and rule can be set",
            )


def _real(paths: Sequence[Path]) -> dict[str, list[Recording]]:
    """Labelled recordings by the name of their file. Raises BadFile and UsageError."""
    from scenarios.benchmark.data_sets import read_labelled

    found = {path.name: read_labelled(path) for path in paths}
    if len(found) < len(paths):
        raise UsageError("two recordings have the same file name", "rename one of them")
    return found


def _configs(names: Sequence[str], files: Sequence[Path], assignments: Sequence[str]) -> list[Any]:
    """Settings of each detector. Raises as ``check_named``."""
    from scenarios.campaign.config import load_config
    from scenarios.trial.layers import trial_layers

    check_named(names, files, assignments)
    configs = []
    for name in names:
        given = ("can", "simulated", name, files, assignments)
        config = load_config(*given).for_lift()
        warn_of_untuned_rule(config, trial_layers(*given))
        configs.append(config)
    return configs


def _command(args: BenchmarkOptions, names: list[str]) -> str:
    options: list[tuple[str, str]] = [("--split", args.split)]
    options += [("--layout", args.layout)] if args.layout else []
    options += [("--config", str(path)) for path in args.config or ()]
    options += [("--set", text) for text in args.set]
    real = ["--recording", *map(str, args.recording)] if args.recording else []
    return shlex.join(["grasp", "benchmark", *names, *(w for o in options for w in o), *real])


@contextmanager
def _shown(hidden: bool) -> Iterator[Any]:
    """Yields a function of title, done and total that shows each part with its own progress."""
    with ExitStack() as stack:
        bars: dict[str, Any] = {}

        def report(title: str, done: int, of: int) -> None:
            if title not in bars:
                stack.close()  # the part before has ended
                bars[title] = stack.enter_context(progress(title, hidden))
            bars[title](done, of, title)

        yield report


def _chart(file: Any, costs: dict[str, Any], out: Path) -> list[Path]:
    """Draw the chart if the extra `exports` is installed; returns its path."""
    if find_spec("matplotlib") is None:
        exits.print_detail("no chart: it needs the extra `exports` (make install-exports)")
        return []
    from scenarios.report.score_chart import draw_scores

    path = out.with_suffix(".svg")
    draw_scores(file, costs, path)
    return [path]


def failures(file: Any) -> list[str]:
    """Of each detector, the commonest reasons why lifts were not right."""
    from scenarios.report.score_page import by_number

    lines = []
    for each in file.detectors:
        causes = each.causes["all"]
        wrong = [f"{n} {cause}" for n, cause in by_number(causes)[:3]]
        lines.append(f"{each.detector}: of {sum(causes.values())} lifts "
                     f"{', '.join(wrong) or 'all right'}")  # fmt: skip
    return lines


def table(file: Any, costs: dict[str, Any]) -> str:
    """One row a detector, then the oracle; a column for each real recording."""
    from detector.scores.figures import Figure
    from scenarios.report.score_page import between, delays, number, percent

    real = list(dict.fromkeys(name for each in file.detectors for name in each.real))
    headings = (*HEADINGS, *(f"AUC, {name}" for name in real))
    rows: list[tuple[str, ...]] = [headings]
    for each in file.detectors:
        p, s = each.point, each.figures
        rows.append((
            each.detector, f"{percent(p.right)} {between(p.right)}", percent(p.lifts_right),
            percent(p.taps_right), delays(p), number(s["false_per_min"]),
            percent(s["sustained"]), number(s["auc"], 3),
            f"{costs[each.detector].update_us:.0f}" if each.detector in costs else "",
            *(number(each.real.get(name, Figure(None)), 3) for name in real),
        ))  # fmt: skip
    p = file.oracle[0]
    shares = map(percent, (p.right, p.lifts_right, p.taps_right))
    rows.append(("oracle", *shares, delays(p), "0.0", "100.0", "1.000", "", *("" for _ in real)))
    widths = [max(len(row[i]) for row in rows) for i in range(len(headings))]
    return "\n".join(
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    )
