"""Runs one study: its grid on worker processes, one stored row per trial, a table and a chart.

A study module declares ``STUDY``. Everything else (options, workers, resume, progress, storage,
JSON) is here. A folder holds the result: ``rows.jsonl``, ``table.md`` and ``chart.svg``.
"""

import argparse
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from drivers.errors import BadFile, UsageError
from grasp.cli.options import Pool, Settings, whole
from grasp.cli.output import progress
from grasp.cli.parser import Parser
from grasp.files import save_figure, write_whole
from scenarios.report.export import pyplot
from scenarios.rigs.workers import Workers, results
from scenarios.trial.result import versions

Task = TypeVar("Task", bound=msgspec.Struct)
Row = TypeVar("Row", bound=msgspec.Struct)

PAPER_OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
ROWS, TABLE, CHART = "rows.jsonl", "table.md", "chart.svg"


def _no_options(parser: Parser) -> None:
    """A study without options of its own."""


@dataclass(frozen=True)
class Study(Generic[Task, Row]):
    """A research question. Tasks and rows are frozen ``msgspec`` structs; ``trial`` is a function
    of a module, so that worker processes can import it."""

    summary: str  # one line for the help
    grid: Callable[[argparse.Namespace], Sequence[Task]]
    trial: Callable[[Task], Row]
    row: type[Row]
    table: Callable[[Sequence[Row]], str]
    chart: Callable[[Sequence[Row], Any], None] | None = None  # draws on a Matplotlib figure
    options: Callable[[Parser], None] = _no_options
    figure_size: tuple[float, float] = (9.0, 6.0)  # inches
    counted: str = "trials"  # what the progress bar counts


def add_trials(parser: Parser, seeds: int, objects: Sequence[str] = PAPER_OBJECTS) -> None:
    """Options of studies that run trials: objects, seeds, detector and settings."""
    parser.add_argument("--objects", nargs="+", default=objects, metavar="NAME")
    parser.add_argument("--seeds", type=whole(1, 100_000), default=seeds, metavar="N",
                        help="trials a combination (default: %(default)s)")  # fmt: skip
    parser.add_argument("--first-seed", type=whole(0, 10**9), default=0, metavar="N")
    parser.add_argument("--detector", metavar="NAME", help="default: the profile's")
    Settings.add_to(parser)


def seeds_of(args: argparse.Namespace) -> range:
    """The seeds that ``add_trials`` read."""
    return range(args.first_seed, args.first_seed + args.seeds)


def add_data(parser: Parser) -> None:
    """Option of studies that score detectors on data sets."""
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR",
        help="folders of `grasp dataset build` or `collect`",
    )  # fmt: skip


def main(name: str, study: Study[Any, Any], words: Sequence[str]) -> int:
    """Run a study from the command line; returns the exit code. Raises GraspError."""
    parser = Parser(prog=f"python -m studies {name}", description=study.summary)
    study.options(parser)
    parser.add_argument("--out", type=Path, default=Path("build/studies") / name, metavar="DIR",
                        help="folder of the result; its stored rows are not run again "
                        "(default: %(default)s)")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print rows as JSON lines")
    Pool.add_to(parser)
    args = parser.parse_args(words)
    rows = run(study, study.grid(args), args, args.out)
    text = study.table(rows)
    write_whole(args.out / TABLE, text.encode() + b"\n")
    print("\n".join(msgspec.json.encode(row).decode() for row in rows) if args.json else text)
    if study.chart is not None:
        draw(study, rows, args.out / CHART)
    return 0


def run(
    study: Study[Task, Row], tasks: Sequence[Task], args: argparse.Namespace, out: Path
) -> list[Row]:
    """All rows in the order of their tasks; stored rows are not run again.

    Raises BadFile for a damaged file of rows, and any exception of a trial.
    """
    if not tasks:
        raise UsageError("nothing to run", "name at least one object, seed and variant")
    out.mkdir(parents=True, exist_ok=True)
    path = out / ROWS
    stored = _stored(path, study.row)
    keys = [_key(task) for task in tasks]
    missing = [task for task, key in zip(tasks, keys, strict=True) if key not in stored]
    work = _Keyed(study.trial)
    with path.open("a", encoding="utf-8") as file, progress(study.counted) as show:
        if not stored:
            file.write(json.dumps({"versions": versions()}) + "\n")
        for done, (key, row) in enumerate(
            results(work, missing, Workers(args.jobs, args.cluster)), 1
        ):
            text = json.dumps({"task": key, "row": msgspec.to_builtins(row)})
            file.write(text + "\n")
            file.flush()
            stored[key] = msgspec.convert(json.loads(text)["row"], study.row)
            show(done, len(missing))
    return [stored[key] for key in keys]


class _Keyed(Generic[Task, Row]):
    """Wraps a trial to return its task's key with its row, because results come in any order."""

    def __init__(self, trial: Callable[[Task], Row]) -> None:
        self._trial = trial

    def __call__(self, task: Task) -> tuple[str, Row]:
        return _key(task), self._trial(task)


def _key(task: msgspec.Struct) -> str:
    return hashlib.blake2b(msgspec.json.encode(task), digest_size=8).hexdigest()


def _stored(path: Path, row: type[Row]) -> dict[str, Row]:
    """Rows by the key of their task, without a truncated last line."""
    if not path.exists():
        return {}
    rows: dict[str, Row] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if "task" in entry:
            try:
                rows[entry["task"]] = msgspec.convert(entry["row"], row)
            except msgspec.ValidationError as error:
                raise BadFile(path, f"holds rows of another study: {error}",
                              "choose another --out") from None  # fmt: skip
    return rows


def draw(study: Study[Any, Row], rows: Sequence[Row], out: Path) -> None:
    """Draw the chart of a study; needs the extra `exports`. Raises OSError."""
    if study.chart is None:
        return
    plt = pyplot()
    figure = plt.figure(figsize=study.figure_size, layout="constrained")
    study.chart(rows, figure)
    save_figure(figure, out, dpi=110)
    plt.close(figure)
    print(out)


def markdown(columns: Mapping[str, Sequence[object]]) -> str:
    """A Markdown table from columns of equal length; floats in three significant digits."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for cells in zip(*columns.values(), strict=True):
        lines.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
    return "\n".join(lines)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
