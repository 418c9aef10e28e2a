"""How much harder a lift may become before it fails: the rows of a campaign with axes."""

from collections.abc import Sequence
from typing import Any

import msgspec

from scenarios.campaign.axes import AXES, Axis, Harder
from scenarios.campaign.falls import Place, places
from scenarios.campaign.paper import wilson
from scenarios.campaign.spec import AT, MOVED
from scenarios.campaign.worker import Row
from scenarios.lift.scoring import LiftOutcome

NEVER_SLIPPED = LiftOutcome.NEVER_SLIPPED.value


class Tried(msgspec.Struct, frozen=True, kw_only=True):
    """One place of an axis. ``value``: in its unit; of the settings as they are None where objects
    differ in it. A grip that never slipped was not put to the test: it stands apart."""

    value: float | None
    tested: int  # trials out of which the rate is
    held: int  # in spite of slip
    never_slipped: int
    interval: tuple[float, float]  # Wilson, 95 %, of held out of tested
    share: tuple[float, float]  # of what 10 N can hold, least and most over the objects
    outcomes: dict[str, int]


class Line(msgspec.Struct, frozen=True, kw_only=True):
    """Success along one axis under one profile and detector."""

    axis: str
    title: str
    unit: str
    profile: str
    detector: str
    tried: list[Tried]  # easiest first
    bound: tuple[float, float]  # in the unit, least and most over the objects
    falls: list[Place]  # in the unit
    falls_share: list[Place]  # as a share of the bound


class Frontier(msgspec.Struct, frozen=True):
    """Of a whole campaign."""

    name: str
    trials: int
    errors: int
    lines: list[Line]


class _Stood(msgspec.Struct, frozen=True):
    """One trial on one axis."""

    value: float
    share: float
    moved: bool  # by this axis, not as the settings are
    row: Row

    @property
    def tested(self) -> bool:
        """Whether there was anything to answer."""
        return self.row.outcome != NEVER_SLIPPED

    @property
    def held(self) -> bool:
        return bool(self.row.success)


def summarize(name: str, rows: Sequence[Row]) -> Frontier:
    """Lines in the order in which axes, profiles and detectors first appear."""
    lines: dict[tuple[str, str, str], list[_Stood]] = {}
    for row in rows:
        if row.status != "done":
            continue
        swept: dict[str, Any] = msgspec.json.decode(row.swept)
        for axis, (value, share) in swept[AT].items():
            stood = _Stood(value, share, swept[MOVED] == axis, row)
            lines.setdefault((axis, row.profile, row.detector), []).append(stood)
    order = list(AXES)
    found = [_line(*key, stood) for key, stood in lines.items()]
    errors = sum(row.status == "error" for row in rows)
    return Frontier(name, len(rows), errors, sorted(found, key=lambda x: order.index(x.axis)))


def _line(name: str, profile: str, detector: str, stood: Sequence[_Stood]) -> Line:
    axis = AXES[name]
    sign = -1.0 if axis.harder is Harder.DOWN else 1.0
    tested = [s for s in stood if s.tested]
    held = [s.held for s in tested]
    return Line(
        axis=name, title=axis.title, unit=axis.unit, profile=profile, detector=detector,
        tried=_tried(stood, sign), bound=_bound(axis, stood),
        falls=[_in_unit(p, sign) for p in places([sign * s.value for s in tested], held)],
        falls_share=places([s.share for s in tested], held),
    )  # fmt: skip


def _tried(stood: Sequence[_Stood], sign: float) -> list[Tried]:
    here = [each for each in stood if not each.moved]
    groups: dict[float, list[_Stood]] = {}
    for each in stood:
        if each.moved:
            groups.setdefault(each.value, []).append(each)
    found = [_at(here)] if here else []
    return found + [_at(groups[value]) for value in sorted(groups, key=lambda v: sign * v)]


def _at(stood: Sequence[_Stood]) -> Tried:
    values, shares = {s.value for s in stood}, [s.share for s in stood]
    held, tested = sum(s.held for s in stood), sum(s.tested for s in stood)
    outcomes: dict[str, int] = {}
    for s in stood:
        outcomes[str(s.row.outcome)] = outcomes.get(str(s.row.outcome), 0) + 1
    return Tried(
        value=values.pop() if len(values) == 1 else None,
        tested=tested, held=held, never_slipped=len(stood) - tested,
        interval=wilson(held, tested),
        share=(min(shares), max(shares)),
        outcomes=dict(sorted(outcomes.items(), key=lambda item: -item[1])),
    )  # fmt: skip


def _bound(axis: Axis, stood: Sequence[_Stood]) -> tuple[float, float]:
    down = axis.harder is Harder.DOWN
    found = [s.value * s.share if down else s.value / s.share for s in stood if s.share > 0.0]
    return min(found), max(found)


def _in_unit(place: Place, sign: float) -> Place:
    """Back from how hard it is; the interval in the order of the axis, easier end first."""
    values = (place.at, place.low, place.high)
    at, low, high = (None if v is None else sign * v for v in values)
    return Place(place.level, at, low, high)
