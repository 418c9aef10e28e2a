"""`grasp arm`: move the arm by one short slow step, or stop it. `grasp status`: print what the
gripper or the arm reports."""

import argparse
from typing import Any

from grasp import interruption
from grasp.cli import exits, gripper
from grasp.cli.lab import add_verb, lab_config, leave_to_move, say, tell, tell_slow, will
from grasp.cli.options import decimal
from grasp.cli.output import json_line
from grasp.cli.parser import group

HELP = "move a lab's arm by one slow step, stop it"
PLAN = "10 mm/s in a straight line"


def add_parser(verbs: Any) -> None:
    actions = group(verbs, "arm", HELP)
    text = f"one step of at most 5 mm in the base frame, at {PLAN}"
    step = add_verb(actions, "step", step_arm, text)
    for axis in "xyz":
        step.add_argument(
            f"--{axis}", type=decimal(-5, 5), default=0.0, metavar="MM",
            help="mm along that axis of the base" + ("; z is upwards" if axis == "z" else ""),
        )  # fmt: skip
    text = (
        "end the program that moves the arm, whichever client started it, and wait until the arm "
        "stands; needs no --confirm-motion, because a stop is never refused"
    )
    add_verb(actions, "stop", stop_arm, text)


def add_status(verbs: Any) -> None:
    text = "what a lab's gripper or arm reports, and what prevents a run; moves nothing"
    parser = add_verb(verbs, "status", status, text, moves=False)
    parser.option("device", "", choices=("gripper", "arm"))


def status(args: argparse.Namespace) -> int:
    return gripper.status(args) if args.device == "gripper" else arm_status(args)


def arm_status(args: argparse.Namespace) -> int:
    """Print modes, joints, tool position, and what prevents a run."""
    from drivers.ur.link.preflight import lines, look
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
        return tell(args, {"would": plan()})
    permit = leave_to_move(config, args, plan)
    will(plan())
    tell_slow(config)
    with interruption.held():
        at_m = step(config, permit, by_m, say)
    return tell(args, {"done": f"the arm stands at {_mm(at_m)}, after {way}"})


def stop_arm(args: argparse.Namespace) -> int:
    from scenarios.lab.arm import stop_arm as stop
    from scenarios.rigs.permission import arm_address

    if args.dry_run:
        where = arm_address(lab_config(args))
        return tell(args, {"would": f"end any program that runs on the arm at {where}"})
    stands = _mm(stop(lab_config(args)))
    return tell(args, {"done": f"the arm stands at {stands}, no program runs on it"})


def _mm(at_m: Any) -> str:
    return ", ".join(f"{axis} {m * 1e3:.1f}" for axis, m in zip("xyz", at_m, strict=True)) + " mm"
