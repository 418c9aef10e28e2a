"""`grasp arm`: the arm alone, looked at, moved by one short slow step, or stopped."""

import argparse
from typing import Any

from grasp import interruption
from grasp.cli import exits
from grasp.cli.lab import add_lab, lab_config, leave_to_move, say, tell_slow, will
from grasp.cli.options import decimal
from grasp.cli.output import json_line

HELP = "look at a lab's arm, move it by one slow step, stop it"
PLAN = "10 mm/s in a straight line"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("arm", help=HELP, description=HELP)
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    text = "modes, joints, tool, and what stands against a run; moves nothing"
    look = actions.add_parser("status", help=text, description=text)
    add_lab(look, moves=False)
    look.set_defaults(handler=status)
    text = f"one step of at most 5 mm in the base frame, at {PLAN}"
    step = actions.add_parser("step", help=text, description=text)
    for axis in "xyz":
        step.add_argument(
            f"--{axis}", type=decimal(-5, 5), default=0.0, metavar="MM",
            help="mm along that axis of the base" + ("; z is upwards" if axis == "z" else ""),
        )  # fmt: skip
    add_lab(step, moves=True)
    step.set_defaults(handler=step_arm)
    text = "end the program that moves the arm, whoever runs it, and look until the arm stands"
    stop = actions.add_parser("stop", help=text, description=text)
    add_lab(stop, moves=False)
    stop.add_argument(
        "--confirm-motion", action="store_true", help="not needed: what stops is never refused"
    )
    stop.add_argument(
        "--dry-run", action="store_true", help="say what would be ended, and end nothing"
    )
    stop.set_defaults(handler=stop_arm)


def status(args: argparse.Namespace) -> int:
    from drivers.ur.link.look import lines, look
    from scenarios.rigs.device_checks import arm_checks
    from scenarios.rigs.permission import arm_address

    config = lab_config(args)
    host = arm_address(config)
    checks = arm_checks(config)
    told = [] if config.devices.arm else lines(look(host, config.ur.step_timeout_s)[1])
    against = [check for check in checks if check.status == "fail"]
    code = exits.DEVICE if against else exits.SUCCESS
    if args.json:
        said = {"arm": host, "state": told, "checks": [c._asdict() for c in checks]}
        print(json_line({**said, "exit_code": code}))
        return code
    print("\n".join((f"arm at {host}", *(f"  {line}" for line in told))))
    for check in against:
        exits.report_line(f"{check.detail} ({check.remedy})")
    return code


def step_arm(args: argparse.Namespace) -> int:
    from scenarios.lab.arm import check_inside, checked_step
    from scenarios.lab.arm import step_arm as step
    from scenarios.rigs.permission import arm_address

    config = lab_config(args)
    by_m = (args.x * 1e-3, args.y * 1e-3, args.z * 1e-3)
    checked_step(by_m)
    check_inside(config, by_m)
    way = f"x {args.x:+g}, y {args.y:+g}, z {args.z:+g} mm"

    def plan() -> str:
        return f"move the arm at {arm_address(config)} by {way} at {PLAN}"

    if args.dry_run:
        from scenarios.lab.ready import check_arm

        check_arm(config)
        return _tell(args, plan(), "would")
    permit = leave_to_move(config, args, plan)
    will(plan())
    tell_slow(config)
    with interruption.held():
        at_m = step(config, permit, by_m, say)
    return _tell(args, f"the arm stands at {_mm(at_m)}, after {way}")


def stop_arm(args: argparse.Namespace) -> int:
    from scenarios.lab.arm import stop_arm as stop
    from scenarios.rigs.permission import arm_address

    if args.dry_run:
        where = arm_address(lab_config(args))
        return _tell(args, f"end the program on the arm at {where}, whoever runs it", "would")
    return _tell(args, f"the arm stands at {_mm(stop(lab_config(args)))}, no program runs on it")


def _mm(at_m: Any) -> str:
    return ", ".join(f"{axis} {m * 1e3:.1f}" for axis, m in zip("xyz", at_m, strict=True)) + " mm"


def _tell(args: argparse.Namespace, told: str, key: str = "done") -> int:
    """``key`` of a dry run: would."""
    if args.json:
        print(json_line({key: told, "exit_code": exits.SUCCESS}))
    else:
        print(f"would {told}" if key == "would" else told)
    return exits.SUCCESS
