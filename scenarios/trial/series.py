"""Runs a series of trials: each on a new simulated rig, or all on one open rig."""

import math
from collections.abc import Generator, Iterator, Sequence

from drivers.errors import GraspError, Refused, Stale
from drivers.interfaces import Vector3
from grasp.control.fault import IMPLAUSIBLE, INTERRUPTED
from grasp.run import signals
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import GraspRig
from scenarios.trial.config import TrialConfig
from scenarios.trial.experiment import ConfigT, Experiment, TrialContext, TrialT
from scenarios.trial.final_state import state_between_trials
from scenarios.trial.operator_prompts import Operator, place_object
from scenarios.trial.result import Failure, JudgedTrial, ResultT

MAX_REPEATS = 3  # of the same trial
HOME_TOLERANCE_M = 0.005  # from here the arm may go to the first trial's home by itself; assumed

Series = Generator[JudgedTrial[ResultT], None, None]


def run_series(
    experiment: Experiment[ConfigT, TrialT, ResultT],
    config: ConfigT,
    seeds: Sequence[int],
    context: TrialContext,
    numbers: Sequence[int] = (),
    of: int = 0,
    home: Vector3 | None = None,
) -> Series[ResultT]:
    """Run and judge one trial per seed, each with its own folder; ends after one with a failure.

    Every trial on the simulated rig gets a new one, so that it depends on its own seed alone. Any
    other rig is opened once: its world loads the next object, or the operator places it, and every
    trial begins at the home of the first. With an operator, a trial with stale or implausible
    device data is repeated as long as the hand is open. A device error or a signal while an object
    is placed ends the series with a failure and no result. On hardware, a trial that leaves the
    hand closed ends the series with its verdict.

    ``numbers``: numbers of these trials in a series ``of`` so many that is resumed, from 1;
    ``home``: where its trials begin, None: at the arm's current position.

    Raises KeyboardInterrupt for a stop between two trials without an operator. Raises Refused where
    the arm is too far from ``home``, or the hand on hardware is closed.
    """
    used, of = experiment.prepare(config, seeds, context), of or len(seeds)
    numbers = numbers or range(1, of + 1)
    with signals.deferred():
        if used.rig != "simulated":
            with open_rig(used.built_for(seeds[0]), seeds[0], context.paced, context.permit) as rig:
                yield from _on_one_rig(experiment, used, seeds, rig, context, numbers, of, home)
            return
        for seed, number in zip(seeds, numbers, strict=True):
            context.on_trial(number, of)
            judged = experiment.run_on_new_rig(used, seed, context)
            yield judged
            if judged.failure is not None:
                return


def _on_one_rig(
    experiment: Experiment[ConfigT, TrialT, ResultT], used: ConfigT, seeds: Sequence[int],
    rig: GraspRig, context: TrialContext, numbers: Sequence[int], of: int, home: Vector3 | None,
) -> Series[ResultT]:  # fmt: skip
    first, operator = True, context.operator
    _check_hand(rig)
    _check_home(rig, home)
    for seed, number in zip(seeds, numbers, strict=True):
        for prompt in _prompts(f"Trial {number} of {of}"):
            if operator is None:
                signals.check()
            if not first and rig.load is not None:
                rig.load(used.built_for(seed), seed)
            ended = None
            if operator is not None and not (first and context.placed):
                ended = _place_or_fail(used, rig, operator, prompt)
            if ended is not None:
                yield JudgedTrial(None, ended)
                return
            context.on_trial(number, of)
            judged = experiment.run_on(rig, used, seed, context, home)
            first = False
            home = home if judged.result is None else judged.result.home_m or home
            yield judged
            if judged.failure is None and (rig.load is not None or not _leaves_closed(judged)):
                break
            if operator is None or not _may_be_repeated(judged):
                return
        else:
            return


def _leaves_closed(judged: JudgedTrial[ResultT]) -> bool:
    """Whether it has a verdict and ended in a safe state with a hand that is not open."""
    result = judged.result
    return result is not None and result.end is not None and not result.end.open


def _place_or_fail(
    config: TrialConfig, rig: GraspRig, operator: Operator, prompt: str
) -> Failure | None:
    """Let the operator place the object; the failure where a device error or a signal ended
    that."""
    try:
        signals.check()
        place_object(rig, operator, prompt)
    except GraspError as error:
        kind, message, remedy = error.kind, error.message, error.remedy
    except KeyboardInterrupt as stop:
        kind, remedy = INTERRUPTED, ""
        message = f"{signals.cause(stop)} before {prompt[0].lower()}{prompt[1:]}"
    else:
        return None
    gripper = None if rig.gripper is None else rig.gripper.state
    old_s = config.controller.stale_after_s
    end = state_between_trials(rig.arm.state, gripper, rig.clock.now_ns, old_s, rig.release_hint)
    return Failure(kind, message, remedy, end)


def _prompts(title: str) -> Iterator[str]:
    yield title
    for _ in range(MAX_REPEATS):
        yield f"{title} again, because device data was stale or implausible"


def _may_be_repeated(judged: JudgedTrial[ResultT]) -> bool:
    """Whether stale or implausible data ended it, with a stationary arm and an open hand."""
    failure = judged.failure
    if failure is None or failure.kind not in (Stale.kind, IMPLAUSIBLE) or failure.end is None:
        return False
    return failure.end.open and not failure.end.unconfirmed


def _check_hand(rig: GraspRig) -> None:
    """Raises Refused where the hand is not open and no simulated world opens it."""
    gripper = None if rig.gripper is None else rig.gripper.state
    if rig.load is None and gripper is not None and not gripper.is_open:
        raise Refused(
            f"the hand is not open, at {gripper.positions} counts: it may hold something",
            rig.release_hint or "open it first",
        )


def _check_home(rig: GraspRig, home: Vector3 | None) -> None:
    """Raises Refused where the arm is not where the first trial began: it only returns there by
    itself at the end of a trial (``arm.workspace_low_m``)."""
    arm = rig.arm.state
    if home is None or arm is None or math.dist(arm.position_m, home) <= HOME_TOLERANCE_M:
        return
    x, y, z = (1e3 * there for there in home)
    raise Refused(
        f"the arm is {math.dist(arm.position_m, home) * 1e3:.0f} mm from where the first trial "
        f"began, x {x:.1f}, y {y:.1f}, z {z:.1f} mm",
        "move it back there with the hand open, or start a new series with another --out",
    )
