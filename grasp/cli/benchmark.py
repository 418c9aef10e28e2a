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
    "detector", "score", "behind the first", "raw, %", "lifts, %", "taps, %",
    "false alarms / min", "delay p50 / p90, ms", "AUC", "update, µs",
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
        earlier_scores,
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
    chosen = _chosen(args, configs) if args.split == "test" else {}
    seeds = protocol.splits[args.split].digest
    source = Source(
        "benchmark", args.split, "slip", protocol.version, seeds, args.layout, args.quick
    )
    out = _folder(args, args.split) / BENCHMARK
    make_private_folder(out.parent)
    check_writable(out)
    check_writable(out.with_suffix(".html"), BEGINS)
    here = 0
    try:
        with locked(args.out / ".lock", PRIVATE_FILE, _busy), _shown(hidden=args.json) as report:
            measured, kept_costs = earlier_scores(out, source)
            costs = kept_costs | costs
            recordings = ensure_recordings(
                protocol, args.split, args.out / _title("recordings", args.split, args.layout),
                pool, lambda done, of: report("recordings", done, of), args.layout, args.quick,
            )  # fmt: skip
            bench = Benchmark(protocol, args.split, recordings, real, pool, report, args.quick)
            ideal = load_config("can", "simulated", "energy", layout).for_lift()
            references = bench.references(ideal, out.with_name(f"references-{seeds}.json"))
            for config in configs:
                name = config.detector_label
                kept, again = measured.get(name), "(another --out measures it again)"
                same = kept and kept.detector_hash == config.detector_hash()
                if kept and same and kept.real.keys() == real.keys():
                    exits.print_detail(f"{name}: already in {out} {again}")
                else:
                    measured.pop(name, None)
                    measured[name] = bench.detector(config, references, chosen.get(name))
                here += 1
                file = ScoreFile(
                    source=source, command=_command(args, names), references=references,
                    detectors=list(measured.values()),
                )  # fmt: skip
                write_scores(out, file)
                write_whole(out.with_name(COST), msgspec.json.encode(costs), private=True)
    except KeyboardInterrupt:
        problem = f"interrupted; {here} of {len(names)} detectors are in {out}"
        return exits.report("interrupted", problem, "the same command continues", args.json)
    from grasp.cli.recordings import write_page

    pages = [write_page(out), *_chart(file, costs, out)]
    text = "\n".join([table(file, costs), "", *failures(file), "", *map(str, (out, *pages))])
    return show(args, {**msgspec.to_builtins(file), "cost": costs}, text)


def _title(first: str, *words: str) -> str:
    return "-".join([first, *(Path(word).stem for word in words if word)])


def _folder(args: BenchmarkOptions, split: str) -> Path:
    return args.out / _title(split, args.layout, "quick" if args.quick else "")


def _chosen(args: BenchmarkOptions, configs: Sequence[Any]) -> dict[str, float]:
    """Best thresholds of the detectors, from the split `validation`. Raises UsageError and
    BadFile."""
    from scenarios.benchmark.protocol import load_protocol
    from scenarios.benchmark.score_file import BENCHMARK, read_scores

    path = _folder(args, "validation") / BENCHMARK
    known = read_scores(path)[0] if path.exists() else None
    version = known.source.version if known else None
    of = known.detectors if known and version == load_protocol().version else []
    best = {(each.detector, each.detector_hash): each.best for each in of}
    found = {}
    for config in configs:
        name = config.detector_label
        point = best.get((name, config.detector_hash()))
        if point is None:
            raise UsageError(
                f"{name} with this rule has no best threshold in {path}",
                "the split `test` does not choose: first run the same with --split validation",
            )
        found[name] = point.threshold
    return found


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
    more = ["--quick"] * args.quick
    more += ["--recording", *map(str, args.recording)] if args.recording else []
    return shlex.join(["grasp", "benchmark", *names, *(w for o in options for w in o), *more])


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
    """What the table leaves out: the headline, whether halves agree, and of each detector the
    commonest reasons why lifts were not right."""
    from scenarios.benchmark.ranking import halves
    from scenarios.report.score_page import by_number, sentence

    lines = [sentence(file), halves(file)]
    for each in file.detectors:
        causes = each.causes["all"]
        wrong = [f"{n} {cause}" for n, cause in by_number(causes)[:3]]
        lines.append(f"{each.detector}: of {sum(causes.values())} lifts "
                     f"{', '.join(wrong) or 'all right'}")  # fmt: skip
    return lines


def table(file: Any, costs: dict[str, Any]) -> str:
    """The rows by score, then oracle and silence; a column for each real recording."""
    from detector.scores.figures import Figure
    from scenarios.benchmark.ranking import ranked
    from scenarios.report.score_page import between, delays, number, percent

    def row(name: str, p: Any, behind: str = "", update: str = "", *areas: str) -> list[str]:
        return [name, f"{percent(p.score)} {between(p.score)}", behind, percent(p.raw),
                percent(p.lifts), percent(p.taps), number(p.false_per_min, 2), delays(p),
                *(areas or [""] * (1 + len(real))), update]  # fmt: skip

    real = list(dict.fromkeys(name for each in file.detectors for name in each.real))
    rows = [[*HEADINGS[:-1], *(f"AUC, {name}" for name in real), HEADINGS[-1]]]
    for each in ranked(file):
        of, f = each.of, each.behind
        areas = (of.figures["auc"], *(of.real.get(name, Figure(None)) for name in real))
        update = f"{costs[of.detector].update_us:.0f}" if of.detector in costs else ""
        behind = f"{percent(f)} {between(f, digits=1)}" if f.value is not None else ""
        rows.append(row(each.name, each.point, behind, update, *(number(a, 3) for a in areas)))
    rows.append(row("oracle", file.references.oracle[0]))
    rows.append(row("never registers", file.references.silence))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    )
