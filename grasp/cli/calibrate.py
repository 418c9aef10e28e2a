"""`grasp calibrate`: what a count of the fingertips, a byte of the hand and a still hold are worth,
measured on a lab's own devices and written into files for `--config` and `gripper.calibration`."""

import argparse
import math
import sys
import tomllib
from typing import Any

from grasp import interruption
from grasp.cli import exits, fingertip
from grasp.cli.lab import (
    FINGERS,
    add_verb,
    confirm,
    lab_config,
    leave_to_move,
    new_file,
    tell,
    tell_mode,
    tell_weak,
    will,
)
from grasp.cli.options import decimal, whole
from grasp.cli.output import json_line
from grasp.cli.parser import Parser, group
from grasp.cli.places import file_to_write
from grasp.files import write_whole

HELP = "calibrate counts and force bytes on a scale; fit the simulated fingertip"
SCALE = "One finger presses on a scale, harder than the limit of a run allows."
OVER_A_SCALE = "one fingertip over a scale, and no object in the hand: do not ask"
MANUAL_LEAST_N, MANUAL_MOST_N = 15.0, 60.0
LONG_S, SHORTEST_S = 180.0, 30.0
CLOSED = (255, 255, 255)


def add_parser(verbs: Any) -> None:
    kinds = group(verbs, "calibrate", HELP, "WHAT")
    force = _kind(
        kinds, "force", calibrate_force,
        "counts of a fingertip to newtons: put weights on it or press it on a scale, and type what "
        "they say; with --press the finger presses by itself, a count at a time",
    )  # fmt: skip
    _add_scale(force, required=False)
    force.flag("--press", "the finger presses on the scale")
    hand = _kind(
        kinds, "hand", calibrate_hand,
        "force bytes to newtons (an upper bound) and counts to millimetres: the finger presses on "
        "a scale, and you type what it says",
    )  # fmt: skip
    _add_scale(hand, required=True)
    hand.option("--presses N", "presses per byte; a byte that presses with less than the manual "
        "states (15 N for byte 0) gets at least ten", whole(4, 100), default=10)  # fmt: skip
    hand.option("--bytes BYTE", "force bytes to press with; 0 is always included (default: "
        "0)", whole(0, 255), nargs="+", default=[0])  # fmt: skip
    hand.option("--places COUNTS", "positions at which you read a ruler, five or more (default: "
        "none; travel is not measured)", whole(0, 255), nargs="+", default=[])  # fmt: skip
    noise = _kind(
        kinds, "noise", calibrate_noise,
        "the rule on slip that your fingertips allow, without labels: the hand holds something "
        "still for three minutes and lets it go; never below the rule that is there",
    )  # fmt: skip
    noise.option("--detector NAME", "", default="tcn")
    noise.option("--budget N", "false events a minute of a hand", decimal(0.001, 60), default=0.5)
    noise.option(
        "--seconds N", "duration of the hold", decimal(SHORTEST_S + 5, 3600), default=LONG_S
    )
    fingertip.add_parser(kinds)


def _kind(kinds: Any, name: str, handler: Any, text: str) -> Parser:
    parser = add_verb(kinds, name, handler, text)
    parser.option("--out FILE", "new .toml file to write, with date, spread and source",
        file_to_write, required=True)  # fmt: skip
    parser.option("--note TEXT", "text to add to the source in the file", default="")
    return parser


def _add_scale(parser: Parser, required: bool) -> None:
    parser.option("--finger", "", choices=FINGERS, default="A")
    parser.option("--up-to N",
        "largest force, N; it may exceed the limit of a run, up to the manual's "
        f"{MANUAL_MOST_N:g}; by the manual byte 0 may press with {MANUAL_LEAST_N:g}"
        + ("" if required else " (default: the limit of a run, guard.force_limit_n)"),
        decimal(0.1, MANUAL_MOST_N), required=required)  # fmt: skip
    parser.flag("--scale", OVER_A_SCALE)


def calibrate_force(args: argparse.Namespace) -> int:
    from scenarios.lab.ready import check_hearing, check_pressing
    from scenarios.lab.scale import check_force
    from scenarios.lab.sessions import calibrate_force as by_weights
    from scenarios.lab.sessions import press_force

    config = lab_config(args)
    new_file(args.out)
    up_to_n = config.guard.force_limit_n if args.up_to is None else args.up_to
    if args.press:
        asked = "--up-to" if args.up_to is not None else "the limit of a run, without --up-to,"
        check_force(up_to_n, called=asked)
    pressing = f"finger {args.finger} by single counts, up to {up_to_n:g} N on the scale"
    if args.dry_run:
        if args.press:
            check_pressing(config, hearing=True)
            tell_mode(config)
        else:
            check_hearing(config)
        return tell(args, {"would": f"move {pressing if args.press else 'nothing'}"})
    if not args.press:
        operator = _operator()
        with interruption.held():
            text = by_weights(config, args.finger, up_to_n, operator, _tell, args.note)
        return _written(args, text)
    permit = leave_to_move(config, args, lambda: f"move {pressing}")
    tell_mode(config)
    _over_a_scale(args)
    operator = _operator()
    will(f"move {pressing}")
    with interruption.held():
        text = press_force(config, permit, args.finger, up_to_n, operator, _tell, args.note)
    return _written(args, text)


