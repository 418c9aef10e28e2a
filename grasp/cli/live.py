"""What a person sees of a run: a live panel or plain lines, then the verdict."""

import sys
from typing import TYPE_CHECKING, Any, Self

from drivers.interfaces import FINGER_NAMES
from grasp.loop import Tick
from grasp.phases import Phase

if TYPE_CHECKING:
    from rich.status import Status

REFRESH_TICKS = 6
STATUS_TICKS = 50
BAR_CELLS = 30
FORCE_FULL_N = 12.0
_STYLE = {
    Phase.COMPENSATE: "bold yellow", Phase.HOLD: "bold green", Phase.FAULT: "bold red",
}  # fmt: skip


_SETTING_UP = {
    "simulated": "the first time, the world is compiled",
    "emulated": "starting a cell, then the gripper activates (10 s, the first time 20 s)",
    "hardware": "the gripper activates, which opens and closes it",
}


class Display:
    """Follows runs tick by tick. ``quiet`` shows nothing; ``plain`` draws no panel, so that a
    person can type; ``brief`` leaves plain lines to registrations."""

    def __init__(self, quiet: bool, plain: bool = False, brief: bool = False) -> None:
        self._view: _Live | _Lines | None = None
        if not quiet:
            self._view = _Live() if sys.stdout.isatty() and not plain else _Lines(brief)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def setting_up(self, rig: str) -> None:
        """Say that the rig is being opened, which may take a while."""
        if self._view is not None:
            self._view.waiting(f"setting up the {rig} rig: {_SETTING_UP[rig]}")

    def tick(self, tick: Tick) -> None:
        """Show one tick. A screen that is gone must not stop a run: nothing more is shown then."""
        if self._view is None:
            return
        try:
            self._view.tick(tick)
        except OSError:
            self._view = None

    def note(self, text: str) -> None:
        """A line between two runs."""
        if self._view is not None:
            self._view.note(text)

    def close(self) -> None:
        """Leave the last state on the screen; safe to call twice."""
        if self._view is not None:
            self._view.close()


class AcquireDisplay:
    """Follows an acquisition: a line a phase in a pipe, one that is renewed in a terminal."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._status: Status | None = None
        self._ticks = 0

    def __enter__(self) -> Self:
        if not self._quiet and sys.stdout.isatty():
            from rich.console import Console

            self._status = Console().status("")
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()

    def setting_up(self, rig: str) -> None:
        self._show(f"setting up the {rig} rig")

    def tick(self, tick: Any) -> None:
        """Show one tick of ``scenarios.acquire.session``."""
        self._ticks += 1
        every = REFRESH_TICKS if self._status is not None else 2 * STATUS_TICKS
        if self._ticks % every == 0:
            x, y, _ = tick.arm.velocity_mps
            self._show(
                f"{tick.t_ns * 1e-9:7.2f} s  {tick.phase:<9} {tick.force_n:5.1f} N  "
                f"{1e3 * (x * x + y * y) ** 0.5:5.1f} mm/s  {tick.arm.spin_radps:+5.2f} rad/s"
            )

    def _show(self, text: str) -> None:
        if self._status is not None:
            self._status.update(text)
        elif not self._quiet:
            print(text, flush=True)


def status_text(tick: Tick) -> str:
    """nominal / REGISTERED, as the paper's monitor showed it."""
    slip = tick.decision.slip
    if not slip.armed:
        return "-"
    text = "REGISTERED" if slip.registered else "nominal"
    return f"{text} (masked)" if slip.masked else text


class _Lines:
    """One line a phase change, a registration, and every half second; or registrations alone."""

    def __init__(self, brief: bool) -> None:
        self._brief = brief
        self._phase: Phase | None = None
        self._ticks = 0

    def waiting(self, text: str) -> None:
        print(text, flush=True)

    def note(self, text: str) -> None:
        print(text, flush=True)

    def tick(self, tick: Tick) -> None:
        changed = tick.decision.phase is not self._phase
        self._phase = tick.decision.phase
        due = changed or self._ticks % STATUS_TICKS == 0
        if tick.decision.slip.event or (due and not self._brief):
            print(_line(tick))
        self._ticks += 1

    def close(self) -> None:
        sys.stdout.flush()


def _line(tick: Tick) -> str:
    fingers = "  ".join(
        f"{name} {force:5.1f} N p {p:4.2f}"
        for name, force, p in zip(
            FINGER_NAMES, tick.measured_n, tick.observation.probabilities.tolist(), strict=True
        )
    )
    return (
        f"{tick.t_ns * 1e-9:7.2f} s  {tick.decision.phase:<10}  {fingers}  slip {status_text(tick)}"
    )


