"""Why an object does not fare as in the paper: geometry, reaction, detection or signal.

Each is moved through its whole range, the others as they are: what cannot bring a class of the
paper's cell (within 6 cm, within 12 cm, lost) into its interval even so is not the cause. Detection
and reaction are moved on copies of the lift (``studies.reaction.copies``): the command to close
comes earlier or later. On a copy nobody listens any more: a full run that fails where its copy
holds has failed by an alarm, too early or without end.

Every lift is a row of a campaign file beside those of the calibration, so that it runs in the same
workers and an interrupted study goes on where it stopped.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from drivers.errors import GraspError
from scenarios.campaign.config import load_config
from scenarios.campaign.paper import TRIALS, paper_counts, wilson
from scenarios.campaign.run import OnProgress, Work, run
from scenarios.campaign.spec import CampaignSpec, Task
from scenarios.campaign.store import CampaignStore
from scenarios.campaign.summary import class_counts
from scenarios.campaign.worker import Finished, Row, identity, run_trial, spent
from scenarios.lift.config import LiftConfig
from scenarios.lift.scoring import SUCCESSES
from scenarios.rigs.workers import Workers
from scenarios.studies.reaction.copies import answered, at_lift, find_onset, react
from scenarios.studies.table4.calibrate import (
    IN_THE_AIR,
    SEED,
    Calibration,
    Candidate,
    assignments,
    counts_over_grid,
)

REACTION_RANGE_S = (0.0, 0.25)  # decision delay and command path together; assumed
DETECTION_FACTORS = (0.25, 4.0)  # of the detector's own delay
HOLDING_SHARES = (0.1, 1.0)  # how restless the hand is, over how restless while it presses; assumed
TEXTURES = (0.3, 2.0)  # factors on the object's own irregularity; assumed
UNLIKELY = 0.05  # p value of the paper's counts below which a cause is looked for
AS_IT_IS = "as it is"
REACTIONS = ("no reaction time", "slow reaction")
DETECTIONS = ("quick detection", "slow detection")
UNANSWERED = "unanswered"  # nothing slipped, or nobody heard it: there is no answer to move
Counts = tuple[int, ...]  # of lifts, by the classes of the paper's cell


class Range(msgspec.Struct, frozen=True):
    """What one cause alone can give; shares by the classes of the paper's cell."""

    cause: str
    low: list[float]
    high: list[float]
    reaches: bool  # the paper's 95 % interval, in every class


class Cause(msgspec.Struct, frozen=True):
    """Of one object; shares by the classes of the paper's cell."""

    object: str
    paper: list[tuple[float, float]]  # 95 % intervals
    shares: list[float]  # of the full runs
    ranges: list[Range]


def explain(
    result: Calibration, folder: Path, workers: Workers, on_progress: OnProgress
) -> list[Cause]:
    """Of the objects that even the best values leave unlikely. Runs what the folder's files lack.

    Raises ConfigError where the folder is of another calibration, GraspError where a lift ended
    without a verdict.
    """
    causes = []
    for each in result.best:
        if each.p_value < UNLIKELY:
            copies, signal = specs(result, each.object)
            moved = _rows(copies, folder, workers, on_progress, moved_lift)
            heard = _rows(signal, folder, workers, on_progress, run_trial)
            causes.append(cause_of(each, counts_over_grid(folder, each.object), moved, heard))
    return causes


def specs(result: Calibration, name: str) -> tuple[CampaignSpec, CampaignSpec]:
    """An object's lifts at its best place: those whose copies are moved, and those with another
    hand and surface."""
    own = [word for of, word in assignments(result) if of in ("", name)]
    body = load_config(name, "simulated", None, None, own, result.profile).object

    def spec(what: str, sweep: dict[str, tuple[float, ...]]) -> CampaignSpec:
        return CampaignSpec(
            name=f"cause-{name}-{what}", objects=(name,), profiles=(result.profile,),
            detectors=(result.detector,), settings=(IN_THE_AIR, *own), sweep=sweep,
            seeds=(SEED,), repetitions=result.repetitions, recordings="none",
        )  # fmt: skip

    textures = tuple(factor * body.texture_rms_m for factor in TEXTURES)
    return spec("copies", {}), spec(
        "signal", {"fingertip.holding_share": HOLDING_SHARES, "object.texture_rms_m": textures}
    )


