"""`grasp calibrate`: what a count of the fingertips, a byte of the hand and a still hold are worth,
measured on a lab's own devices and written into files for `--config` and `gripper.calibration`."""

import argparse
import math
import tomllib
from collections.abc import Callable
from typing import Any

from grasp.cli import fingertips
from grasp.cli.lab import (
    FINGERS,
    Done,
    TerminalOperator,
    add_command,
    confirm,
    lab_config,
    perform,
    say,
    tell_mode,
    tell_weak,
)
from grasp.cli.options import check_new, decimal, file_to_write, whole
from grasp.cli.output import aside
from grasp.cli.parser import Parser
from grasp.files import write_whole

ON_SCALE = (
    "One finger presses on a scale, harder than the limit of a run allows. Is that fingertip alone "
    "over it, and no object in the hand?"
)
MANUAL_LEAST_N, MANUAL_MOST_N = 15.0, 60.0
HOLD_S, SHORTEST_S = 180.0, 30.0
CLOSED = (255, 255, 255)


def add_commands(parser: Parser) -> None:
    force = _measurement(parser, "force", "counts of a fingertip to newtons: put weights on it or "
        "press it on a scale, and type what they say; with --press the finger presses by itself, a "
        "count at a time", calibrate_force,
        "grasp calibrate force --finger B --out force-B.toml --config lab.toml")  # fmt: skip
    _add_scale(force, required=False)
    force.flag("--press", "the finger presses on the scale")
    hand = _measurement(parser, "hand", "force bytes to newtons (an upper bound) and counts to "
        "millimetres: the finger presses on a scale, and you type what it says", calibrate_hand,
        "grasp calibrate hand --up-to 16 --out hand3.toml --config lab.toml --confirm-motion",
        "grasp calibrate hand --up-to 16 --places 10 30 50 70 90 --out hand3.toml "
        "--dry-run")  # fmt: skip
    _add_scale(hand, required=True)
    hand.option("--presses N", "presses per byte; a byte that presses with less than the manual "
        "states (15 N for byte 0) gets at least ten", whole(4, 100), default=10)  # fmt: skip
    hand.option("--bytes BYTE", "force bytes to press with; 0 is always included (default: 0)",
        whole(0, 255), nargs="+", default=[0])  # fmt: skip
    hand.option("--places COUNTS", "positions at which you read a ruler, five or more (default: "
        "none; travel is not measured)", whole(0, 255), nargs="+", default=[])  # fmt: skip
    noise = _measurement(parser, "noise", "the rule on slip that your fingertips allow, without "
        "labels: the hand holds something still for three minutes and lets it go; never below the "
        "rule that is there", calibrate_noise,
        "grasp calibrate noise --out rule.toml --config lab.toml --confirm-motion")  # fmt: skip
    noise.option("--detector NAME", "", default="tcn")
    noise.option("--budget N", "false events a minute of a hand", decimal(0.001, 60), default=0.5)
    noise.option("--seconds N", "duration of the hold", decimal(SHORTEST_S + 5, 3600),
        default=HOLD_S)  # fmt: skip
    fingertips.add_fit(parser.command("fingertip", "fit the simulated fingertip to a real "
        "recording, and show both side by side"))  # fmt: skip


def _measurement(
    parser: Parser, name: str, text: str, handler: Callable[..., int], *examples: str
) -> Parser:
    command = add_command(parser, name, text, handler, examples=examples)
    command.option("--out FILE", "new .toml file to write, with date, spread and source",
        file_to_write, required=True)  # fmt: skip
    command.option("--note TEXT", "text to add to the source in the file", default="")
    return command


def _add_scale(parser: Parser, required: bool) -> None:
    parser.option("--finger", "", choices=FINGERS, default="A")
    end = "" if required else " (default: the limit of a run, guard.force_limit_n)"
    parser.option("--up-to N", "largest force, N; it may exceed the limit of a run, up to the "
        f"manual's {MANUAL_MOST_N:g}; by the manual byte 0 may press with {MANUAL_LEAST_N:g}{end}",
        decimal(0.1, MANUAL_MOST_N), required=required)  # fmt: skip
    parser.flag("--scale", "one fingertip over a scale, and no object in the hand: do not ask")


def calibrate_force(args: argparse.Namespace) -> int:
    from scenarios.lab.ready import check_hearing, check_pressing
    from scenarios.lab.scale import check_force
    from scenarios.lab.sessions import calibrate_force as by_weights
    from scenarios.lab.sessions import press_force

    config = lab_config(args)
    check_new(args.out)
    up_to_n = config.guard.force_limit_n if args.up_to is None else args.up_to
    if args.press:
        asked = "--up-to" if args.up_to is not None else "the limit of a run, without --up-to,"
        check_force(up_to_n, called=asked)

    def plan() -> str:
        return f"move finger {args.finger} by single counts, up to {up_to_n:g} N on the scale"

    def look() -> str:
        if not args.press:
            check_hearing(config)
            return "move nothing"
        check_pressing(config, hearing=True)
        tell_mode(config)
        return plan()

    def act(permit: Any, operator: Any) -> str:
        if args.press:
            return press_force(config, permit, args.finger, up_to_n, operator, aside, args.note)
        return by_weights(config, args.finger, up_to_n, operator, aside, args.note)

    return _measure(args, config, plan, look, act, scale=True, moves=args.press)


