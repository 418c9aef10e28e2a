"""Terminal view of a run: plain lines, or a live panel. In wall time it is a separate process
(``python -m grasp.cli.view``), which reads one JSON message per line until its input ends."""

import sys
from typing import TYPE_CHECKING

import msgspec

from drivers.interfaces import FINGER_NAMES, Counts3, Vector3
from grasp.control.states import State
from grasp.run.loop import Tick
from grasp.run.viewer_process import ignore_signals

if TYPE_CHECKING:
    from rich.panel import Panel as Frame
    from rich.status import Status

    from scenarios.acquire.session import Sample

BAR_CELLS, TEXT_CELLS = 30, 45  # longest bar; text of a panel's line without its two bars
FORCE_FULL_N = 12.0
_STYLE: dict[str, str] = {
    State.COMPENSATE: "bold yellow", State.HOLD: "bold green", State.KEPT: "bold green",
    State.FAULT: "bold red",
}  # fmt: skip


class Begin(msgspec.Struct, frozen=True, tag=True):
    """The first message."""

    panel: bool


class StatusLine(msgspec.Struct, frozen=True, tag=True):
    """A line that is shown until the next message."""

    text: str


class LogLine(msgspec.Struct, frozen=True, tag=True):
    """A line that remains."""

    text: str


class TickView(msgspec.Struct, frozen=True, tag=True):
    """Displayed values of one tick. ``event``: a phase began or slip was registered."""

    t_s: float
    phase: str
    slip: str
    registered: bool
    event: bool
    estimated_n: Vector3
    probabilities: list[float]
    positions: Counts3
    arm_m: float | None  # None: not a number
    trial: str = ""  # number of the trial in a series


Message = Begin | StatusLine | LogLine | TickView


def tick_view(tick: Tick, event: bool, trial: str = "") -> TickView:
    slip = tick.decision.slip
    status = "REGISTERED" if slip.registered else "nominal"  # as the paper's monitor showed it
    shown = f"{status}{' (masked)' if slip.masked else ''}" if slip.armed else "-"
    return TickView(
        tick.t_ns * 1e-9, tick.decision.state.value, shown, slip.registered, event,
        tick.estimated_n,
        tick.observation.probabilities.tolist(), tick.gripper.positions, tick.arm.position_m[2],
        trial,
    )  # fmt: skip


def sample_line(sample: "Sample") -> str:
    """Line for one sample of an acquisition."""
    x, y, _ = sample.arm.velocity_mps
    return (
        f"{sample.t_ns * 1e-9:7.2f} s  {sample.phase:<9} {sample.force_n:5.1f} N  "
        f"{1e3 * (x * x + y * y) ** 0.5:5.1f} mm/s  {sample.arm.spin_radps:+5.2f} rad/s"
    )


class Lines:
    """Prints each message as one line."""

    def take(self, message: Message) -> None:
        # in one write, because another process may print questions on the same terminal
        if isinstance(message, TickView):
            sys.stdout.write(f"{line(message)}\n")
        elif isinstance(message, StatusLine | LogLine):
            sys.stdout.write(f"{message.text}\n")
        sys.stdout.flush()

    def close(self) -> None:
        sys.stdout.flush()


class Panel:
    """Panel that is redrawn in place, below a log of phases and registrations."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        self._live = Live(console=Console(), auto_refresh=False)
        self._busy: Status | None = None

    def take(self, message: Message) -> None:
        if isinstance(message, StatusLine):
            if self._busy is None:
                self._busy = self._live.console.status(message.text)
                self._busy.start()
            self._busy.update(message.text)
        elif isinstance(message, LogLine):
            self._live.console.print(message.text, highlight=False)
        elif isinstance(message, TickView):
            self._draw(message)

    def _draw(self, shown: TickView) -> None:
        self._stop_waiting()
        self._live.start()  # has no effect after the first call
        if shown.event:
            self._live.console.print(line(shown), highlight=False)
        self._live.update(panel(shown, self._live.console.width), refresh=True)

    def _stop_waiting(self) -> None:
        if self._busy is not None:
            self._busy.stop()
            self._busy = None

    def close(self) -> None:
        self._stop_waiting()
        self._live.stop()


def line(shown: TickView) -> str:
    pairs = zip(FINGER_NAMES, shown.estimated_n, strict=True)
    forces = "  ".join(f"{name} {force:4.1f}" for name, force in pairs)
    return f"{shown.t_s:7.2f} s  {shown.phase:<15}  {forces} N  slip {shown.slip}"


def panel(shown: TickView, width: int) -> "Frame":
    """Panel with phase, slip status, and bars of force and probability of each finger, at most
    ``width`` columns wide."""
    from rich.panel import Panel as Frame
    from rich.table import Table
    from rich.text import Text

    cells = max(1, min(BAR_CELLS, (width - TEXT_CELLS) // 2))
    table = Table.grid(padding=(0, 2))
    rows = zip(FINGER_NAMES, shown.estimated_n, shown.probabilities, shown.positions, strict=True)
    for name, force_n, p, position in rows:
        table.add_row(
            f"finger {name}",
            Text(_bar(force_n / FORCE_FULL_N, cells), style="cyan"),
            f"{force_n:5.1f} N",
            Text(_bar(p, cells), style="red" if p > 0.5 else "blue"),
            f"p {p:4.2f}",
            f"{position:3d} counts",
        )
    arm = " no number" if shown.arm_m is None else f"{shown.arm_m:6.3f} m"
    title = Text.assemble(
        (f" {shown.phase} ", _STYLE.get(shown.phase, "bold")),
        f"  t {shown.t_s:6.2f} s   arm {arm}   slip: ",
        (shown.slip, "bold red" if shown.registered else "green"),
        " ",
    )
    return Frame(table, title=title, title_align="left", subtitle=shown.trial or None, expand=False)


def _bar(part: float, cells: int) -> str:
    filled = round(min(max(part, 0.0), 1.0) * cells)
    return "█" * filled + "·" * (cells - filled)


def main() -> None:
    """Show the messages on standard input until it ends."""
    ignore_signals()
    decode = msgspec.json.Decoder(Message).decode
    first = decode(sys.stdin.buffer.readline() or b'{"type":"Begin","panel":false}')
    shown = Panel() if isinstance(first, Begin) and first.panel else Lines()
    try:
        for message in sys.stdin.buffer:
            shown.take(decode(message))
        shown.close()
    except OSError:  # the screen is gone
        return


if __name__ == "__main__":
    main()
