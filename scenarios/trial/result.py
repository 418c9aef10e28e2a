"""What a trial leaves: its verdict with every figure that went into it."""

import platform
import subprocess
import traceback
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Generic, Self, TypeVar

import msgspec

from detector.scores.quantiles import Quantiles, quantiles
from drivers.errors import exception_text
from drivers.interfaces import FINGER_NAMES, Vector3
from grasp import signals
from grasp.fault import INTERNAL, TRIAL, Fault
from grasp.guard import CapMode
from grasp.loop import Timing
from grasp.states import PhaseChange
from scenarios.rigs.rig import Stalls
from scenarios.trial.ending import End
from scenarios.world.settings import ContactLevels


def spelt(outcome: str) -> str:
    """An outcome as a person writes it: `held_within_6cm` is held within 6 cm."""
    words = outcome.replace("_", " ")
    return f"{words[:-2]} cm" if words.endswith("cm") else words


REPORT = "a bug: report it with what the run has left"


class TimingResult(msgspec.Struct, frozen=True):
    """Measured on this machine. On the simulated rig the frame age is virtual time, and there is no
    wire to acknowledge anything; on one, the time runs from the decision to the reply to the write
    that carries it."""

    frame_to_decision_us: Quantiles | None
    decision_to_ack_us: Quantiles | None
    frame_age_ms: Quantiles | None
    missed_periods: int  # that the loop slept through
    repeated_frames: int  # periods without a new frame
    real_time: bool | None  # did the system grant a real-time priority; None in virtual time
    cell_stalls: int  # times that the emulated cell, not the loop, stood still over 50 ms
    worst_cell_stall_ms: float


class PhaseEntry(msgspec.Struct, frozen=True):
    """When a phase began, and why."""

    phase: str
    t_s: float
    cause: str


class Bug(msgspec.Struct, frozen=True):
    """An exception that no code of ours may raise, and that ended a run."""

    name: str
    text: str
    traceback: str

    @classmethod
    def of(cls, error: BaseException) -> Self:
        """Raises nothing: it is asked for before the safe state is pursued."""
        raised = ""
        with suppress(BaseException):  # of its own text, or for want of memory
            told = "".join(traceback.format_exception(error))
            raised = told.encode(errors="backslashreplace").decode()
        return cls(type(error).__name__, exception_text(error), raised)

    @property
    def fault(self) -> Fault:
        """With where it was raised."""
        frames = [line for line in self.traceback.splitlines() if line.startswith("  File ")]
        raised = [line for line in frames if signals.__file__ not in line]
        where = f" ({raised[-1].strip()})" if raised else ""
        text = f"{self.name}: {self.text.partition(chr(10))[0]}{where}"
        return Fault("internal_error", TRIAL, text, REPORT, kind=INTERNAL)


class TrialResult(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict of one trial, whatever it tried. Times in seconds on the rig's clock; None = did not
    happen, or cannot be known without a simulation. Forces in newtons a finger. ``success`` is
    None where it was interrupted: then it is not judged."""

    scenario: str
    object: str
    rig: str
    detector: str
    seed: int
    success: bool | None
    outcome: str
    slip_onset_s: float | None
    slip_registered_s: float | None
    detection_latency_ms: float | None
    peak_force_n: dict[str, float] | None  # true, from first contact to last; None on hardware
    peak_measured_n: dict[str, float]  # by the fingertips, likewise
    commanded_force_n: float
    force_limit_n: float
    cap_mode: CapMode  # whether the limit is kept by every finger, or by each motor for itself
    paused_s: float  # the arm has stood in the lift so that slip might be answered
    phases: list[PhaseEntry]
    timing: TimingResult
    recording: str | None
    versions: dict[str, str]
    config_hash: str
    detector_hash: str  # of weights or formula, and rule
    end: End | None = None  # where it ended in a safe state
    faults: tuple[Fault, ...] = ()  # why it ended early
    reported: tuple[Fault, ...] = ()  # what would have ended it, had `monitors.mode` been stop
    bug: Bug | None = None  # where an internal error ended it
    home_m: Vector3 | None = None  # of the arm, which its descents end at; None: it never began
    physics: ContactLevels | None = None  # None on hardware
    taxels_at_rail: dict[str, int] = {}  # of each finger, at most at once; normal in a firm grip

    @property
    def failed(self) -> bool:
        """Whether a campaign that keeps failures keeps its recording."""
        return not self.success


class Failure(msgspec.Struct, frozen=True):
    """Why a run ended otherwise than by a verdict alone."""

    kind: str
    message: str
    remedy: str
    end: End | None = None  # how arm and hand were left, once a run had begun
    faults: tuple[Fault, ...] = ()


ResultT = TypeVar("ResultT", bound=TrialResult)


class FinishedRun(msgspec.Struct, Generic[ResultT], frozen=True):
    """A result, a failure, or both: a fault on the way is judged and reported."""

    result: ResultT | None
    failure: Failure | None

    def as_json(self) -> str:
        return msgspec.json.encode(self.result).decode()


def _quantiles(samples_ns: Sequence[int], unit_ns: float) -> Quantiles | None:
    return quantiles(sample / unit_ns for sample in samples_ns)


def timing_result(
    timing: Timing, acknowledged_ns: Sequence[int], real_time: bool | None, stalls: Stalls
) -> TimingResult:
    return TimingResult(
        frame_to_decision_us=_quantiles(timing.frame_to_decision_ns, 1e3),
        decision_to_ack_us=_quantiles(acknowledged_ns, 1e3),
        frame_age_ms=_quantiles(timing.frame_age_ns, 1e6),
        missed_periods=timing.missed_periods,
        repeated_frames=timing.repeated_frames,
        real_time=real_time,
        cell_stalls=stalls.count,
        worst_cell_stall_ms=round(stalls.worst_ms, 3),
    )


def phase_entries(log: Sequence[PhaseChange]) -> list[PhaseEntry]:
    return [PhaseEntry(change.phase, change.t_ns * 1e-9, change.cause) for change in log]


def seconds(t_ns: int | None) -> float | None:
    return None if t_ns is None else t_ns * 1e-9


def later_ms(since_s: float | None, t_s: float | None) -> float | None:
    """From one instant to another; None if either never was."""
    return None if since_s is None or t_s is None else (t_s - since_s) * 1e3


def named(values: Vector3) -> dict[str, float]:
    """By the fingers' names."""
    return dict(zip(FINGER_NAMES, values, strict=True))


@cache
def versions() -> dict[str, str]:
    """Of this program and of what its figures depend on."""
    try:
        own = version("grasp-controller")
    except PackageNotFoundError:
        own = "not installed"
    packages = {name: version(name) for name in ("numpy", "numba", "msgspec", "transitions")}
    return {"grasp": own, "commit": _commit(), "python": platform.python_version(), **packages}


def _commit() -> str:
    """Commit of the checkout that runs, with a mark when it is changed; `unknown` if installed."""
    command = ("git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    try:
        done = subprocess.run(
            command,
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.strip()
