"""Result of a trial: its verdict and the values behind it."""

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
from grasp.control.fault import INTERNAL, TRIAL, Fault
from grasp.control.guard import LimitMode
from grasp.control.states import PhaseChange
from grasp.run import signals
from grasp.run.loop import Timing
from scenarios.rigs.rig import Stalls
from scenarios.trial.final_state import FinalState
from scenarios.world.settings import ContactLevels


def spelt(outcome: str) -> str:
    """An outcome as text: `held_within_6cm` becomes "held within 6 cm"."""
    words = outcome.replace("_", " ")
    return f"{words[:-2]} cm" if words.endswith("cm") else words


REPORT = "a bug: report it with the run's folder"


class TimingResult(msgspec.Struct, frozen=True):
    """Timing on this machine. ``decision_to_ack_us`` runs from a decision to the reply to its
    Modbus write; None on the simulated rig, where ``frame_age_ms`` is virtual time."""

    frame_to_decision_us: Quantiles | None
    decision_to_ack_us: Quantiles | None
    frame_age_ms: Quantiles | None
    missed_periods: int  # without a control step
    repeated_frames: int  # periods without a new frame
    real_time: bool | None  # whether a real-time priority was granted; None in virtual time
    cell_stalls: int  # pauses over 50 ms of the emulated cell, not of the loop
    worst_cell_stall_ms: float


class PhaseEntry(msgspec.Struct, frozen=True):
    """Start time of a phase and its cause."""

    phase: str
    t_s: float
    cause: str


class Bug(msgspec.Struct, frozen=True):
    """An unexpected exception that ended a run: a defect of the program or of a plug-in."""

    name: str
    text: str
    traceback: str

    @classmethod
    def of(cls, error: BaseException) -> Self:
        """Describe an exception. Raises nothing: it is called before the safe state begins."""
        raised = ""
        with suppress(BaseException):  # by the exception's own text, or for lack of memory
            text = "".join(traceback.format_exception(error))
            raised = text.encode(errors="backslashreplace").decode()
        return cls(type(error).__name__, exception_text(error), raised)

    @property
    def fault(self) -> Fault:
        """The exception as a fault, with the line that raised it."""
        frames = [line for line in self.traceback.splitlines() if line.startswith("  File ")]
        raised = [line for line in frames if signals.__file__ not in line]
        where = f" ({raised[-1].strip()})" if raised else ""
        text = f"{self.name}: {self.text.partition(chr(10))[0]}{where}"
        return Fault("internal_error", TRIAL, text, REPORT, kind=INTERNAL)


# Largest ratios of forces, equal in truth, that the error of the estimate explains: of the two
# sides of a grip (below 1.9 in 119 of 120 simulated lifts), and of the stall to its calibration
UNLIKE_SIDES, UNLIKE_STALL = 2.0, 1.6


class GripFound(msgspec.Struct, frozen=True, kw_only=True):
    """What a first grasp by touch found, by the calibrations of hand and fingertips. ``bound``:
    what limits the force of a closing: the travel, or also the force byte."""

    width_m: float
    nearer_thumb_m: float  # of the object's middle, from that of the open hand
    first_force_n: float
    # estimated in the hold, of the thumb and of B and C together, which are equal in truth
    held_sides_n: tuple[float, float] | None
    stiffness_npm: float  # force at the thumb per metre of its travel, as last measured
    stiffness_measured: bool  # False: the value of object or guard, which is more
    bound: str
    stalled_n: float  # estimated force at which the thumb stopped by force; 0: it did not
    commanded_n: float  # by the calibration of the hand

    @property
    def lines(self) -> list[str]:
        """It as text, and what is inconsistent in it."""
        how = "measured" if self.stiffness_measured else "assumed, as taxels saturated"
        texts = [
            f"found by touch: {self.width_m * 1e3:.0f} mm wide, {self.stiffness_npm:.0f} N/m "
            f"({how}); first force {self.first_force_n:.1f} N, bounded by {self.bound}"
        ]
        thumb_n, others_n = self.held_sides_n or (0.0, 0.0)
        if max(thumb_n, others_n) > UNLIKE_SIDES * min(thumb_n, others_n):
            texts.append(f"A reads {thumb_n:.1f} N, B + C {others_n:.1f} N: calibrate each finger")
        if 0.0 < self.stalled_n < self.commanded_n / UNLIKE_STALL:
            texts.append(f"the thumb stopped at {self.stalled_n:.1f} N, by its calibration "
                         f"{self.commanded_n:.0f} N: calibrate hand and fingers")  # fmt: skip
        return texts


