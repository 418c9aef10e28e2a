"""The log of `-v`: what a run did, a line each with the wall clock's time, as it happens."""

from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from grasp.commands import describe
from grasp.files import make_private_file, make_private_folder
from grasp.loop import Tick

if TYPE_CHECKING:
    from scenarios.acquire.session import Sample


class RunLog:
    """Appends to a file of its own; a disk that is full costs the log, not the run."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where it cannot be made."""
        make_private_folder(path.parent)
        make_private_file(path)
        self.path = path
        self._file = path.open("a", encoding="utf-8", buffering=1)
        self._phase: str | None = None
        self._lost = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        if error is not None:
            self.say(f"ended by {kind.__name__ if kind else ''}: {error}")
        self._file.close()

    def say(self, text: str) -> None:
        """One line."""
        now = datetime.now().astimezone().isoformat(timespec="milliseconds")
        try:
            if not self._lost:
                self._file.write(f"{now} {text}\n")
        except OSError:
            self._lost = True

    def tick(self, tick: Tick) -> None:
        """Phases, slip that is registered, and every command with what became of it."""
        decision, at = tick.decision, f"t {tick.t_ns * 1e-9:.3f} s"
        self._phase_of(at, decision.state)
        if decision.slip.event:
            self.say(f"{at} slip is registered")
        for issued in tick.issued:
            asked, admitted = describe(issued.asked), describe(issued.admitted)
            changed = "" if admitted == asked else f"; the guard admits: {admitted}"
            note = issued.applied.note if issued.applied is not None else ""
            became = issued.refused or note
            self.say(f"{at} {asked}{changed}" + (f" ({became})" if became else ""))

    def sample(self, sample: "Sample") -> None:
        """Of an acquisition: phases, and what the finger presses with where they begin."""
        at = f"t {sample.t_ns * 1e-9:.3f} s"
        self._phase_of(at, sample.phase, f", {sample.force_n:.2f} N")

    def _phase_of(self, at: str, phase: str, more: str = "") -> None:
        if phase != self._phase:
            self._phase = phase
            self.say(f"{at} phase {phase}{more}")
