"""Label-free calibration of a rule from a hold without slip that ends with the hand opening.

A recording is a lift with a long hold, or a file of counts (`grasp detector tune --unlabelled`).
"""

from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.recordings import SUFFIX, read
from detector.scores.evaluation import stream
from detector.scores.unlabelled import SETTLED, Unlabelled, hold_of, set_rule
from drivers.errors import UsageError
from drivers.interfaces import FINGERS
from grasp.messages import CONTROL, TACTILE, ControlMessage, TactileMessage
from grasp.states import State
from scenarios.trial.config import TrialConfig
from scenarios.trial.run_folder import open_trial

Counts = NDArray[np.int16]  # (n, fingers, taxels)


def hold_in(path: Path) -> tuple[Counts, slice, float]:
    """Counts of a recording, the samples of its hold, and the load in counts that ended with it.

    Raises BadFile for another file, UsageError for one without a hold or its end.
    """
    if path.suffix in (SUFFIX, ".csv"):
        counts = read(path, labelled=False).counts
        return counts, *hold_of(counts)
    rows: list[list[int]] = []
    phases: list[str] = []
    latest: list[int] | None = None
    for topic, _, message in open_trial(path):
        if topic == TACTILE and isinstance(message, TactileMessage):
            latest = message.counts
        elif topic == CONTROL and isinstance(message, ControlMessage) and latest is not None:
            rows.append(latest)
            phases.append(message.phase)
    counts = np.array(rows, np.int16).reshape(len(rows), FINGERS, -1)
    held = np.flatnonzero([phase == State.HOLD for phase in phases])
    _, load = hold_of(counts)
    if not len(held):
        raise UsageError(f"{path} has no hold", "give a lift, with a long controller.hold_s")
    return counts, slice(int(held[0]) + SETTLED, int(held[-1])), load


def tune_unlabelled(
    config: TrialConfig, recorded: Iterable[tuple[Counts, slice, float]], budget_per_min: float
) -> Unlabelled:
    """The rule with a threshold set by results of ``hold_in``, holds without slip, and never below
    the configured one: a hold has no closing, no lifting and no taps."""
    holds, loads = [], []
    for counts, hold, load in recorded:
        detector = config.make_detector(counts.shape[1], counts.shape[2])
        holds.append(stream(detector, counts)[0][hold])
        loads.append(load)
    found, own = set_rule(holds, config.rule, budget_per_min, min(loads)), config.rule
    higher = msgspec.structs.replace(
        own, threshold=max(own.threshold, found.rule.threshold),
        limit=max(own.limit, found.rule.limit),
    )  # fmt: skip
    return msgspec.structs.replace(found, rule=higher)