class TrialResult(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict of one trial of any experiment.

    Times in seconds on the rig's clock, forces in newtons per finger; None: did not happen, or is
    unknown without a simulation. ``success`` is None for an interrupted trial, which has no
    verdict."""

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
    peak_estimated_n: dict[str, float]  # estimated from the fingertips
    commanded_force_n: float
    force_limit_n: float
    limit_mode: LimitMode  # whether the limit holds for every finger, or for each motor
    paused_s: float  # total time that the arm stopped during the lift to respond to slip
    phases: list[PhaseEntry]
    timing: TimingResult
    recording: str | None
    started: str | None = None  # UTC of this machine, ISO 8601; None: not recorded
    versions: dict[str, str]
    config_hash: str
    detector_hash: str  # of weights or formula, and rule
    engine: str | None = None  # `compiled` or `onnxruntime`; None for a detector without a network
    grip: GripFound | None = None  # of a first grasp by touch that was complete
    end: FinalState | None = None  # after a safe state
    faults: tuple[Fault, ...] = ()  # why it ended early
    reported: tuple[Fault, ...] = ()  # failed checks that did not end it
    bug: Bug | None = None  # an internal error that ended it
    hidden: dict[str, int] = {}  # exceptions that were ignored so that it could go on: number
    arm: str | None = None  # address of the real arm; None without one
    home_m: Vector3 | None = None  # arm position at the grasp; None: it ended before
    physics: ContactLevels | None = None  # None on hardware
    taxels_at_rail: dict[str, int] = {}  # most saturated at once, by finger; normal in a firm grip

    @property
    def failed(self) -> bool:
        """Whether a campaign with `recordings = failures` keeps its recording."""
        return not self.success


class Failure(msgspec.Struct, frozen=True):
    """Reason why a run ended with an exit code other than its verdict's."""

    kind: str
    message: str
    remedy: str
    end: FinalState | None = None  # None where no run had begun
    faults: tuple[Fault, ...] = ()


ResultT = TypeVar("ResultT", bound=TrialResult)


class JudgedTrial(msgspec.Struct, Generic[ResultT], frozen=True):
    """A result, a failure, or both: a run that ended in a fault has a verdict too."""

    result: ResultT | None
    failure: Failure | None


def _quantiles(samples_ns: Sequence[int], unit_ns: float) -> Quantiles | None:
    return quantiles([sample / unit_ns for sample in samples_ns])


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
    """Milliseconds from ``since_s`` to ``t_s``; None if either is None."""
    return None if since_s is None or t_s is None else (t_s - since_s) * 1e3


def named(values: Vector3) -> dict[str, float]:
    """Values by finger name."""
    return dict(zip(FINGER_NAMES, values, strict=True))


@cache
def versions() -> dict[str, str]:
    """Versions of this program, its commit, Python and the packages that results depend on."""
    try:
        installed = version("grasp-controller")
    except PackageNotFoundError:
        installed = "not installed"
    packages = {name: version(name) for name in ("numpy", "numba", "msgspec", "transitions")}
    known = {"grasp": installed, "commit": _commit(), "python": platform.python_version()}
    return {**known, **packages}


def _commit() -> str:
    """Commit of the running checkout, with `-dirty` if changed; `unknown` if installed."""
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
