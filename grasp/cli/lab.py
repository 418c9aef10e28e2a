"""What verbs of a lab's own devices share: options, settings, questions, how they end."""

import argparse
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from drivers.errors import GraspError, UsageError
from grasp.cli import exits
from grasp.cli.options import add_confirmation, add_settings, motion_permit
from grasp.cli.output import json_line
from grasp.cli.parser import Parser, verb

FINGERS = ("A", "B", "C")


def add_lab(parser: Parser, moves: bool) -> None:
    """`--rig`, settings and `--json`; of what ``moves`` something, `--confirm-motion` and
    `--dry-run` too."""
    parser.option("--rig NAME", "hardware, or a .toml file of a similar rig",
        default="hardware")  # fmt: skip
    add_settings(parser)
    parser.flag("--json", "one JSON object on standard output, nothing else")
    if moves:
        add_confirmation(parser)
        parser.flag("--dry-run", "print what would move, and move nothing")


def add_verb(
    verbs: Any, name: str, handler: Callable[..., int], text: str, moves: bool = True
) -> Parser:
    """Add a command for a lab's devices, with their common options."""
    parser = verb(verbs, name, handler, text)
    add_lab(parser, moves)
    return parser


def tell(args: argparse.Namespace, told: dict[str, Any], code: int = exits.SUCCESS) -> int:
    """Print what was done, or would be done; returns ``code``."""
    if args.json:
        print(json_line({**told, "exit_code": code}))
    else:
        for key, text in told.items():
            print(f"would {text}" if key == "would" else text)
    return code


def lab_config(args: argparse.Namespace) -> Any:
    """Settings for a lab's own devices; raises UsageError for a rig that has none."""
    from scenarios.campaign.config import load_for_devices
    from scenarios.rigs.permission import HARDWARE

    config = load_for_devices("can", args.rig, args.config, args.set)
    if config.rig != HARDWARE:
        raise UsageError(
            f"rig {args.rig} has no devices of a lab",
            "to rehearse, point the rig hardware at `grasp emulate` (docs/hardware.md)",
        )
    return config


def leave_to_move(config: Any, args: argparse.Namespace, plan: Callable[[], str]) -> Any:
    """As ``motion_permit``; a refusal says what would move, as far as the settings know it."""
    try:
        return motion_permit(config, args)
    except UsageError:
        with suppress(GraspError):
            say(f"would {plan()}")
        raise


def will(what: str) -> None:
    """On standard error, before it moves."""
    say(f"will {what}")


def new_file(path: Path) -> None:
    """Raises UsageError where something is there already: asked before a person has done the
    work."""
    if path.exists():
        raise UsageError(f"{path} is there already", "name another file: none is overwritten")


def confirm(question: str, word: str, given: bool) -> None:
    """Ask a person to type a word, unless it was given on the command line; raises UsageError for
    anything else, and where nobody can be asked."""
    if given:
        return
    option = f"--{word}"
    if sys.stdin is None or not sys.stdin.isatty():
        raise UsageError(f"nobody is there to be asked: {question}", f"if so, add {option}")
    print(f"{question} Type {word}: ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() != word:
        raise UsageError(f"{word!r} was not typed: nothing was moved", "start again when it is so")


def tell_weak(calibration: Any) -> None:
    """On standard error what a calibration claims against the manual, if it does."""
    from scenarios.rigs.calibration import weak_claim

    if calibration is not None and (claim := weak_claim(calibration)):
        exits.report_line(claim)


def tell_slow(config: Any) -> None:
    """On standard error what the arm's speed slider makes of its speeds; what refuses a run, or
    does not answer, is told by whoever opens the arm."""
    from drivers.ur.link.preflight import judge_speed, look
    from scenarios.rigs.permission import arm_address

    if config.devices.arm:
        return
    with suppress(GraspError):
        _, now = look(arm_address(config), config.ur.step_timeout_s)
        slider = judge_speed(now.speed_fraction)
        if slider.status == "warn":
            exits.report_line(f"{slider.detail} ({slider.remedy})")


def tell_mode(config: Any, opened: bool = False) -> None:
    """On standard error, of a hand that is not in basic mode, what that means. That scissor mode
    keeps it from closing is told by whoever opens the hand, unless it was ``opened`` only."""
    from drivers.robotiq.protocol import SCISSOR, TO_BASIC, other_than_basic
    from scenarios.rigs.device_checks import read_gripper

    if config.devices.gripper:
        return
    with suppress(GraspError):
        _, now = read_gripper(config)
        mode = now.mode if now.ready and (opened or now.mode != SCISSOR) else 0
        if strange := other_than_basic(mode):
            exits.report_line(f"the hand is {strange} ({TO_BASIC})")


def say(text: str) -> None:
    """On standard error: what will move, or what became of something that was stopped."""
    exits.report_line(text)
