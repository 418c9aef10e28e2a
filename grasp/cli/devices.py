"""`grasp doctor`, `status`, `gripper`, `arm` and `release`: check a lab's devices, and move them by
hand, slowly."""

import argparse
from collections.abc import Callable
from typing import Any

from drivers.errors import UsageError, one_line
from grasp.cli import exits
from grasp.cli.lab import (
    FINGERS,
    Done,
    add_command,
    add_options,
    confirm,
    lab_config,
    perform,
    say,
    tell,
    tell_mode,
    tell_slow,
    tell_weak,
)
from grasp.cli.options import OBJECT_HELP, decimal, share, whole
from grasp.cli.output import print_json, show
from grasp.cli.parser import Parser

SLOW = "slowly, at its least force"
ALL = "open and close all fingers fully"
IDLE = "do nothing: it is active"
SET_BASIC = "open all fingers and set basic mode"
OPEN = (0, 0, 0)
ARM_SPEED = "10 mm/s in a straight line"
MARKS = {"ok": "ok  ", "warn": "warn", "fail": "FAIL"}


def add_doctor(parser: Parser) -> None:
    parser.runs(doctor, ". Reads only.", (
        "grasp doctor", "grasp doctor --rig hardware --config lab.toml",
        "grasp doctor 192.168.1.11 192.168.1.10"))  # fmt: skip
    parser.option("hosts HOST", "query only these, on the known ports, and print the settings for "
        "a --config file. HOST: gripper (Modbus, port 502) and arm (29999, 30002, 30004); "
        "HOST:PORT: a gripper there; tcp://HOST:PORT: an emulated fingertip board",
        nargs="*")  # fmt: skip
    parser.option("--timeout S", "each HOST answers a question within S seconds", decimal(0.05, 10),
        default=1.0)  # fmt: skip
    parser.option("--rig NAME", "also query the devices of this rig (one of config/rigs, or a "
        ".toml file)")  # fmt: skip
    parser.option("--object NAME", f"of the lift that is to start: {OBJECT_HELP} (default: "
        "%(default)s)", default="can")  # fmt: skip
    share(parser, "profile detector config set runs json")


def doctor(args: argparse.Namespace) -> int:
    if args.hosts:
        return _find(args)
    from scenarios.campaign.config import load_config, load_for_devices
    from scenarios.rigs.doctor import examine
    from scenarios.trial.execution import make_guard

    def load(rig: str, detector: str | None) -> Any:
        if detector is None:  # the run that is named
            named = args.object, rig, args.detector, args.config, args.set, args.profile
            return load_config(*named)
        return load_for_devices(args.object, rig, args.config, args.set, detector)

    def check_run(config: Any) -> None:
        make_guard(config)
        config.make_detector(3)

    own = (args.detector,) if args.detector else ()
    checks = examine(args.rig, args.config, load, check_run, own, args.runs)
    failed = [check for check in checks if check.status == "fail"]
    code = exits.DEVICE if failed else exits.SUCCESS
    if any(check.name in ("configuration", "disk") for check in failed):
        code = exits.USAGE  # as everywhere

    def text() -> str:
        width, lines = max(len(check.name) for check in checks), []
        for check in checks:
            lines.append(f"{MARKS[check.status]}  {check.name:<{width}}  {check.detail}")
            if check.remedy:
                lines.append(f"      {'':<{width}}  -> {check.remedy}")
        warned = sum(check.status == "warn" for check in checks)
        well = f"nothing prevents a run; {warned} to look at" if warned else "all well"
        if args.rig is None:
            well += " on this machine; no device was queried (--rig hardware queries a lab's)"
        end = f"{len(failed)} to fix; first: {failed[0].name}" if failed else well
        return "\n".join([*lines, end])

    found = [check._asdict() for check in checks]
    return show(args, {"healthy": not failed, "checks": found, "exit_code": code}, text, code)


