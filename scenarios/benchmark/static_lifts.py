"""Tunes the threshold of `energy` for a budget of false alarms, on lifts in which nothing slips.

What is lifted is drawn, as for the data sets: no object of the experiments is among it.
"""

from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.energy import tune_threshold
from grasp import interruption
from grasp.controller import GraspController
from grasp.loop import Tick
from scenarios.acquire.datasets.bodies import body_ranges, draw_object
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.trial.execution import make_guard, run_trial
from scenarios.world.cell import Truth

STICKY = 4.0  # friction with which no grasp of any object here lets it slip
FIRST_SEED = 1_000_000  # tuning seeds are kept apart from those of trials
KINDS = ("straight", "ellipsoid")  # of config/bodies, in turn
LOAD_SHARE = (0.3, 2.0)  # of what friction would carry in the first grip, were nothing sticky


def with_drawn_object(config: LiftConfig, number: int) -> LiftConfig:
    """The settings with an object of that number, drawn."""
    body = draw_object(
        body_ranges(KINDS[number % len(KINDS)]), LOAD_SHARE, config.contact,
        config.hand.m_per_count, sum(config.guard.full_grip_n),
        np.random.default_rng([FIRST_SEED, number]),
    )  # fmt: skip
    return msgspec.structs.replace(config, object=body)


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
    interruption.go_on()
    if trial.final is None or trial.final.slip_onset_s is not None:
        raise ValueError(f"the object slipped in the static lift of seed {seed}")
    return np.stack(frames)


def tune(
    config: LiftConfig,
    lifts: int,
    false_events_per_min: float,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[float, float]:
    """Least threshold within the budget, and the minutes that it was tuned on; an object a lift,
    the one of ``config`` plays no part."""
    recordings = []
    for k in range(lifts):
        recordings.append(static_lift(with_drawn_object(config, k), FIRST_SEED + k))
        progress(len(recordings), lifts)
    threshold = tune_threshold(recordings, config.energy, config.rule, false_events_per_min)
    return threshold, sum(map(len, recordings)) * config.loop.period_s / 60
