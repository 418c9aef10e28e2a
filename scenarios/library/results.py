"""What the calls of the library return: typed, frozen, arrays that cannot be written."""

import shutil
import weakref
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
    """One trial: its verdict, and what was recorded of it, one row a control step of 10 ms.

    Fingers are A (the thumb), B, C. ``failure`` is why it ended in a safe state, if it did;
    ``folder`` is the run's own, ``record`` all that its recording holds.
    """

    failure: Failure | None
    record: RunRecord
    folder: Path

    @property
    def verdict(self) -> str:
        """In one sentence."""
        return sentence(self.record)

    @property
    def t_s(self) -> Floats:
        """(n,) seconds on the rig's clock."""
        return self.record.t_s

    @property
    def probabilities(self) -> Floats:
        """(n, 3) of slip, by the detector."""
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
    def felt_force_n(self) -> Floats:
        """(n, 3) newtons, as the fingertips feel them."""
        return self.record.felt_n

    @property
    def true_force_n(self) -> Floats | None:
        """(n, 3) newtons normal to the pads; None where no world tells."""
        return None if self.record.truth is None else self.record.truth.normal_n

    @property
    def slip_m(self) -> Floats | None:
        """(n,) the object's way relative to the fingertips, down, while it is set down too: the
        slip of the verdict is `result.slip_distance_m`. None where no world tells."""
        return None if self.record.truth is None else self.record.truth.slip_m

    def page(self, out: Path | str) -> Path:
        """Write the page that shows and plays the run, one file that opens from disk."""
        write_whole(Path(out), run_page(self.folder).encode())
        return Path(out)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} in {self.folder}: {self.verdict}>"

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.verdict)}</p>"


class Lift(Trial, frozen=True, kw_only=True):
    """One lift, as `grasp.lift` returns it."""

    result: LiftResult

    @property
    def success(self) -> bool:
        """Whether the object was held in spite of slip; False for a lift that was not judged."""
        return bool(self.result.success)

    @property
    def outcome(self) -> str:
        """How it ended, as `held_within_6cm` or `dropped`."""
        return self.result.outcome


class Tap(Trial, frozen=True, kw_only=True):
    """One tap, as `grasp.tap` returns it."""

    result: TapResult


class Replayed(msgspec.Struct, frozen=True):
    """A run fed through the controller again."""

    replay: Replay

    @property
    def same(self) -> bool:
        """Whether every event and command is as recorded."""
        return not self.replay.differences

    def _repr_html_(self) -> str:
        verdict = "as recorded" if self.same else f"{len(self.replay.differences)} differences"
        events = [(f"{t_s:.2f}", what) for t_s, what in self.replay.events]
        return _table(f"{self.replay.steps} steps: {verdict}", ("t, s", "what"), events)


class Heard(msgspec.Struct, frozen=True, eq=False):
    """A fingertip's recording, and what detector and controller make of it."""

    recording: Recording
    probabilities: Floats  # (n, 3) of slip; fingers that were not recorded are at rest
    registered: tuple[tuple[float, str], ...]  # (t_s, finger), nobody reacting
    commands: tuple[SentCommand, ...]  # what the controller would have sent
    evaluation: Evaluation

    @classmethod
    def of(cls, recording: Recording, told: TactileReplay, sheet: Evaluation) -> "Heard":
        p = _frozen(np.array(told.probabilities))
        return cls(recording, p, tuple(told.registered), tuple(told.commands), sheet)

    def _repr_html_(self) -> str:
        s = self.evaluation
        caption = (
            f"{s.detector} on {s.data}: {s.true_events - s.missed_events} of {s.true_events} "
            f"slips caught, {s.false_events} false"
        )
        rows = [(f"{t_s:.2f}", finger) for t_s, finger in self.registered]
        return _table(caption, ("registered, s", "finger"), rows)


class Campaign(msgspec.Struct, frozen=True, eq=False):
    """A grid of trials that was run; ``file`` is None where nobody asked for one."""

    spec: CampaignSpec
    rows: tuple[Row, ...]
    summary: Summary
    file: Path | None

    def column(self, name: str) -> NDArray[np.generic]:
        """(trials,) of a column, as `slip_distance_m`; NaN where a number is missing. Raises
        AttributeError for no column."""
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
        heads = ("scenario", "object", "profile", "detector", "succeeded")
        caption = f"{self.summary.name}: {self.summary.trials} trials, {self.summary.errors} errors"
        return _table(caption, heads, rows)


def _table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table of HTML; everything in it is escaped."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
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
    """A run as arrays that nobody can write; raises BadFile."""
    record = read_run(folder)
    for holder in (record, record.truth):
        for value in () if holder is None else msgspec.structs.astuple(holder):
            if isinstance(value, np.ndarray):
                _frozen(value)
    return record


def _frozen(array: ArrayT) -> ArrayT:
    array.flags.writeable = False
    return array


def with_folder(trial: TrialT, temporary: Path | None) -> TrialT:
    """The trial; the temporary folder, if there is one, goes when the trial goes."""
    if temporary is not None:
        weakref.finalize(trial, shutil.rmtree, temporary, ignore_errors=True)
    return trial
