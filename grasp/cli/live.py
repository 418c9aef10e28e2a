"""What a person sees of a run: a picture that follows it, then the verdict."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any, Protocol, Self, TypeVar

from drivers.errors import UsageError
from grasp.cli import view
from grasp.guard import limit_in_words
from grasp.loop import Tick
from grasp.states import State
from grasp.watch import Onlooker
from scenarios.trial.result import spelt

REFRESH_TICKS = 6
STATUS_TICKS = 50

_SETTING_UP = {
    "simulated": "a world is simulated",
    "emulated": "a cell starts",
    "hardware": "devices are connected",
}
_COMPILING = "setting up: the world is compiled, a minute or so; the next run finds it"
_HAND = {  # where there is one
    "simulated": "",
    "emulated": ", the gripper activates (10 s, the first time 20 s)",
    "hardware": "",
}


class Live(Protocol):
    """A page that follows a run: ``scenarios.report.live``."""

    @property
    def feed(self) -> Any: ...


LiveT = TypeVar("LiveT", bound=Live)


class Display:
    """Follows runs tick by tick. In wall time another process draws; in virtual time this one.

    ``quiet`` shows nothing; ``plain`` draws no panel, so that a person can type; ``brief`` leaves
    plain lines to registrations. ``onlooker``: who draws, in place of one of its own.
    """

    def __init__(
        self, rig: str, quiet: bool, plain: bool = False, brief: bool = False,
        onlooker: Onlooker | None = None,
    ) -> None:  # fmt: skip
        self._rig = rig
        self._panel = sys.stdout.isatty() and not plain
        self._brief = brief and not self._panel
        self._phase: State | None = None
        self._ticks = 0
        self._trial = ""
        self._until_closed = contextlib.ExitStack()
        self._there: Onlooker | None = None
        self._here: view.View | None = None
        if quiet:
            return
        if rig == "simulated":
            self._here = view.make(self._panel)
        else:
            self._there = onlooker or Onlooker(view)
            self._there.tell(view.Begin(self._panel))

    def __enter__(self) -> Self:
        if self._here is not None:  # where the world is
            from scenarios.world.compiling import told_when_compiling

            said = told_when_compiling(lambda: self.tell(view.Busy(_COMPILING)))
            self._until_closed.enter_context(said)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def setting_up(self, hand: bool = True) -> None:
        """Say that the rig is being opened, which may take a while; ``hand``: with a gripper."""
        more = _HAND[self._rig] if hand else ""
        self.tell(view.Busy(f"setting up: {_SETTING_UP[self._rig]}{more}"))

    def trial(self, number: int, of: int) -> None:
        """Which of several trials is shown from now on."""
        self._trial = f"trial {number} of {of}" if of > 1 else ""

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
        self._ticks += 1
        if self._ticks % (REFRESH_TICKS if self._panel else 2 * STATUS_TICKS) == 0:
            self._show(view.Busy(view.sample_line(sample)))

    def note(self, text: str) -> None:
        """A line between two runs."""
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
            _tell_lost(self._there.lost)
            self._there = None
        if self._here is not None:
            self._here.close()


def _tell_lost(pictures: int) -> None:
    """A screen that was too slow, or has gone: the run and its recording lack nothing."""
    if pictures:
        with contextlib.suppress(OSError):
            print(f"{pictures} pictures of the run were not drawn in time", file=sys.stderr)


@contextlib.contextmanager
def viewed(args: Any, make: Callable[[], LiveT]) -> Iterator[LiveT | None]:
    """What `--view` shows a run on, made by ``make`` and ended with it; None without."""
    if not args.view:
        yield None
        return
    try:
        live = make()
    except OSError as error:
        raise UsageError(f"--view: no page can be served here: {error}", "leave it out") from None
    try:
        print(f"view: {live.feed.address}", file=sys.stderr, flush=True)
        yield live
    finally:
        live.feed.close()


def physics_lines(result: Any) -> list[str]:
    """The contact levels of a trial, in one line; none on hardware."""
    found = result.physics
    if found is None:
        return []
    text = f"  contact level {found.level}, step {found.step_s * 1e3:g} ms"
    if result.scenario == "tap":
        step = f"step {found.blow_step_s * 1e3:g} ms"
        text += f"; {found.blow_level}, {step}, while a tap moves the object"
    return [text]


def print_verdict(result: Any, verbose: bool = False) -> None:
    """The short verdict of a trial and the path of its recording; ``verbose``: its level too."""
    word = {True: "SUCCESS", False: "FAILED", None: "NOT JUDGED"}[result.success]
    print(f"\n{word}: {spelt(result.outcome)}  ({result.object}, seed {result.seed})")
    for text in facts(result):
        print(f"  {text}")
    for line in physics_lines(result) if verbose else ():
        print(line)
    if result.success is not None and result.outcome != "fault" and result.end is not None:
        where = f"{result.end.where}: " if result.end.where else ""  # that an object was lost
        print(f"  {where}{result.end.arm}; {result.end.hand}")
        if result.end.advice:
            print(f"  {result.end.advice}")
    if result.recording:
        print(f"  recording: {result.recording}")


def facts(result: Any) -> list[str]:
    """What a person wants to know of a trial, a line each."""
    facts = []
    if result.detection_latency_ms is not None:
        late_ms = result.detection_latency_ms
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
    true_n, felt_n = result.peak_force_n, result.peak_measured_n
    peaks = ", ".join(f"{name} {force:.1f}" for name, force in (true_n or felt_n).items())
    known = "true" if true_n else "estimated by the fingertips"
    facts.append(f"peak force {peaks} N ({known}); commanded {result.commanded_force_n:.1f} N")
    facts.append(limit_in_words(result.force_limit_n, result.cap_mode))
    return facts


def trial_line(result: Any) -> str:
    """One lift or tap of several in a line."""
    return tap_line(result) if result.scenario == "tap" else _lift_line(result)


def _lift_line(result: Any) -> str:
    parts = [f"seed {result.seed:<4} {spelt(result.outcome):<18}"]
    if result.slip_distance_m is not None:
        parts.append(f"slipped {result.slip_distance_m * 1e3:5.1f} mm")
        parts.append(view.turned_text(result.turned_rad))
    if result.detection_latency_ms is not None:
        parts.append(f"registered after {result.detection_latency_ms:.0f} ms")
    return "  ".join(filter(None, parts))


def tap_line(result: Any) -> str:
    """One tap in a line."""
    parts = [f"seed {result.seed:<4} {result.direction:<7}  {spelt(result.outcome):<18}"]
    if result.displacement_m is not None:
        parts.append(f"moved {result.displacement_m * 1e3:5.1f} mm")
        parts.append(view.turned_text(result.turned_rad))
    if result.slip_duration_ms is not None:
        parts.append(f"in {result.slip_duration_ms:3.0f} ms")
    if result.detection_latency_ms is not None:
        parts.append(f"registered after {result.detection_latency_ms:.0f} ms")
    if result.nominal_again_ms is not None:
        parts.append(f"nominal {result.nominal_again_ms:.0f} ms after its end")
    return "  ".join(filter(None, parts))