class _Live:
    """A panel that is redrawn in place, with the phase log beneath it."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        self._live = Live(console=Console(), auto_refresh=False)
        self._waiting: Status | None = None
        self._ticks = 0
        self._phase: Phase | None = None
        self._last: Tick | None = None

    def waiting(self, text: str) -> None:
        """A line that moves until the first tick comes."""
        self._waiting = self._live.console.status(text)
        self._waiting.start()

    def note(self, text: str) -> None:
        self._live.console.print(text, highlight=False)

    def _stop_waiting(self) -> None:
        if self._waiting is not None:
            self._waiting.stop()
            self._waiting = None

    def tick(self, tick: Tick) -> None:
        self._stop_waiting()
        self._live.start()  # with the first tick; does nothing afterwards
        if tick.decision.phase is not self._phase or tick.decision.slip.event:
            self._phase = tick.decision.phase
            self._live.console.print(_line(tick), highlight=False)
        self._last = tick
        if self._ticks % REFRESH_TICKS == 0:
            self._live.update(panel(tick), refresh=True)
        self._ticks += 1

    def close(self) -> None:
        self._stop_waiting()
        if self._live.is_started:
            if self._last is not None:
                self._live.update(panel(self._last), refresh=True)
            self._live.stop()


def panel(tick: Tick) -> Any:
    """The live picture: phase, slip status, and a bar of force and of probability a finger."""
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    rows = zip(
        FINGER_NAMES, tick.measured_n, tick.observation.probabilities.tolist(),
        tick.gripper.fingers, strict=True,
    )  # fmt: skip
    for name, force_n, p, finger in rows:
        table.add_row(
            f"finger {name}",
            Text(_bar(force_n / FORCE_FULL_N), style="cyan"),
            f"{force_n:5.1f} N",
            Text(_bar(p), style="red" if p > 0.5 else "blue"),
            f"p {p:4.2f}",
            f"{finger.position_counts:3d} counts",
        )
    phase = tick.decision.phase
    title = Text.assemble(
        (f" {phase} ", _STYLE.get(phase, "bold")),
        f"  t {tick.t_ns * 1e-9:6.2f} s   arm {tick.arm.position_m[2]:6.3f} m   slip: ",
        (status_text(tick), "bold red" if tick.decision.slip.registered else "green"),
        " ",
    )
    return Panel(table, title=title, title_align="left", expand=False)


def _bar(part: float) -> str:
    filled = round(min(max(part, 0.0), 1.0) * BAR_CELLS)
    return "█" * filled + "·" * (BAR_CELLS - filled)


def print_verdict(result: Any) -> None:
    """The short verdict of a trial and where its recording is."""
    word = "SUCCESS" if result.success else "FAILED"
    print(f"\n{word}: {result.outcome.replace('_', ' ')}  ({result.object}, seed {result.seed})")
    for text in _facts(result):
        print(f"  {text}")
    if result.recording:
        print(f"  recording: {result.recording}")


def _facts(result: Any) -> list[str]:
    facts = []
    if result.detection_latency_ms is not None:
        text = f"slip registered {result.detection_latency_ms:.0f} ms after its onset"
        if result.reaction_latency_ms is not None:
            text += f", grip force rising {result.reaction_latency_ms:.0f} ms after it"
        facts.append(text)
    if result.slip_distance_m is not None:
        facts.append(f"the object slipped {result.slip_distance_m * 1e3:.0f} mm")
    if result.peak_force_n:
        peaks = ", ".join(f"{name} {force:.1f}" for name, force in result.peak_force_n.items())
        facts.append(f"peak force {peaks} N (true); commanded {result.commanded_force_n:.1f} N")
    else:
        facts.append(f"commanded {result.commanded_force_n:.1f} N")
    return facts


def tap_line(result: Any) -> str:
    """One tap in a line."""
    parts = [f"tap {result.seed:<4} {result.direction:<7}  {result.outcome.replace('_', ' '):<18}"]
    if result.displacement_m is not None:
        parts.append(f"moved {result.displacement_m * 1e3:5.1f} mm")
    if result.slip_duration_ms is not None:
        parts.append(f"in {result.slip_duration_ms:3.0f} ms")
    if result.detection_latency_ms is not None:
        parts.append(f"registered after {result.detection_latency_ms:.0f} ms")
    if result.nominal_again_ms is not None:
        parts.append(f"nominal {result.nominal_again_ms:.0f} ms after its end")
    return "  ".join(parts)


def print_taps(summary: Any) -> None:
    """The figures of a series of taps."""
    print()
    for name, n in (*summary.by_direction.items(), ("all", summary.total)):
        rate = f" ({100 * n.successes / n.moved:.0f} %)" if n.moved else ""
        print(
            f"{name:<9} {n.successes} of {n.moved} taps that moved it{rate}; "
            f"{n.false_alarms} of {n.unmoved} that moved nothing registered all the same"
        )
    others = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in summary.outcomes.items())
    print(f"outcomes  {others}")
