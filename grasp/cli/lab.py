"""Shared by commands of a lab's devices: settings, dry runs, permission to move, warnings, and
questions to the operator."""

import argparse
import os
import select
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from drivers.errors import GraspError, UsageError
from drivers.robotiq.protocol import SCISSOR, SET_BASIC_MODE, mode_warning
from drivers.ur.link.preflight import check_speed_slider, read_status
from grasp import signals
from grasp.cli import exits
from grasp.cli.output import print_json
from scenarios.campaign.config import load_for_devices
from scenarios.rigs.calibration import weak_claim
from scenarios.rigs.device_checks import read_gripper
from scenarios.rigs.permission import HARDWARE, arm_address, permit

TYPED_BYTES = 4096  # at most; the kernel cuts what is typed there too
READS = 4  # at once

say = exits.report_line  # on standard error: what will move, or what became of what was stopped


def load_config(args: argparse.Namespace) -> Any:
    """Settings for a lab's own devices; raises UsageError for a rig that has none."""
    config = load_for_devices("can", args.rig, args.config, args.set)
    if config.rig != HARDWARE:
        raise UsageError(
            f"rig {args.rig} has no devices of a lab",
            "to rehearse, point the rig hardware at `grasp emulate` (docs/first-day.md)",
        )
    return config


class Done(NamedTuple):
    """What a command did: in words, for --json if that is more, and its exit code."""

    text: str
    value: dict[str, Any] | None = None
    code: int = exits.SUCCESS


def print_done(args: argparse.Namespace, done: Done, key: str = "done") -> int:
    """Print what was done, or would be done; returns the exit code."""
    if args.json:
        value = {key: done.text} if done.value is None else done.value
        print_json({**value, "exit_code": done.code})
    elif done.text:
        print(f"would {done.text}" if key == "would" else done.text)
    return done.code


def perform(
    args: argparse.Namespace, config: Any, plan: Callable[[], str], look: Callable[[], str],
    act: Callable[[Any], Done], before: Callable[[], object] = lambda: None, moves: bool = True,
) -> int:  # fmt: skip
    """Run a command that moves a lab's devices, or its dry run.

    ``plan``: what would move by the settings, for a refusal. ``look``: queries the devices for a
    dry run; returns what would move, raises what the motion would. ``before``: warns and asks.
    ``act``: moves, with the permit.
    """
    if args.dry_run:
        return print_done(args, Done(look()), "would")
    permit = motion_permit(config, args, plan) if moves else None
    before()
    with signals.deferred():
        done = act(permit)
    return print_done(args, done)


def motion_permit(
    config: Any, args: argparse.Namespace, plan: Callable[[], str] | None = None
) -> Any:
    """Permission to move real devices; None where the rig has none. Without `--confirm-motion` it
    prints what would move and raises UsageError."""
    try:
        return permit(config, args.confirm_motion, args.config, args.set, args.rig)
    except UsageError:
        if plan is not None:
            with suppress(GraspError):
                say(f"would {plan()}")
        raise


# Warnings on standard error


def warn_of_weak_calibration(calibration: Any) -> None:
    """What a calibration claims against the manual, if it does."""
    if calibration is not None and (claim := weak_claim(calibration)):
        say(claim)


def warn_of_slow_arm(config: Any) -> None:
    """Effect of the arm's speed slider. What prevents a run is reported when the arm is opened."""
    if config.devices.arm:
        return
    with suppress(GraspError):
        _, now = read_status(arm_address(config), config.ur.step_timeout_s)
        slider = check_speed_slider(now.speed_fraction)
        if slider.status == "warn":
            say(f"{slider.detail} ({slider.remedy})")


def warn_of_mode(config: Any, opened: bool = False) -> None:
    """What it means that a hand is not in basic mode. That scissor mode prevents closing is said
    when the hand is opened for it, so only with ``opened`` here."""
    if config.devices.gripper:
        return
    with suppress(GraspError):
        _, now = read_gripper(config)
        mode = now.mode if now.ready and (opened or now.mode != SCISSOR) else 0
        if strange := mode_warning(mode):
            say(f"the hand is {strange} ({SET_BASIC_MODE})")


# The person at the terminal


def confirm(question: str, word: str, given: bool) -> None:
    """Ask a person to type a word, unless it was given as an option; else raises UsageError."""
    if given:
        return
    if sys.stdin is None or not sys.stdin.isatty():
        raise UsageError(f"nobody is there to be asked: {question}", f"if so, add --{word}")
    print(f"{question} Type {word}: ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() != word:
        raise UsageError(f"{word!r} was not typed: nothing was moved", "start again when it is so")


class TerminalOperator:
    """Asks on standard error and reads answers on standard input; neither ever blocks."""

    def __init__(self) -> None:
        self.typed = b""  # and not yet polled
        self._gone = False

    def expect(self) -> None:
        """Before anything moves: raises UsageError where the input has ended, as of a script."""
        if not self._read():
            told = "nobody is there to be asked: standard input has ended"
            raise UsageError(told, "start it at a terminal: nothing was moved")

    def say(self, text: str) -> None:
        """Ask; what was typed before the question is no answer to it."""
        self._read()
        self.typed = b""
        self._print(text)

    def poll(self) -> str | None:
        """A line, once it is there. A terminal that closed counts as Ctrl-C, once."""
        if self._gone:
            return None
        ended = b"\n" not in self.typed and not self._read()
        if ended and b"\n" not in self.typed:
            self._gone = True
            self._print("standard input has ended")
            raise KeyboardInterrupt
        line, newline, rest = self.typed.partition(b"\n")
        if not newline:
            return None
        self.typed = rest
        return line.decode(errors="replace")

    def _print(self, text: str) -> None:
        with suppress(OSError):  # the terminal was closed
            print(f">>> {text}", file=sys.stderr, flush=True)

    def _read(self) -> bool:
        """Read what is there; False at the end of the input. Bounded: endless input must not keep
        the loop."""
        for _ in range(READS):
            try:
                if not select.select([sys.stdin], [], [], 0)[0]:
                    break
                some = os.read(sys.stdin.fileno(), TYPED_BYTES)
            except (OSError, TypeError, ValueError):  # the terminal was closed, or there is none
                return False
            if not some:
                return False
            self.typed = (self.typed + some)[-TYPED_BYTES:]
        return True
