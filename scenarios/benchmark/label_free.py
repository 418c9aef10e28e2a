"""Label-free calibration of a rule on holds without slip (`grasp detector tune --unlabelled`).

A recording is a lift with a long hold, or a file of counts that ends with the hand opening.
"""

from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.decision import RuleSettings
from detector.recordings import SUFFIX, read
from detector.scores.evaluation import stream
from detector.scores.label_free import MARGIN_SAMPLES, CalibratedRule, calibrate_rule, find_hold
from drivers.errors import UsageError
from drivers.interfaces import FINGERS
from grasp.control.states import State
from grasp.run.messages import CONTROL, TACTILE, ControlMessage, TactileMessage
from scenarios.trial.config import TrialConfig
from scenarios.trial.run_folder import open_trial

Counts = NDArray[np.int16]  # (n, fingers, taxels)


def read_hold(path: Path) -> tuple[Counts, slice, float]:
    """Counts of a recording, the samples of its hold, and the load of the hold in counts.

    Raises BadFile for a file of another kind, UsageError without a hold or without its end.
    """
    if path.suffix in (SUFFIX, ".csv"):
        counts = read(path).counts
        return counts, *find_hold(counts)
    rows: list[list[int]] = []
    phases: list[str] = []
    latest: list[int] | None = None
    for topic, _, message in open_trial(path):
        if topic == TACTILE and isinstance(message, TactileMessage):
            latest = message.counts
        elif topic == CONTROL and isinstance(message, ControlMessage) and latest is not None:
            rows.append(latest)
            phases.append(message.phase)
    holding = np.flatnonzero([phase == State.HOLD for phase in phases])
    if not len(holding):
        raise UsageError(f"{path} has no hold", "give a lift, with a long controller.hold_s")
    counts = np.array(rows, np.int16).reshape(len(rows), FINGERS, -1)
    _, load = find_hold(counts)
    return counts, slice(int(holding[0]) + MARGIN_SAMPLES, int(holding[-1])), load


def tune_without_labels(
    config: TrialConfig, recorded: Iterable[tuple[Counts, slice, float]], budget_per_min: float
) -> CalibratedRule:
    """Calibrate the configured rule on results of ``read_hold``. The level is never below the
    configured one, because a hold has no closing, no lifting and no taps."""
    holds, loads = [], []
    for counts, hold, load in recorded:
        detector = config.make_detector(counts.shape[1], counts.shape[2])
        holds.append(stream(detector, counts)[0][hold])
        loads.append(load)

    def calibrated(rule: RuleSettings) -> CalibratedRule:
        return calibrate_rule(holds, rule, budget_per_min, min(loads))

    configured, replace = config.rule, msgspec.structs.replace
    found = calibrated(configured)
    total = found if configured.kind != "either" else calibrated(replace(configured, kind="cusum"))
    threshold = max(configured.threshold, found.rule.threshold)
    rule = replace(configured, threshold=threshold, limit=max(configured.limit, total.rule.limit))
    return replace(found, rule=rule)
