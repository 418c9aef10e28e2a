"""Tunes the threshold of `energy` for a budget of false alarms, on lifts in which nothing slips."""

from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.energy import tune_threshold
from grasp.controller import GraspController
from grasp.loop import Tick
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.execution import make_guard, run_trial
from scenarios.world.cell import Truth

STICKY = 4.0  # friction with which no grasp of any object here lets it slip
FIRST_SEED = 1_000_000  # tuning seeds are kept apart from those of trials


def static_lift(config: LiftConfig, seed: int) -> NDArray[np.int16]:
    """Counts (n, fingers, 6) of one lift while the detector is armed and nothing slips.

    Raises ValueError when it slipped all the same.
    """
    body = msgspec.structs.replace(
        config.object, friction_static=STICKY, friction_kinetic=STICKY
    )  # as heavy as it is: a light one would ride along with the hand, and be quiet
    controller = msgspec.structs.replace(config.controller, reactions=False, keep=True)
    static = msgspec.structs.replace(config, object=body, controller=controller)
    frames: list[NDArray[np.int16]] = []

    def watch(tick: Tick, truth: Truth | None, controller: GraspController) -> None:
        if tick.decision.slip.armed and tick.frame is not None:
            frames.append(tick.frame.counts)

    with open_rig(static, seed, paced=False) as rig:
        trial = run_trial(static, rig, make_guard(static), watch)
    if trial.final is None or trial.final.slip_onset_s is not None:
        raise ValueError(f"the object slipped in the static lift of seed {seed}")
    return np.stack(frames)


def tune(
    configs: list[LiftConfig],
    lifts: int,
    false_events_per_min: float,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[float, float]:
    """Least threshold within the budget over all configs; and the minutes that it was tuned on."""
    recordings = []
    for config in configs:
        for k in range(lifts):
            recordings.append(static_lift(config, FIRST_SEED + k))
            progress(len(recordings), lifts * len(configs))
    threshold = tune_threshold(recordings, configs[0].energy, configs[0].rule, false_events_per_min)
    return threshold, sum(map(len, recordings)) * configs[0].loop.period_s / 60
