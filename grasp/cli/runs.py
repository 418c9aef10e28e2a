"""`grasp runs`: list recorded runs, or summarise a campaign."""

import argparse
import json
from pathlib import Path
from typing import Any

from drivers.errors import BadFile, one_line
from grasp.cli import exits
from grasp.cli.campaign import print_summary
from grasp.cli.options import add_runs, no_settings
from grasp.cli.output import json_line
from grasp.cli.parser import verb

HELP = "list recorded runs with their verdicts; summarise a campaign as the paper's Table IV"


def add_parser(verbs: Any) -> None:
    parser = verb(verbs, "runs", run, HELP)
    parser.option("file FILE", "SQLite file of a campaign: rates with intervals, latencies, slip "
        "distances", Path, nargs="?")  # fmt: skip
    add_runs(parser)
    parser.flag("--json", "one JSON array of results, or the summary's object")
    no_settings(parser)


def run(args: argparse.Namespace) -> int:
    if args.file is not None:
        print_summary(args.file, args.json)
        return exits.SUCCESS
    results, lines, code = [], [], exits.SUCCESS
    for path in sorted(args.runs.glob("*/result.json")):
        try:
            result = _read(path)
        except BadFile as error:  # the others are listed all the same
            code = exits.report(error.kind, error.message, error.remedy, as_json=False)
            continue
        results.append(result)
        lines.append(_line(path.parent.name, result))
    if args.json:
        print(json_line(results))
        return code
    for line in lines:
        print(line)
    if not lines:
        print(f"no runs in {one_line(args.runs)}")
    return code


def _read(path: Path) -> dict[str, Any]:
    """A result that can be listed; raises BadFile for what is none."""
    try:
        result: dict[str, Any] = json.loads(path.read_bytes())
        _line("", result)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        remedy = "delete its folder, or move it elsewhere"
        raise BadFile(path, "is no result of a run, or damaged", remedy) from None
    return result


def _line(name: str, result: dict[str, Any]) -> str:
    seed, told = f"seed {result['seed']:<6}", _told(result)
    return one_line(f"{name:<36}  {result['outcome']:<18}  {seed}  {told}".rstrip())


def _told(result: dict[str, Any]) -> str:
    """How far something slipped, or what an acquisition has gathered."""
    if "samples" in result:
        return (
            f"{result['samples']} samples, {result['slip']} slip, direction {result['direction']}"
        )
    slip = result.get("slip_distance_m", result.get("displacement_m"))
    return "" if slip is None else f"slip {slip * 1e3:5.1f} mm"
