"""`grasp run lift --first`: the questions of a lab's first lift, and its first step."""

import argparse
from typing import Any

from drivers.errors import UsageError
from grasp import signals
from grasp.cli import exits
from grasp.cli.lab import say

ENOUGH = "q"
POLL_S = 0.05


def object_of(args: argparse.Namespace) -> str:
    """What is lifted: with `--first` something soft, unless another is named."""
    from scenarios.lab.ready import SOFT

    return SOFT if args.first and args.object == "can" else str(args.object)


def begin(config: Any, permit: Any, args: argparse.Namespace) -> Any:
    """Ask, close in free air, ask again; the settings of the gentle lift that follows.

    Raises UsageError on a rig without real devices, and where a person has had enough.
    """
    from grasp.cli.operator import TerminalOperator
    from scenarios.lab.ready import WHAT_TO_DO, close_in_free_air, gently

    if permit is None or args.json or args.trials is not None or args.resume:
        told = "--first is one lift by a person on the rig hardware"
        raise UsageError(told, "without --json, --trials and --resume; or leave --first out")
    slow = gently(config)
    TerminalOperator().expect()
    for line in WHAT_TO_DO:
        print(f"  {line}")
    with signals.deferred():
        _ask("Step 1 of 2, free air: nothing in the hand, the arm stands. The fingers close to "
             f"where they would grasp ({config.object.name}) and touch nothing")  # fmt: skip
        moved = close_in_free_air(slow, permit, say)
        print(f"  {moved.in_words()}, as it should be")
        controller, guard = slow.controller, slow.guard
        _ask(f"Step 2 of 2, {config.object.name}: put it, or something as soft, between the "
             f"fingers. The arm lifts it {controller.lift_height_m * 1e3:.0f} mm at "
             f"{controller.lift_speed_mps * 1e3:.0f} mm/s, no finger told more than "
             f"{guard.force_limit_n:g} N")  # fmt: skip
    return slow


def _ask(question: str) -> None:
    """Wait for Enter; raises UsageError where it is not to go on."""
    import time

    from grasp.cli.operator import TerminalOperator

    operator = TerminalOperator()
    operator.say(f"{question}: Enter; {ENOUGH}: no more")
    while (line := operator.poll()) is None:
        signals.check()
        time.sleep(POLL_S)
    if line.strip():
        raise UsageError("ended by hand: nothing more was moved", "start it again")


def tell_end(result: Any) -> None:
    """What to do after a first lift."""
    if result.success:
        print("  next: the same without --first, at full speed, then an object of your own")
    else:
        exits.report_line("look at the phases above before you go on")
