"""What other windows would have made of taps that are finished."""

from collections.abc import Iterable, Sequence

from scenarios.tap.result import TapResult
from scenarios.tap.scoring import UNMOVED, ObjectMotion, TapFacts, TapOutcome, verdict
from scenarios.tap.settings import TapScoringSettings


def verdict_again(result: TapResult, settings: TapScoringSettings) -> TapOutcome:
    """The verdict of a finished tap under other windows, from what its result has kept.

    Faults, excessive force and objects knocked out stay what they are.
    """
    if result.struck_s is None or result.outcome in (
        TapOutcome.KNOCKED_OUT, TapOutcome.OVER_FORCE, TapOutcome.FAULT,
    ):  # fmt: skip
        return TapOutcome(result.outcome)
    motion = ObjectMotion(
        struck_s=result.struck_s, from_s=result.slip_onset_s, until_s=result.slip_end_s,
        displacement_m=result.displacement_m or 0.0, turned_rad=result.turned_rad,
    )  # fmt: skip
    facts = TapFacts(
        motion=motion, alarms=result.alarms, watched_until_s=result.watched_until_s or 0.0,
        own_peak_n=None, force_bound_n=0.0,
    )  # fmt: skip
    return verdict(facts, settings)


def sensitivity(
    results: Sequence[TapResult], windows: Iterable[TapScoringSettings]
) -> list[tuple[TapScoringSettings, int, int]]:
    """(settings, successes, taps that moved) for each set of windows; nothing is run again."""
    table = []
    for settings in windows:
        outcomes = [verdict_again(r, settings) for r in results if r.struck_s is not None]
        moved = sum(o not in UNMOVED for o in outcomes)
        table.append((settings, outcomes.count(TapOutcome.REGISTERED), moved))
    return table
