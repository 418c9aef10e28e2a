"""`grasp run lift --first`: a lab's first lift, in two supervised steps."""

import time

from drivers.errors import UsageError
from grasp.cli.commands import TrialsOptions
from grasp.cli.lab import say
from grasp.cli.questions import TerminalOperator
from grasp.run import signals
from scenarios.campaign.config import RunConfig
from scenarios.lab.preflight import STOP_INSTRUCTIONS, close_in_free_air, gentle_settings
from scenarios.rigs.permission import MotionPermit

QUIT = "q"
POLL_S = 0.05


def begin_first(config: RunConfig, permit: MotionPermit | None, args: TrialsOptions) -> RunConfig:
    """Ask, close in free air, ask again; returns the settings of the gentle lift that follows.
    Raises UsageError on a rig without real devices, and if the person quits."""
    if permit is None or args.json or args.trials is not None or args.resume:
        raise UsageError("--first is one supervised lift on the rig hardware, without --json, "
                         "--trials and --resume", "leave these out, or --first")  # fmt: skip
    slow = gentle_settings(config)
    TerminalOperator().expect()
    for line in STOP_INSTRUCTIONS:
        print(f"  {line}")
    with signals.deferred():
        _ask("Step 1 of 2, free air: with an empty hand and the arm at rest, the fingers close to "
             f"the grasp positions of {config.object.name} without contact")  # fmt: skip
        moved = close_in_free_air(slow, permit, say)
        print(f"  {moved.summary()}, as expected")
        controller, guard = slow.controller, slow.guard
        _ask(f"Step 2 of 2, {config.object.name}: put it, or an object as soft, between the "
             f"fingers. The arm lifts it {controller.lift_height_m * 1e3:.0f} mm at "
             f"{controller.lift_speed_mps * 1e3:.0f} mm/s, with at most {guard.force_limit_n:g} N "
             "commanded per finger")  # fmt: skip
    return slow


def _ask(question: str) -> None:
    """Wait for Enter; raises UsageError for other input."""
    operator = TerminalOperator()
    operator.say(f"{question}. Enter: continue; {QUIT}: quit")
    while (line := operator.poll()) is None:
        signals.check()
        time.sleep(POLL_S)
    if line.strip():
        raise UsageError("quit by the operator: nothing more was moved", "start it again")