def _find(args: argparse.Namespace) -> int:
    """Query the named addresses and the USB bus only."""
    from scenarios.lab.find import ask, settings_of, usb_boards

    found = []
    for each in (*ask(args.hosts, args.timeout), *usb_boards()):
        found.append(each)
        if not args.json:
            answer = "yes " if each.answered else "no  "
            print(one_line(f"{answer}  {each.device} at {each.where}: {each.said}"))
    code = exits.SUCCESS if any(each.answered for each in found) else exits.DEVICE
    if args.json:
        print_json({"asked": found, "exit_code": code})
    elif code == exits.SUCCESS:
        print(f"\nfor a file of your own, as lab.toml:\n\n{settings_of(found)}", end="")
    else:
        say("no device answers: check power, cables and addresses")
    return code


def add_status(parser: Parser) -> None:
    add_options(parser, status, moves=False, examples=(
        "grasp status gripper --config lab.toml", "grasp status arm --config lab.toml",
    )).option("device", "", choices=("gripper", "arm"))  # fmt: skip


def status(args: argparse.Namespace) -> int:
    config = lab_config(args)
    return _arm_status(args, config) if args.device == "arm" else _gripper_status(args, config)


def _gripper_status(args: argparse.Namespace, config: Any) -> int:
    """Print the registers, and what is strange in them."""
    from drivers.robotiq.protocol import FAULTS, TO_BASIC, other_than_basic
    from drivers.robotiq.words import doubts, lines
    from scenarios.rigs.device_checks import STRANGE, read_gripper
    from scenarios.rigs.permission import gripper_address

    where = gripper_address(config)
    if config.devices.gripper:
        raise UsageError(f"{where} is of another package", "look at it by that")
    before, now = read_gripper(config)
    strange, fault, registers = doubts(now, before), FAULTS[now.fault], lines(now)
    code = exits.DEVICE if strange or fault.code else exits.SUCCESS
    value = {"gripper": where, "registers": registers, "doubts": strange}
    tell(args, Done(_listed(f"gripper at {where}", registers), value, code))
    if args.json:
        return code
    for each in strange:
        say(f"{each} ({STRANGE})")
    if fault.code:
        say(f"{fault.text} ({fault.remedy})")
    if now.ready and (other := other_than_basic(now.mode)):
        say(f"the hand is {other} ({TO_BASIC})")
    return code


def _arm_status(args: argparse.Namespace, config: Any) -> int:
    """Print modes, joints, tool position, and what prevents a run."""
    from drivers.ur.link.look import lines, look
    from scenarios.rigs.device_checks import arm_checks
    from scenarios.rigs.permission import arm_address

    host, checks = arm_address(config), arm_checks(config)
    state = [] if config.devices.arm else lines(look(host, config.ur.step_timeout_s)[1])
    against = [check for check in checks if check.status == "fail"]
    code = exits.DEVICE if against else exits.SUCCESS
    value = {"arm": host, "state": state, "checks": [check._asdict() for check in checks]}
    tell(args, Done(_listed(f"arm at {host}", state), value, code))
    if not args.json:
        for check in against:
            say(f"{check.detail} ({check.remedy})")
    return code


def _listed(title: str, lines: list[str]) -> str:
    return "\n".join((title, *(f"  {line}" for line in lines)))


def add_gripper(parser: Parser) -> None:
    add_command(parser, "activate", "make the hand ready, which opens and closes it fully; one "
        "that is active in another mode is set to the basic one, for which it opens", activate,
    ).flag("--empty", "the hand is empty: do not ask whether it is")  # fmt: skip
    close = add_command(parser, "close", f"close fingers {SLOW}: B and C until anything is felt, "
        "then the thumb alone, under the force guard of a run, and refused where a run would be",
        close_fingers)  # fmt: skip
    _add_finger(close, "all")
    close.option("--to COUNTS", "no further than this (default: %(default)s, closed)",
        whole(0, 255), default=255)  # fmt: skip
    step = add_command(parser, "step", f"move a finger by a few millimetres {SLOW}", step_fingers,
        examples=("grasp gripper step --finger B --mm 2 --config lab.toml --confirm-motion",
        "grasp gripper step --finger B --mm 2 --open --config lab.toml --dry-run"))  # fmt: skip
    _add_finger(step, "A")
    step.option("--mm MM", "travel of the fingertip, at most 5", decimal(0.01, 5), default=2.0)
    step.flag("--open", "open by that instead of closing")


