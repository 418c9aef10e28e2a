"""Results of the Python API: typed, frozen, with read-only arrays."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import Recording
from detector.scores.evaluation import Evaluation
from grasp.files import write_whole
from scenarios.campaign.spec import CampaignSpec
from scenarios.campaign.summary import Summary
from scenarios.campaign.worker import Row
from scenarios.lift.scoring import LiftResult
from scenarios.report.run_page import run_page, sentence
from scenarios.report.run_record import RunRecord, read_run
from scenarios.tap.scoring import TapResult
from scenarios.trial.replay import Replay
from scenarios.trial.replay_tactile import SentCommand, TactileReplay
from scenarios.trial.result import Failure

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Trial(msgspec.Struct, frozen=True, eq=False, kw_only=True, weakref=True):
    """One trial: its verdict and recorded arrays, one row per control step of 10 ms.

    Fingers are A (the thumb), B, C. ``failure``: the cause if it ended in a safe state; ``folder``:
    the run's folder; ``record``: all recorded data.
    """

    failure: Failure | None
    record: RunRecord
    folder: Path

    @property
    def verdict(self) -> str:
        """The verdict in one sentence."""
        return sentence(self.record)

    @property
    def t_s(self) -> Floats:
        """(n,) seconds on the rig's clock."""
        return self.record.t_s

    @property
    def probabilities(self) -> Floats:
        """(n, 3) probability of slip by the detector."""
        return self.record.probabilities

    @property
    def registered(self) -> Flags:
        """(n,) whether slip is registered."""
        return self.record.registered

    @property
    def counts(self) -> Floats:
        """(n, 3, taxels) raw minus rest, pressing negative; NaN before rest counts were taken."""
        return self.record.counts

    @property
    def estimated_force_n(self) -> Floats:
        """(n, 3) newtons, estimated from the fingertips."""
        return self.record.estimated_n

    @property
    def true_force_n(self) -> Floats | None:
        """(n, 3) newtons normal to the pads; None without a simulation."""
        return None if self.record.truth is None else self.record.truth.normal_n

    @property
    def slip_m(self) -> Floats | None:
        """(n,) downward displacement of the object relative to the fingertips, m, including
        set-down; `result.slip_distance_m` excludes it. None without a simulation."""
        return None if self.record.truth is None else self.record.truth.slip_m

    def page(self, out: Path | str) -> Path:
        """Write an interactive HTML page of the run, one self-contained file."""
        write_whole(Path(out), run_page(self.folder).encode())
        return Path(out)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} in {self.folder}: {self.verdict}>"

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.verdict)}</p>"


class Lift(Trial, frozen=True, kw_only=True):
    """Result of `grasp.lift`."""

    result: LiftResult

    @property
    def success(self) -> bool:
        """Whether slip was detected and the object held; False without a verdict."""
        return bool(self.result.success)

    @property
    def outcome(self) -> str:
        """Name of the outcome, such as `held_within_6cm` or `dropped`."""
        return self.result.outcome


class Tap(Trial, frozen=True, kw_only=True):
    """Result of `grasp.tap`."""

    result: TapResult


class Replayed(msgspec.Struct, frozen=True):
    """Result of `grasp.replay` of a run."""

    replay: Replay

    @property
    def same(self) -> bool:
        """Whether every event and command equals the recorded one."""
        return not self.replay.differences

    def _repr_html_(self) -> str:
        verdict = "as recorded" if self.same else f"{len(self.replay.differences)} differences"
        events = [(f"{t_s:.2f}", what) for t_s, what in self.replay.events]
        return _table(f"{self.replay.steps} steps: {verdict}", ("t, s", "what"), events)


class TactileResult(msgspec.Struct, frozen=True, eq=False):
    """Result of `grasp.replay` of a fingertip's recording."""

    recording: Recording
    probabilities: Floats  # (n, 3) of slip; fingers that were not recorded are unloaded
    registered: tuple[tuple[float, str], ...]  # (t_s, finger), without any response
    commands: tuple[SentCommand, ...]  # that the controller would have sent
    evaluation: Evaluation | None  # None for a recording without labels

    @classmethod
    def of(
        cls, recording: Recording, replayed: TactileReplay, sheet: Evaluation | None
    ) -> "TactileResult":
        p = _frozen(np.array(replayed.probabilities))
        return cls(recording, p, tuple(replayed.registered), tuple(replayed.commands), sheet)

    def _repr_html_(self) -> str:
        s = self.evaluation
        caption = (
            f"{self.recording.source}: no labels"
            if s is None
            else (
                f"{s.detector} on {s.data}: {s['missed']:g} of {s['slips']:g} slips missed, "
                f"{s['false_alarms']:g} false alarms"
            )
        )
        rows = [(f"{t_s:.2f}", finger) for t_s, finger in self.registered]
        return _table(caption, ("registered, s", "finger"), rows)


class Campaign(msgspec.Struct, frozen=True, eq=False):
    """Result of `grasp.campaign`; ``file`` is None where no file was given."""

    spec: CampaignSpec
    rows: tuple[Row, ...]
    summary: Summary
    file: Path | None

    def column(self, name: str) -> NDArray[np.generic]:
        """Values (trials,) of a column such as `slip_distance_m`; NaN where a number is missing.
        Raises AttributeError for an unknown column."""
        values = [getattr(row, name) for row in self.rows]
        if any(isinstance(value, str) for value in values):
            return _frozen(np.array(["" if value is None else value for value in values]))
        return _frozen(np.array([np.nan if x is None else x for x in values], np.float64))

    def _repr_html_(self) -> str:
        rows = [
            (v.scenario, cell.object, v.profile, v.detector, f"{cell.successes} of {cell.trials}")
            for v in self.summary.variants
            for cell in v.cells
        ]
        headings = ("scenario", "object", "profile", "detector", "succeeded")
        caption = f"{self.summary.name}: {self.summary.trials} trials, {self.summary.errors} errors"
        return _table(caption, headings, rows)


def _table(caption: str, headings: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """An HTML table with escaped texts."""
    head = "".join(f"<th>{escape(text)}</th>" for text in headings)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(str(value))}</td>' for value in row)}</tr>" for row in rows
    )
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table>"
    )


ArrayT = TypeVar("ArrayT", bound=NDArray[np.generic])
TrialT = TypeVar("TrialT", bound=Trial)


def read_trial(folder: Path) -> RunRecord:
    """A run as read-only arrays; raises BadFile."""
    record = read_run(folder)
    for holder in (record, record.truth):
        for value in () if holder is None else msgspec.structs.astuple(holder):
            if isinstance(value, np.ndarray):
                _frozen(value)
    return record


def _frozen(array: ArrayT) -> ArrayT:
    array.flags.writeable = False
    return array
