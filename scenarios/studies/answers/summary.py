"""What the lifts of the study amount to: one row a policy and scene."""

from collections.abc import Sequence

import msgspec

from detector.scores.quantiles import Quantiles, quantiles
from grasp.phases import Phase
from scenarios.campaign.paper import wilson
from scenarios.studies.answers.study import SCENES, Answered


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """All lifts of one policy in one scene. Slip, mm: lost counts as infinity. Of force over the
    least the held alone count; shares over 0 to 1, intervals of 95 % (Wilson)."""

    policy: str
    scene: str
    axis: str
    value: float
    trials: int
    held: int
    lost: int  # left the hand in the air
    interval: tuple[float, float]
    feasible: int
    feasible_held: int
    slip_mm: Quantiles | None
    air_slip_mm: Quantiles | None
    over_least: Quantiles | None
    peak_n: float
    closings: float
    alarms: float
    paused_s: float
    seconds: float


class Answers(msgspec.Struct, frozen=True):
    """The whole study."""

    detector: str
    rig: str
    seeds: int
    first_seed: int
    objects: list[str]
    cells: list[Cell]
    lifts: list[Answered]


def summarize(
    detector: str, rig: str, seeds: Sequence[int], objects: Sequence[str], found: Sequence[Answered]
) -> Answers:
    """Cells in the order in which scenes and policies first appear."""
    ordered = sorted(found, key=lambda a: (a.scene, a.policy, a.object, a.seed))
    keys = dict.fromkeys((a.scene, a.policy) for a in found)
    cells = [
        _cell([a for a in ordered if (a.scene, a.policy) == key])
        for key in sorted(keys, key=lambda key: _place(key[0]))
    ]
    return Answers(detector, rig, len(seeds), seeds[0], list(objects), cells, ordered)


def _place(scene: str) -> int:
    return next(i for i, known in enumerate(SCENES) if known.name == scene)


def _cell(lifts: Sequence[Answered]) -> Cell:
    scene = SCENES[_place(lifts[0].scene)]
    n, held = len(lifts), [a for a in lifts if a.held]
    feasible = [a for a in lifts if a.feasible]
    return Cell(
        policy=lifts[0].policy, scene=scene.name, axis=scene.axis, value=scene.value, trials=n,
        held=len(held), lost=sum(a.ended == Phase.LOST for a in lifts),
        interval=wilson(len(held), n), feasible=len(feasible),
        feasible_held=sum(a.held for a in feasible), slip_mm=quantiles(a.slip_mm for a in lifts),
        air_slip_mm=quantiles(a.air_slip_mm for a in lifts),
        over_least=quantiles(a.force_n / a.least_n for a in held),
        peak_n=max(a.peak_n for a in lifts), closings=sum(a.closings for a in lifts) / n,
        alarms=sum(a.alarms for a in lifts) / n,
        paused_s=sum(a.paused_s for a in lifts) / n, seconds=sum(a.seconds for a in lifts) / n,
    )  # fmt: skip
