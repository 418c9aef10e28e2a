"""Display of a run: a live view, then the verdict."""

import contextlib
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Self

from grasp.cli import view
from grasp.cli.output import print_status
from grasp.cli.questions import TerminalOperator
from grasp.control.states import State
from grasp.run.loop import Tick
from grasp.run.viewer_process import ViewerProcess
from scenarios.acquire.session import Sample
from scenarios.lift.scoring import LiftResult
from scenarios.report.run_view import facts, turned_text
from scenarios.tap.scoring import TapResult
from scenarios.trial.config import TrialConfig
from scenarios.trial.result import TrialResult, spelt

if TYPE_CHECKING:
    from scenarios.report.live_feed import LiveTrials

REFRESH_TICKS = 6
STATUS_TICKS = 50
SETTING_UP = {
    "simulated": "starting the simulation", "emulated": "starting the emulated cell",
    "hardware": "connecting to the devices",
}  # fmt: skip
ACTIVATING = ", activating the gripper"


class LocalViewer:
    """Draws in this process, with the methods of ``ViewerProcess``: in virtual time nothing waits.
    A closed screen does not stop a run."""

    def __init__(self, panel: bool) -> None:
        self._drawn = view.Panel() if panel else view.Lines()

    def show_waiting(self, message: view.Message) -> None:
        with contextlib.suppress(OSError):
            self._drawn.take(message)

    show = show_waiting

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._drawn.close()


class Display:
    """Shows runs tick by tick, in wall time from another process, in virtual time from this one.

    ``quiet`` shows nothing; with an ``operator``, who types, no panel is drawn, and only events are
    shown while a question is open; ``brief`` shows only lines of registrations. ``page``: the page
    of ``viewed``, which is updated too.
    """

    def __init__(
        self,
        rig: str,
        quiet: bool,
        operator: TerminalOperator | None = None,
        brief: bool = False,
        page: "LiveTrials | None" = None,
    ) -> None:
        self._rig, self._page, self._operator = rig, page, operator
        self._panel = sys.stdout.isatty() and operator is None
        self._brief = brief and not self._panel
        self._phase: State | None = None
        self._ticks = 0
        self._trial = ""
        self._until_closed = contextlib.ExitStack()
        self._shown: ViewerProcess | LocalViewer | None = None
        if not quiet and rig == "simulated":
            self._shown = LocalViewer(self._panel)
        elif not quiet:
            self._shown = ViewerProcess(view)
            self._shown.show_waiting(view.Begin(self._panel))

    def __enter__(self) -> Self:
        if isinstance(self._shown, LocalViewer):  # where the world is
            from scenarios.rigs.compilation import tell_of_compilation

            say = lambda text: self.show_waiting(view.StatusLine(f"setting up: {text}"))  # noqa: E731
            self._until_closed.enter_context(tell_of_compilation(say))
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def setting_up(self, hand: bool = True) -> None:
        """Show that the rig is being opened, which may take a while. ``hand``: with a gripper."""
        more = ACTIVATING if hand and self._rig == "emulated" else ""
        self.show_waiting(view.StatusLine(f"setting up: {SETTING_UP[self._rig]}{more}"))

    def trial(self, number: int, of: int) -> None:
        self._trial = f"trial {number} of {of}" if of > 1 else ""
        if self._page is not None:
            self._page.trial(number)

    def tick(self, tick: Tick) -> None:
        changed = tick.decision.state is not self._phase
        event = tick.decision.slip.event or (changed and not self._brief)
        every = REFRESH_TICKS if self._panel else STATUS_TICKS
        asking = self._operator is not None and self._operator.asking
        due = self._ticks % every == 0 and not self._brief and not asking
        self._phase = tick.decision.state
        self._ticks += 1
        if self._shown is not None and (event or due):
            self._shown.show(view.tick_view(tick, event, self._trial))

    def sample(self, sample: Sample) -> None:
        self._ticks += 1
        due = self._ticks % (REFRESH_TICKS if self._panel else 2 * STATUS_TICKS) == 0
        if self._shown is not None and due:
            self._shown.show(view.StatusLine(view.sample_line(sample)))

    def ended(self, text: str, note: bool) -> None:
        """Show the result of a run. ``note``: leave a line of it between two runs."""
        if self._page is not None:
            self._page.feed.say(text)
        if note:
            self.show_waiting(view.LogLine(text))

    def show_waiting(self, message: view.Message) -> None:
        """Show a message between ticks: waits for a reader that is behind."""
        if self._shown is not None:
            self._shown.show_waiting(message)

    def close(self) -> None:
        """Leave the last state on the screen; safe to call twice."""
        self._until_closed.close()
        if self._shown is not None:
            self._shown.close()
            self._shown = None


@contextlib.contextmanager
def viewed(
    shown: bool, config: TrialConfig, title: str, trials: int
) -> Iterator["LiveTrials | None"]:
    """The page of `--view`, closed with the run; None without the option."""
    if not shown:
        yield None
        return
    from scenarios.report.live_feed import LiveTrials

    live = LiveTrials(config, title, trials)
    print_status(f"view: {live.feed.address}")
    try:
        yield live
    finally:
        live.feed.close()


def verdict(result: TrialResult) -> str:
    word = {True: "SUCCESS", False: "FAILED", None: "NOT JUDGED"}[result.success]
    why = [f"{fault.code} ({fault.device})" for fault in result.faults]
    what = ", ".join(why) if result.outcome == "fault" and why else result.outcome
    lines = [f"\n{word}: {spelt(what)}  ({result.object}, rig {result.rig}, seed {result.seed})"]
    lines += [f"  {text}" for text in facts(result)]
    if result.success is not None and result.outcome != "fault" and result.end is not None:
        where = f"{result.end.where}: " if result.end.where else ""
        lines += [f"  {fault.line}" for fault in result.faults]  # why an object was lost
        lines.append(f"  {where}{result.end.arm}; {result.end.hand}")
        if result.end.advice:
            lines.append(f"  {result.end.advice}")
    if result.recording:
        lines.append(f"  recording: {result.recording}")
    return "\n".join(lines)


def trial_line(result: TrialResult) -> str:
    direction = f" {result.direction:<7} " if isinstance(result, TapResult) else ""
    parts = [f"seed {result.seed:<4}{direction} {spelt(result.outcome):<18}"]
    if isinstance(result, TapResult):
        parts += _moved("moved", result.displacement_m, result.turned_rad)
        if result.slip_duration_ms is not None:
            parts.append(f"in {result.slip_duration_ms:3.0f} ms")
    elif isinstance(result, LiftResult):
        parts += _moved("slipped", result.slip_distance_m, result.turned_rad)
    if result.detection_latency_ms is not None:
        parts.append(f"registered after {result.detection_latency_ms:.0f} ms")
    if isinstance(result, TapResult) and result.nominal_again_ms is not None:
        parts.append(f"nominal {result.nominal_again_ms:.0f} ms after its end")
    return "  ".join(filter(None, parts))


def _moved(how: str, moved_m: float | None, turned_rad: float | None) -> list[str]:
    return [] if moved_m is None else [f"{how} {moved_m * 1e3:5.1f} mm", turned_text(turned_rad)]
