"""What a person sees of a run: a picture that follows it, then the verdict."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any, Self

from drivers.errors import UsageError
from grasp.cli import view
from grasp.cli.output import aside
from grasp.guard import limit_in_words
from grasp.loop import Tick
from grasp.states import State
from grasp.watch import Onlooker
from scenarios.trial.result import spelt

REFRESH_TICKS = 6
STATUS_TICKS = 50
SETTING_UP = {
    "simulated": "a world is simulated",
    "emulated": "a cell starts",
    "hardware": "devices are connected",
}
ACTIVATING = ", the gripper activates (10 s, the first time 20 s)"
COMPILING = "setting up: the world is compiled, a minute or so; the next run finds it"


class Display:
    """Follows runs tick by tick. In wall time another process draws; in virtual time this one.

    ``quiet`` shows nothing; ``plain`` draws no panel, so that a person can type; ``brief`` leaves
    plain lines to registrations. ``page``: of ``viewed``, which follows too.
    """

    def __init__(
        self, rig: str, quiet: bool, plain: bool = False, brief: bool = False, page: Any = None
    ) -> None:
        self._rig, self._page = rig, page
        self._panel = sys.stdout.isatty() and not plain
        self._brief = brief and not self._panel
        self._phase: State | None = None
        self._ticks = 0
        self._trial = ""
        self._until_closed = contextlib.ExitStack()
        self._there: Onlooker | None = None
        self._here: view.Panel | view.Lines | None = None
        if quiet:
            return
        if rig == "simulated":
            self._here = view.Panel() if self._panel else view.Lines()
        else:
            self._there = Onlooker(view)
            self._there.tell(view.Begin(self._panel))

    def __enter__(self) -> Self:
        if self._here is not None:  # where the world is
            from scenarios.world.compiling import told_when_compiling

            said = told_when_compiling(lambda: self.tell(view.Busy(COMPILING)))
            self._until_closed.enter_context(said)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def setting_up(self, hand: bool = True) -> None:
        """Say that the rig is being opened, which may take a while; ``hand``: with a gripper."""
        more = ACTIVATING if hand and self._rig == "emulated" else ""
        self.tell(view.Busy(f"setting up: {SETTING_UP[self._rig]}{more}"))

    def trial(self, number: int, of: int) -> None:
        """Which of several trials is shown from now on."""
        self._trial = f"trial {number} of {of}" if of > 1 else ""
        if self._page is not None:
            self._page.trial(number)

    def tick(self, tick: Tick) -> None:
        """Show one tick, if it is time or something happened."""
        changed = tick.decision.state is not self._phase
        news = tick.decision.slip.event or (changed and not self._brief)
        every = REFRESH_TICKS if self._panel else STATUS_TICKS
        due = self._ticks % every == 0 and not self._brief
        self._phase = tick.decision.state
        self._ticks += 1
        if news or due:
            self._show(view.glimpse(tick, news, self._trial))

    def sample(self, sample: Any) -> None:
        """Show one sample of ``scenarios.acquire.session``."""
        if self._page is not None:
            self._page.watch(sample)
        self._ticks += 1
        if self._ticks % (REFRESH_TICKS if self._panel else 2 * STATUS_TICKS) == 0:
            self._show(view.Busy(view.sample_line(sample)))

    def ended(self, text: str, note: bool) -> None:
        """What a run has become; ``note``: leave a line of it between two runs."""
        if self._page is not None:
            self._page.feed.say(text)
        if note:
            self.tell(view.Note(text))

    def _show(self, message: view.Message) -> None:
        """During a run. A screen that is gone must not stop it: nothing more is shown then."""
        if self._there is not None:
            self._there.show(message)
        elif self._here is not None:
            try:
                self._here.take(message)
            except OSError:
                self._here = None

    def tell(self, message: view.Message) -> None:
        """To whoever draws: a process of its own, or this one."""
        if self._there is not None:
            self._there.tell(message)
        else:
            self._show(message)

    def close(self) -> None:
        """Leave the last state on the screen, and say what was never on it; safe to call twice."""
        self._until_closed.close()
        if self._there is not None:
            self._there.close()
            if self._there.lost:  # the run and its recording lack nothing
                with contextlib.suppress(OSError):
                    aside(f"{self._there.lost} pictures of the run were not drawn in time")
            self._there = None
        if self._here is not None:
            self._here.close()


@contextlib.contextmanager
def viewed(args: Any, make: Callable[[], Any]) -> Iterator[Any]:
    """The page of `--view` that shows a run, made by ``make`` and ended with it; None without."""
    if not args.view:
        yield None
        return
    try:
        live = make()
    except OSError as error:
        raise UsageError(f"--view: no page can be served here: {error}", "leave it out") from None
    try:
        aside(f"view: {live.feed.address}")
        yield live
    finally:
        live.feed.close()


def verdict(result: Any) -> str:
    """The short verdict of a trial and the path of its recording."""
    word = {True: "SUCCESS", False: "FAILED", None: "NOT JUDGED"}[result.success]
    lines = [f"\n{word}: {spelt(result.outcome)}  ({result.object}, seed {result.seed})"]
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


def facts(result: Any) -> list[str]:
    """What a person wants to know of a trial, a line each."""
    facts = []
    if (late_ms := result.detection_latency_ms) is not None:
        when = f"{late_ms:.0f} ms after" if late_ms >= 0.0 else f"{-late_ms:.0f} ms before"
        text = f"slip registered {when} its onset"
        if result.reaction_latency_ms is not None:
            text += f", grip force rising {result.reaction_latency_ms:.0f} ms after it"
        facts.append(text)
    if result.slip_distance_m is not None:
        slipped = f"the object slipped {result.slip_distance_m * 1e3:.1f} mm"
        facts.append(", ".join(t for t in (slipped, view.turned_text(result.turned_rad)) if t))
    if result.paused_s:
        facts.append(f"the arm stood {result.paused_s:.2f} s for answers to slip")
    true_n, measured_n = result.peak_force_n, result.peak_measured_n
    peaks = ", ".join(f"{name} {force:.1f}" for name, force in (true_n or measured_n).items())
    known = "true" if true_n else "estimated by the fingertips"
    facts.append(f"peak force {peaks} N ({known}); commanded {result.commanded_force_n:.1f} N")
    facts.append(limit_in_words(result.force_limit_n, result.cap_mode))
    return facts


def trial_line(result: Any) -> str:
    """One lift or tap of several in a line."""
    tap = result.scenario == "tap"
    moved_m = result.displacement_m if tap else result.slip_distance_m
    parts = [f"seed {result.seed:<4}{f' {result.direction:<7} ' if tap else ''} "
             f"{spelt(result.outcome):<18}"]  # fmt: skip
    if moved_m is not None:
        parts.append(f"{'moved' if tap else 'slipped'} {moved_m * 1e3:5.1f} mm")
        parts.append(view.turned_text(result.turned_rad))
    if tap and result.slip_duration_ms is not None:
        parts.append(f"in {result.slip_duration_ms:3.0f} ms")
    if result.detection_latency_ms is not None:
        parts.append(f"registered after {result.detection_latency_ms:.0f} ms")
    if tap and result.nominal_again_ms is not None:
        parts.append(f"nominal {result.nominal_again_ms:.0f} ms after its end")
    return "  ".join(filter(None, parts))
