"""Trials of one scenario, one after the other: on one open rig where there are real wires."""

from collections.abc import Callable, Generator, Sequence
from pathlib import Path

import msgspec

from drivers.interfaces import Vector3
from grasp import interruption
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import GraspRig
from scenarios.trial.config import TrialConfig
from scenarios.trial.execution import OnTick
from scenarios.trial.person import Operator, place_object
from scenarios.trial.result import FinishedRun, ResultT

# one judged trial: its seed, an open rig and the arm's home in; what it left and that home out
Attempt = Callable[[int, GraspRig, Vector3 | None], tuple[FinishedRun[ResultT], Vector3]]
Series = Generator[FinishedRun[ResultT], None, None]


class Bench(msgspec.Struct, frozen=True):
    """Where trials are recorded, at which pace they go, who watches or helps, and who allows it."""

    runs: Path | None = None  # each leaves a folder of its own there; None records nothing
    paced: bool = False
    on_tick: OnTick = lambda tick: None
    operator: Operator | None = None
    permit: MotionPermit | None = None


def run_series(
    config: TrialConfig, seeds: Sequence[int], bench: Bench, attempt: Attempt[ResultT]
) -> Series[ResultT]:
    """One trial a seed. Ends after one that failed as a run; raises KeyboardInterrupt when it is
    stopped between two.

    The simulated rig is opened anew for each, so that a trial depends on its own seed alone. A
    wired one is opened once: its world loads the next object, or a person puts it back, and every
    trial begins from the home that the first one took.
    """
    with interruption.held():
        if config.rig == "simulated":
            yield from _anew(config, seeds, bench.paced, attempt)
            return
        with open_rig(config, seeds[0], bench.paced, bench.permit) as rig:
            home: Vector3 | None = None
            for number, seed in enumerate(seeds):
                interruption.check()
                if number and rig.load is not None:
                    rig.load(config, seed)
                if bench.operator is not None:
                    place_object(rig, bench.operator, f"Trial {number + 1} of {len(seeds)}")
                finished, home = attempt(seed, rig, home)
                yield finished
                if finished.failure is not None:
                    return


def _anew(
    config: TrialConfig, seeds: Sequence[int], paced: bool, attempt: Attempt[ResultT]
) -> Series[ResultT]:
    for seed in seeds:
        with open_rig(config, seed, paced) as rig:
            finished, _ = attempt(seed, rig, None)
        yield finished
        if finished.failure is not None:
            return