def _rows(
    spec: CampaignSpec, folder: Path, workers: Workers, on_progress: OnProgress, work: Work
) -> list[Row]:
    path = folder / f"{spec.name}.sqlite"
    if run(spec, path, workers, resume=True, on_progress=on_progress, work=work).errors:
        raise GraspError(f"{path}: lifts without a verdict", "its column `error` says why")
    with CampaignStore.open(path) as store:
        return store.rows()


def moved_lift(trial: Task) -> Finished:
    """The trial's copies as a row: `result` has the outcome of each by its name."""
    if not isinstance(trial.config, LiftConfig):
        raise TypeError("copies are of lifts")
    wall, cpu = time.perf_counter(), time.process_time()
    outcomes = _moved(trial.config, trial.seed)
    own = outcomes[AS_IT_IS]
    return Finished(
        Row(
            **identity(trial), status="done", success=own in SUCCESSES, outcome=own,
            result=msgspec.json.encode(outcomes).decode(), **spent(wall, cpu),
        )
    )  # fmt: skip


def _moved(config: LiftConfig, seed: int) -> dict[str, str]:
    begun = at_lift(config, seed)
    onset_ns = find_onset(begun)
    answer = answered(config, seed)
    names = (AS_IT_IS, *REACTIONS, *DETECTIONS)
    if onset_ns is None or answer is None:
        return dict.fromkeys(names, UNANSWERED)
    sent_ns, command, registered_ns = answer
    late_ns = max(0, registered_ns - onset_ns)
    path_ns = round(config.hand.command_latency_s * 1e9) + sent_ns - registered_ns
    shortest, longest = (round(s * 1e9) - path_ns for s in REACTION_RANGE_S)
    quick, slow = (round(late_ns * (factor - 1)) for factor in DETECTION_FACTORS)
    shifts = (0, shortest, longest, quick, slow)
    return {
        name: react(config, begun, sent_ns + shift, command).outcome
        for name, shift in zip(names, shifts, strict=True)
    }


def cause_of(
    best: Candidate, grid: Sequence[Counts], moved: Sequence[Row], heard: Sequence[Row]
) -> Cause:
    """Of one object. ``grid``: over the calibration; ``moved``: rows of ``moved_lift``; ``heard``:
    full runs with another hand and surface."""
    name = best.object
    paper = [wilson(count, TRIALS) for count in paper_counts("lift", name)]

    def copies(names: Sequence[str]) -> list[Counts]:
        return [class_counts("lift", name, [_copy(row, key) for row in moved]) for key in names]

    swept = dict.fromkeys(row.swept for row in heard)
    signal = [class_counts("lift", name, [r for r in heard if r.swept == at]) for at in swept]
    ranges = [
        _range("geometry", grid, paper),
        _range("reaction", copies(REACTIONS), paper),
        _range("detection: delay", copies(DETECTIONS), paper),
        _range("detection: alarms", [best.counts, *copies([AS_IT_IS])], paper),
        _range("signal: shaking, texture", signal, paper),
    ]
    return Cause(name, paper, _shares(best.counts), ranges)


def _copy(row: Row, name: str) -> Row:
    outcome = msgspec.json.decode(row.result or "{}", type=dict[str, str])[name]
    return msgspec.structs.replace(row, outcome=outcome, success=outcome in SUCCESSES)


def _range(cause: str, places: Sequence[Counts], paper: Sequence[tuple[float, float]]) -> Range:
    by_class = list(zip(*(_shares(counts) for counts in places), strict=True))
    low, high = [min(each) for each in by_class], [max(each) for each in by_class]
    met = (a <= p[1] and b >= p[0] for a, b, p in zip(low, high, paper, strict=True))
    return Range(cause, low, high, all(met))


def _shares(counts: Counts) -> list[float]:
    return [count / max(1, sum(counts)) for count in counts]
