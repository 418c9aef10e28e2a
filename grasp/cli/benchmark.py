"""`grasp benchmark`: score detectors with the fixed protocol."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
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


def benchmark(args: BenchmarkOptions) -> int:
    from scenarios.acquire.config import layout_file
    from scenarios.benchmark import score_file
    from scenarios.benchmark.protocol import check_digest, load_protocol
    from scenarios.benchmark.run import Benchmark, costs_of
    from scenarios.benchmark.streams import ensure_recordings
    from scenarios.campaign.config import load_config
    from scenarios.report.page import BEGINS
    from scenarios.report.score_page import score_svg

    names, pool = list(dict.fromkeys(args.detector or DETECTORS)), workers(args)
    layout = [path] if (path := layout_file(args.layout)) else []
    _check_settings(args)
    protocol = load_protocol()
    check_digest(protocol, args.split)
    real = _real(args.recording or ())
    configs = _configs(names, [*layout, *(args.config or ())], args.set)
    costs = costs_of(configs, real, pool)
    folder, chosen = _folder(args, args.split), {}
    if args.split == "test":
        chosen = _chosen(_folder(args, "validation"), configs, protocol.version)
    seeds = protocol.splits[args.split].digest
    source = score_file.Source(
        "benchmark", args.split, "slip", protocol.version, seeds, args.layout, args.quick
    )
    out = folder / score_file.BENCHMARK
    make_private_folder(folder)
    check_writable(out)
    check_writable(out.with_suffix(".html"), BEGINS)
    try:
        with locked(args.out / ".lock", PRIVATE_FILE, _busy), _shown(hidden=args.json) as report:
            kept, kept_costs = score_file.earlier_scores(out, source)
            recordings = ensure_recordings(
                protocol, args.split, args.out / _title("recordings", args.split, args.layout),
                pool, lambda done, of: report("recordings", done, of), args.layout, args.quick,
            )  # fmt: skip
            bench = Benchmark(protocol, args.split, recordings, real, pool, report, args.quick)
            ideal = load_config("can", "simulated", "energy", layout).for_lift()
            references = bench.references(ideal, folder / f"references-{seeds}.json")
            for config in [config for config in configs if not _is_in(kept, config, real, out)]:
                name = config.detector_label
                found = bench.detector(config, references, chosen.get(name))
                kept = {label: each for label, each in kept.items() if label != name}
                kept[name] = found
                score_file.write_scores(out, score_file.ScoreFile(
                    source=source, command=_command(args, names), references=references,
                    detectors=list(kept.values()),
                ))  # fmt: skip
                content = msgspec.json.encode(kept_costs | costs)
                write_whole(folder / score_file.COST, content, private=True)
    except KeyboardInterrupt:
        problem = f"interrupted; the detectors that were measured are in {out}"
        return exits.report("interrupted", problem, "the same command continues", args.json)
    from grasp.cli.recordings import write_page

    file, costs = score_file.read_scores(out)
    chart = out.with_suffix(".svg")
    write_whole(chart, score_svg(file).encode(), private=True)
    shown = map(str, (out, write_page(out), chart))
    text = "\n".join([table(file, costs), "", *remarks(file), "", *shown])
    return show(args, {**msgspec.to_builtins(file), "update_us": costs}, text)


def _is_in(kept: dict[str, Any], config: Any, real: dict[str, Any], out: Path) -> bool:
    """Whether the file has this detector with the same rule and recordings; says so."""
    found = kept.get(config.detector_label)
    if found is None or found.detector_hash != config.detector_hash() or {*found.real} != {*real}:
        return False
    exits.print_detail(f"{found.detector} is already in {out}; another --out measures it again")
    return True


def _title(first: str, *words: str) -> str:
    return "-".join([first, *(Path(word).stem for word in words if word)])


def _folder(args: BenchmarkOptions, split: str) -> Path:
    return args.out / _title(split, args.layout, "quick" if args.quick else "")


def _chosen(folder: Path, configs: Sequence[Any], version: int) -> dict[str, float]:
    """Best thresholds of the detectors in that folder. Raises BadFile and UsageError."""
    from scenarios.benchmark.score_file import BENCHMARK, read_scores

    path, found = folder / BENCHMARK, {}
    file = read_scores(path)[0] if path.exists() else None
    of = file.detectors if file and file.source.version == version else []
    known = {(each.detector, each.detector_hash): each.best for each in of}
    for config in configs:
        name = config.detector_label
        point = known.get((name, config.detector_hash()))
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
    from detector.recordings import read_all

    found = {path.name: list(read_all([path])) for path in paths}
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


def table(file: Any, costs: dict[str, float]) -> str:
    """The result of the page as text."""
    from scenarios.report.score_page import results_table

    made = results_table(file, costs)
    rows = [made.headings]
    rows += [[f"{cell.text} {cell.small}".strip() for cell in row] for row in made.rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def remarks(file: Any) -> list[str]:
    """The headline, whether halves agree, and why lifts of each detector were not right."""
    from scenarios.benchmark.ranking import halves
    from scenarios.report.score_page import by_number, sentence

    lines = [sentence(file), halves(file)]
    for each in file.detectors:
        wrong = [f"{n} {cause}" for n, cause in by_number(each.causes)[:3]]
        total = sum(each.causes.values())
        lines.append(f"{each.detector}: of {total} lifts {', '.join(wrong) or 'all right'}")
    return lines