def calibrate_hand(args: argparse.Namespace) -> int:
    from scenarios.lab.fit import check_places
    from scenarios.lab.ready import check_pressing
    from scenarios.lab.scale import check_force
    from scenarios.lab.sessions import calibrate_hand as press

    config = lab_config(args)
    new_file(args.out)
    check_force(args.up_to, {0, *args.bytes})
    if args.places:
        check_places(args.places)
    bytes_ = ", ".join(map(str, sorted({0, *args.bytes})))
    way = f", then to {args.places} counts in free air" if args.places else ""
    pressing = (
        f"finger {args.finger}, {args.presses} times with each of the force bytes {bytes_}, onto "
        f"the scale, with {args.up_to:g} N at most by the manual{way}"
    )
    if args.dry_run:
        check_pressing(config, hearing=False)
        tell_mode(config)
        return tell(args, {"would": f"move {pressing}"})
    permit = leave_to_move(config, args, lambda: f"move {pressing}")
    tell_mode(config)
    _over_a_scale(args)
    operator = _operator()
    will(f"move {pressing}")
    with interruption.held():
        text = press(
            config, permit, args.finger, args.bytes, args.presses, args.up_to, args.places,
            operator, _tell, args.note,
        )  # fmt: skip
    code = _written(args, text)
    _tell(_to_use(args, text, config.guard.force_limit_n))
    return code


def _to_use(args: argparse.Namespace, text: str, limit_n: float) -> str:
    """What a lab's own file says to be driven by this calibration: to be pasted."""
    least_n = math.ceil(tomllib.loads(text)["calibration"]["least_force_n"])
    told = "\nfor your own file, in which each section stands once:\n\n"
    told += f'[gripper]\ncalibration = "{args.out}"'
    if least_n > limit_n:
        told += (
            f"\n[guard]\nforce_limit_n = {least_n}  # this hand cannot keep {limit_n:g}\n"
            f"[controller]\ngrip_force_n = {least_n}"
        )
    return told


def calibrate_noise(args: argparse.Namespace) -> int:
    from detector.scores.unlabelled import hold_of
    from scenarios.benchmark.label_free import tune_unlabelled
    from scenarios.campaign.config import load_config
    from scenarios.lab.hand import guard_of
    from scenarios.lab.ready import active_hand, check_close
    from scenarios.lab.sessions import held_still

    config = lab_config(args)
    judged = load_config("can", args.rig, args.detector, args.config, args.set)
    new_file(args.out)
    tell_weak(config.calibration)
    guard_of(config)  # raises where a run would be refused
    holding = f"the fingers, closed on an object for {args.seconds:g} s, then opened"
    if args.dry_run:
        check_close(config, active_hand(config), CLOSED)
        tell_mode(config)
        return tell(args, {"would": f"move {holding}; the arm stands"})
    permit = leave_to_move(config, args, lambda: f"move {holding}")
    tell_mode(config)
    operator = _operator()
    will(f"move {holding}; the arm stands")
    with interruption.held():
        counts = held_still(config, permit, args.seconds, operator, _tell)
        found = tune_unlabelled(judged, [(counts, *hold_of(counts))], args.budget)
    return _written(args, _rule_file(args, found, found.rule == judged.rule))


def _rule_file(args: argparse.Namespace, found: Any, kept: bool) -> str:
    from grasp.cli.detector import rule_lines
    from scenarios.lab.scale import noted, now

    low, high = found.interval
    why = (
        "the packaged rule is higher and kept: a still hand knows nothing of closing, of lifting "
        "or of blows" if kept else "higher than the packaged rule"
    )  # fmt: skip
    source = (
        f"a hold of {found.minutes:.1f} minutes, {now()}, {args.detector}: level {found.level:.2f} "
        f"({low:.2f} to {high:.2f}, 95 %), {'below the packaged rule' if kept else 'taken'}"
    )
    return (
        f"# Rule for {args.detector}, {now()}: {found.minutes:.1f} minutes of hold, "
        f"{found.load_counts:.0f} counts of load, {args.budget:g} false events a minute.\n"
        f"# Level {found.level:.2f} [{low:.2f}, {high:.2f}] (95 %); {why}.\n"
        f"[source]\nrule = {noted(source, args.note)}\n"
        + "\n".join(rule_lines(found.rule)) + "\n"
    )  # fmt: skip


def _over_a_scale(args: argparse.Namespace) -> None:
    confirm(f"{SCALE} Is that fingertip alone over it, and no object in the hand?", "scale",
            args.scale)  # fmt: skip


def _operator() -> Any:
    """Raises UsageError where nobody will answer."""
    from grasp.cli.operator import TerminalOperator

    operator = TerminalOperator()
    operator.expect()
    return operator


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _written(args: argparse.Namespace, text: str) -> int:
    """Kept, and shown."""
    write_whole(args.out, text.encode())
    if args.json:
        print(json_line({"file": str(args.out), "text": text, "exit_code": exits.SUCCESS}))
    else:
        print(text, end="")
        print(args.out)
    return exits.SUCCESS
