"""`grasp chart answers`: what the hand and the arm may answer to slip, and what that is worth."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from grasp.cli import exits
from grasp.cli.options import (
    OBJECT_HELP,
    add_settings,
    add_workers,
    need,
    progress,
    whole,
    workers,
)
from grasp.cli.pictures import add_picture, write_numbers

if TYPE_CHECKING:
    from scenarios.studies.answers.study import Policy
    from scenarios.studies.answers.summary import Answers, Cell

OBJECTS = ("ball", "box", "can", "cardboard", "foam", "football")
EASY, HARD, ALARMS = "easy", "hard", "alarms"


def add_parser(charts: Any) -> None:
    parser = charts.add_parser(
        "answers",
        help="force against slip, and success against severity, by what answers slip",
        description="Lifts every object under every answer to slip (controller.answer), as "
        "configured and in harder scenes, and holds it in the air.",
    )
    parser.add_argument(
        "--objects", nargs="+", default=OBJECTS, metavar="NAME",
        help=f"{OBJECT_HELP} (default: the paper's six)",
    )  # fmt: skip
    parser.add_argument(
        "--scenes",
        choices=(EASY, HARD, ALARMS, "all"),
        default="all",
        help="as configured, the harder ones, the first with false alarms beside it, or all "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--policies", nargs="+", metavar="NAME",
        help="of the answers only these, such as 'stop_and_step, margin 2', quoted (default: all)",
    )  # fmt: skip
    parser.add_argument("--detector", metavar="NAME", help="default: the profile's")
    parser.add_argument(
        "--rig", choices=("simulated", "emulated"), default="simulated",
        help="emulated: over real wires, in wall time, without the wet scenes",
    )  # fmt: skip
    parser.add_argument(
        "--seeds", type=whole(1, 100_000), default=20, metavar="N",
        help="of each object (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--first-seed", type=whole(0, 1_000_000_000), default=0, metavar="N",
        help="of these (default: %(default)s)",
    )  # fmt: skip
    add_settings(parser)
    add_workers(parser)
    add_picture(parser, "answers", "all lifts go")
    parser.set_defaults(handler=draw)


def draw(args: argparse.Namespace) -> int:

    from drivers.errors import UsageError
    from grasp.settings import meant
    from scenarios.campaign.config import load_config
    from scenarios.studies.answers.figure import draw_answers
    from scenarios.studies.answers.study import BASE, POLICIES, SCENES, lifts
    from scenarios.studies.answers.summary import summarize

    need("charts", "matplotlib")
    known = {p.name: p for p in POLICIES}
    if unknown := set(args.policies or ()) - known.keys():
        every = ", ".join(repr(name) for name in known)
        name = min(unknown)
        raise UsageError(f"no policy {name!r}{meant(name, list(known))}", f"one of: {every}")
    policies = [p for name, p in known.items() if name in (args.policies or known)]
    _refuse_overwritten(args.set, policies)
    alarms = [s for s in SCENES if s.alarms]
    hard = [s for s in SCENES[1:] if not s.alarms]
    asked = {EASY: (BASE,), HARD: hard, ALARMS: (BASE, *alarms), "all": SCENES}[args.scenes]
    scenes = [s for s in asked if args.rig == "simulated" or s.wet == 1.0]
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    total = len(seeds) * len(args.objects) * len(policies) * len(scenes)
    found = []
    with progress("lifts") as show:
        for each in lifts(
            args.objects, seeds, policies, scenes, args.detector, workers(args), args.rig,
            args.config, args.set,
        ):  # fmt: skip
            found.append(each)
            show(len(found), total, each.scene)
    detector = load_config(args.objects[0], "simulated", args.detector).detector_name
    answers = summarize(detector, args.rig, seeds, args.objects, found)
    write_numbers(args.out, answers)
    draw_answers(answers, args.out)
    _print(answers)
    print(args.out)
    return exits.SUCCESS


def _refuse_overwritten(assignments: list[str], policies: "Sequence[Policy]") -> None:
    """What a policy sets is not for `--set`: it would be ignored. Raises UsageError."""
    from drivers.errors import UsageError

    keys = {text.partition("=")[0].strip() for text in assignments}
    for policy in policies:
        for word in policy.words:
            if (key := word.partition("=")[0]) in keys:
                raise UsageError(
                    f"--set: {key} is set by the policy {policy.name!r}",
                    "leave it out, and choose by --policies",
                )


def _print(answers: "Answers") -> None:
    print(
        f"{'scene':42} {'answer':24} {'held':>9} {'lost':>4} {'of feasible':>11} "
        f"{'slip, mm p50 p90 p99':>20} {'in the air p50 p90 p99':>22} "
        f"{'force/least p50 p90 p99':>23} "
        f"{'peak N':>7} {'closings':>8} {'paused s':>9} {'lift s':>7} {'false alarms':>12}"
    )
    for cell in answers.cells:
        print(_row(cell))


def _row(c: "Cell") -> str:
    slip, air, force = (
        "-" if q is None else " ".join(f"{v:z.{digits}f}" for v in (q.p50, q.p90, q.p99))
        for q, digits in ((c.slip_mm, 1), (c.air_slip_mm, 1), (c.over_least, 2))
    )
    return (
        f"{c.scene:42} {c.policy:24} {c.held:>5}/{c.trials:<3} {c.lost:>4} "
        f"{c.feasible_held:>7}/{c.feasible:<3} {slip:>20} {air:>22} {force:>23} {c.peak_n:7.1f} "
        f"{c.closings:8.1f} {c.paused_s:9.2f} {c.seconds:7.2f} {c.alarms:12.2f}"
    )
