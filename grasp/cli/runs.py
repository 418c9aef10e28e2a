"""`grasp runs`: what has been recorded so far."""

import argparse
import json
from typing import Any

from grasp.cli import exits
from grasp.cli.options import add_runs

HELP = "list recorded runs with their verdicts"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("runs", help=HELP, description=HELP)
    add_runs(parser)
    parser.add_argument("--json", action="store_true", help="one JSON array of results")
    parser.set_defaults(handler=run)


def run(args: argparse.Namespace) -> int:
    results = [
        (path.parent.name, json.loads(path.read_text()))
        for path in sorted(args.runs.glob("*/result.json"))
    ]
    if args.json:
        print(json.dumps([result for _, result in results]))
        return exits.SUCCESS
    for name, result in results:
        seed, told = f"seed {result['seed']:<6}", _told(result)
        print(f"{name:<36}  {result['outcome']:<18}  {seed}  {told}".rstrip())
    if not results:
        print(f"no runs in {args.runs}")
    return exits.SUCCESS


def _told(result: dict[str, Any]) -> str:
    """How far something slipped, or what an acquisition has gathered."""
    if "samples" in result:
        return (
            f"{result['samples']} samples, {result['slip']} slip, direction {result['direction']}"
        )
    slip = result.get("slip_distance_m", result.get("displacement_m"))
    return "" if slip is None else f"slip {slip * 1e3:5.1f} mm"