def calibrate_hand(args: argparse.Namespace) -> int:
    from scenarios.lab.fit import check_places
    from scenarios.lab.ready import check_pressing
    from scenarios.lab.scale import check_force
    from scenarios.lab.sessions import calibrate_hand as press

    config = lab_config(args)
    check_new(args.out)
    check_force(args.up_to, {0, *args.bytes})
    if args.places:
        check_places(args.places)

    def plan() -> str:
        bytes_ = ", ".join(map(str, sorted({0, *args.bytes})))
        then = f", then to {args.places} counts in free air" if args.places else ""
        return (f"move finger {args.finger}, {args.presses} times with each of the force bytes "
                f"{bytes_}, onto the scale, with {args.up_to:g} N at most by the "
                f"manual{then}")  # fmt: skip

    def look() -> str:
        check_pressing(config, hearing=False)
        tell_mode(config)
        return plan()

    def act(permit: Any, operator: Any) -> str:
        return press(
            config, permit, args.finger, args.bytes, args.presses, args.up_to, args.places,
            operator, aside, args.note,
        )  # fmt: skip

    def how_to_use(text: str) -> str:
        limit_n = config.guard.force_limit_n
        least_n = math.ceil(tomllib.loads(text)["calibration"]["least_force_n"])
        told = "\nfor your own file, in which each section stands once:\n\n"
        told += f'[gripper]\ncalibration = "{args.out}"'
        if least_n > limit_n:
            told += (f"\n[guard]\nforce_limit_n = {least_n}  # this hand cannot keep {limit_n:g}\n"
                     f"[controller]\ngrip_force_n = {least_n}")  # fmt: skip
        return told

    return _measure(args, config, plan, look, act, scale=True, afterwards=how_to_use)


def calibrate_noise(args: argparse.Namespace) -> int:
    from detector.scores.unlabelled import hold_of
    from scenarios.benchmark.label_free import rule_of
    from scenarios.campaign.config import load_config
    from scenarios.lab.hand import guard_of
    from scenarios.lab.ready import active_hand, check_close
    from scenarios.lab.sessions import held_still

    config = lab_config(args)
    judged = load_config("can", args.rig, args.detector, args.config, args.set)
    check_new(args.out)
    tell_weak(config.calibration)
    guard_of(config)  # raises where a run would be refused

    def plan() -> str:
        held = f"closed on an object for {args.seconds:g} s, then opened"
        return f"move the fingers, {held}; the arm stands"

    def look() -> str:
        check_close(config, active_hand(config), CLOSED)
        tell_mode(config)
        return plan()

    def act(permit: Any, operator: Any) -> str:
        counts = held_still(config, permit, args.seconds, operator, aside)
        found = rule_of(judged, [(counts, *hold_of(counts))], args.budget)
        return _rule_file(args, found, found.rule == judged.rule)

    return _measure(args, config, plan, look, act)


def _measure(
    args: argparse.Namespace, config: Any, plan: Callable[[], str], look: Callable[[], str],
    act: Callable[[Any, Any], str], scale: bool = False, moves: bool = True,
    afterwards: Callable[[str], str] = lambda text: "",
) -> int:  # fmt: skip
    """As ``perform``, with a person who answers: ``act`` returns the text of the file, which is
    written and shown. ``scale``: a finger presses on one; ``afterwards``: says how to use it."""
    operator = TerminalOperator()

    def ask() -> None:
        if moves:
            tell_mode(config)
            if scale:
                confirm(ON_SCALE, "scale", args.scale)
        operator.expect()
        if moves:
            say(f"will {plan()}")

    def run(permit: Any) -> Done:
        text = act(permit, operator)
        write_whole(args.out, text.encode())
        if told := afterwards(text):
            aside(told)
        return Done(f"{text}{args.out}", {"file": str(args.out), "text": text})

    return perform(args, config, plan, look, run, ask, moves)


def _rule_file(args: argparse.Namespace, found: Any, kept: bool) -> str:
    from grasp.cli.detector import rule_lines
    from scenarios.lab.scale import noted, now

    low, high = found.interval
    why, how = "higher than the packaged rule", "taken"
    if kept:
        why = ("the packaged rule is higher and kept: a still hand knows nothing of closing, of "
               "lifting or of taps")  # fmt: skip
        how = "below the packaged rule"
    source = (
        f"a hold of {found.minutes:.1f} minutes, {now()}, {args.detector}: level {found.level:.2f} "
        f"({low:.2f} to {high:.2f}, 95 %), {how}"
    )
    return (
        f"# Rule for {args.detector}, {now()}: {found.minutes:.1f} minutes of hold, "
        f"{found.load_counts:.0f} counts of load, {args.budget:g} false events a minute.\n"
        f"# Level {found.level:.2f} [{low:.2f}, {high:.2f}] (95 %); {why}.\n"
        f"[source]\nrule = {noted(source, args.note)}\n"
        + "\n".join(rule_lines(found.rule)) + "\n"
    )  # fmt: skip