def _add_finger(parser: Parser, default: str) -> None:
    parser.option("--finger", "A is the thumb", choices=(*FINGERS, "all"), default=default)


def activate(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import activate_hand
    from scenarios.lab.ready import check_activation
    from scenarios.rigs.rig import to_open

    config = lab_config(args)

    def look() -> str:
        to_open(config)  # raises without a calibration
        seen = check_activation(config)
        return IDLE if seen is None else SET_BASIC if seen.well else ALL

    def ask() -> None:
        confirm("activation opens and closes the hand fully, with a force that nobody sets. Is it "
                "empty, and everybody's hands away?", "empty", args.empty)  # fmt: skip
        say(f"will {ALL}, if it is not active; {SET_BASIC}, if it is active in another")

    def act(permit: Any) -> Done:
        positions = activate_hand(config, permit, say)
        if positions is None:
            return Done("already active: nothing moved")
        return Done(f"active, fingers at {positions} counts")

    return perform(args, config, lambda: ALL, look, act, ask)


def close_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import fingers_of, targets_of

    fingers, config = fingers_of(args.finger), _hand_config(args)
    plan = f"close finger {fingers} to {args.to} counts"
    return _move(args, config, plan, lambda at: targets_of(at, fingers, args.to), fingers)


def step_fingers(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import fingers_of, step_counts, step_targets

    fingers, config = fingers_of(args.finger), _hand_config(args)
    counts = step_counts(config, args.mm * 1e-3) * (-1 if args.open else 1)
    plan, closing = f"move finger {fingers} by {counts:+} counts", "" if args.open else fingers
    return _move(args, config, plan, lambda at: step_targets(at, fingers, counts), closing)


def _move(
    args: argparse.Namespace, config: Any, plan: str, targets: Callable[[Any], Any], closing: str
) -> int:
    """Move fingers to their ``targets``. ``closing``: the fingers that close."""
    from scenarios.lab.hand import guard_of, open_hand
    from scenarios.lab.ready import active_hand, check_close
    from scenarios.rigs.rig import to_open

    order = ""  # in which fingers close, and how far B and C
    if closing:
        guard_of(config)  # raises what a run would, before anything moves
        if config.guard.cap_mode != "each_motor" and set("BC") & set(closing):
            thumb = ", then the thumb alone" if "A" in closing else ""
            order = f"; B and C no further than where anything is felt{thumb}"

    def look() -> str:
        seen = active_hand(config)
        to = targets(seen.state.positions)
        if closing:
            check_close(config, seen, to)
        tell_mode(config, opened=not closing)
        moving = config if closing else to_open(config)
        return _motion(moving, seen.state.positions, to) + order

    def act(permit: Any) -> Done:
        with open_hand(config, permit, closing=bool(closing)) as hand:
            to = targets(hand.state.positions)
            say(f"will {_motion(config, hand.state.positions, to)}{order}")
            moved = hand.close(to, say) if closing else hand.move(to, say)
        code = exits.DEVICE if moved.fault else exits.SUCCESS
        return Done(moved.in_words(), code=exits.SAFETY_STOP if moved.stopped_by else code)

    def warn() -> None:
        tell_mode(config)

    return perform(args, config, lambda: f"{plan} at {_speed(config)}{order}", look, act, warn)


def add_release(parser: Parser) -> None:
    add_options(parser, release, more=". Support the object first: it falls when the fingers open. "
        "Needs only the gripper. The state of arm and fingertips is printed and prevents nothing.",
        examples=("grasp release --rig cell.toml --confirm-motion",),
    ).flag("--activate", "activate an inactive hand, which opens and closes it fully; it must be "
        "empty, or its object supported")  # fmt: skip


def release(args: argparse.Namespace) -> int:
    from scenarios.lab.hand import open_hand
    from scenarios.lab.ready import hand_seen
    from scenarios.rigs.permission import gripper_address
    from scenarios.rigs.release import make_ready, not_active, other_devices
    from scenarios.rigs.rig import to_open

    config = _hand_config(args)

    def look() -> str:
        to_open(config)  # raises without a calibration
        seen = hand_seen(config)
        if not seen.state.active:
            if not args.activate:
                raise not_active(seen.state, "the same with --activate")
            return f"activate the hand: {ALL}, then open it"
        tell_mode(config, opened=True)
        return _motion(to_open(config), seen.state.positions, OPEN) + _spread(seen.mode)

    def act(permit: Any) -> Done:
        make_ready(config, permit, args.activate)
        with open_hand(config, permit, closing=False) as hand:
            will = _motion(to_open(config), hand.state.positions, OPEN)
            say(f"will {will}{_spread(hand.mode)}")
            moved = hand.open(say)
        which, others = f"gripper at {gripper_address(config)}", other_devices(config)
        text = _listed(f"released on rig {args.rig}: {which}, {moved.in_words()}",
                       [f"{device}: {state}" for device, state in others.items()])  # fmt: skip
        tell_mode(config, opened=True)
        value = {"rig": args.rig, "gripper": which, "positions_counts": moved.positions_counts}
        return Done(text, {**value, **others})

    return perform(
        args, config, lambda: f"open all fingers at {_speed(to_open(config))}", look, act
    )


def _hand_config(args: argparse.Namespace) -> Any:
    """What its calibration claims is told before anything else, of a dry run too."""
    config = lab_config(args)
    tell_weak(config.calibration)
    return config


def _motion(config: Any, at: Any, to: Any) -> str:
    return f"move fingers from {at} to {to} counts at {_speed(config)}"


def _speed(config: Any) -> str:
    """Speed and force. Raises ConfigError without a calibration."""
    from scenarios.rigs.rig import calibration

    known = calibration(config)
    return f"{known.least_speed_mps * 1e3:g} mm/s, at most {known.least_force_n:g} N a motor"


def _spread(mode: int) -> str:
    """What else a hand does that is commanded to open fully."""
    from drivers.robotiq.protocol import SCISSOR, SPREADS

    return SPREADS if mode == SCISSOR else ""


def add_arm(parser: Parser) -> None:
    step = add_command(parser, "step", f"one step of at most 5 mm in the base frame, at "
        f"{ARM_SPEED}", step_arm,
        examples=("grasp arm step --z 3 --config lab.toml --confirm-motion",))  # fmt: skip
    for axis in "xyz":
        more = "; z is upwards" if axis == "z" else ""
        step.option(f"--{axis} MM", f"mm along that axis of the base{more}", decimal(-5, 5),
            default=0.0)  # fmt: skip
    add_command(parser, "stop", "end the program that moves the arm, whichever client started it, "
        "and wait until the arm stands; needs no --confirm-motion, because a stop is never "
        "refused", stop_arm)  # fmt: skip


def step_arm(args: argparse.Namespace) -> int:
    from scenarios.lab import arm
    from scenarios.lab.ready import check_arm
    from scenarios.rigs.permission import arm_address

    config = lab_config(args)
    by_m = (args.x * 1e-3, args.y * 1e-3, args.z * 1e-3)
    arm.checked_step(by_m)
    arm.check_inside(config, by_m)
    way = f"x {args.x:+g}, y {args.y:+g}, z {args.z:+g} mm"

    def plan() -> str:
        return f"move the arm at {arm_address(config)} by {way} at {ARM_SPEED}"

    def look() -> str:
        would = plan()
        check_arm(config)
        return would

    def warn() -> None:
        say(f"will {plan()}")
        tell_slow(config)

    def act(permit: Any) -> Done:
        at_m = arm.step_arm(config, permit, by_m, say)
        return Done(f"the arm stands at {_position(at_m)}, after {way}")

    return perform(args, config, plan, look, act, warn)


def stop_arm(args: argparse.Namespace) -> int:
    from scenarios.lab.arm import stop_arm as stop
    from scenarios.rigs.permission import arm_address

    config = lab_config(args)
    if args.dry_run:
        would = f"end any program that runs on the arm at {arm_address(config)}"
        return tell(args, Done(would), "would")
    return tell(args, Done(f"the arm stands at {_position(stop(config))}, no program runs on it"))


def _position(at_m: Any) -> str:
    return ", ".join(f"{axis} {m * 1e3:.1f}" for axis, m in zip("xyz", at_m, strict=True)) + " mm"
