"""Why an object is not caught as often as in the paper: geometry, reaction, detection or signal.

Each is moved through its whole range, the others as they are: what cannot reach the paper's
interval even so is not the cause. Detection and reaction are moved on copies of the lift
(``studies.reaction.copies``): the command to close comes earlier or later. On a copy nobody
listens any more: a full run that fails where its copy holds has failed by an alarm, too early or
without end.
"""

import itertools
from collections.abc import Sequence

import msgspec

from scenarios.campaign.paper import TRIALS, paper_counts, wilson
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.studies.reaction.copies import answered, at_lift, find_onset, react

REACTION_RANGE_S = (0.0, 0.25)  # decision delay and command path together; assumed
DETECTION_FACTORS = (0.25, 4.0)  # of the detector's own delay
HOLDING_SHARES = (0.1, 1.0)  # how restless the hand is, over how restless while it presses; assumed
TEXTURES = (0.3, 2.0)  # factors on the object's own irregularity; assumed


class Range(msgspec.Struct, frozen=True):
    """Success rates that one cause alone can give."""

    cause: str
    low: float
    high: float
    reaches: bool  # the paper's 95 % interval


class Cause(msgspec.Struct, frozen=True):
    """Of one object."""

    object: str
    paper: tuple[float, float]
    rate: float  # of the full runs
    ranges: list[Range]


def explain(
    config: LiftConfig, seeds: Sequence[int], rate: float, geometry: tuple[float, float]
) -> Cause:
    """Move each cause alone. ``rate``: of the full runs; ``geometry``: over the calibration's
    grid."""
    name = config.object.name
    counts = paper_counts("lift", name)
    paper = wilson(sum(counts[:-1]), TRIALS)
    rates: dict[str, list[bool]] = {}
    for seed in seeds:
        for key, success in _moved(config, seed).items():
            rates.setdefault(key, []).append(success)
    mean = {key: sum(got) / len(got) for key, got in rates.items()}
    ranges = [
        _range("geometry", geometry, paper),
        _range("reaction", (mean["no reaction time"], mean["slow reaction"]), paper),
        _range("detection: delay", (mean["quick detection"], mean["slow detection"]), paper),
        _range("detection: alarms", (rate, mean["as it is"]), paper),
        _range("signal: shaking, texture", signal_range(config, seeds), paper),
    ]
    return Cause(name, paper, rate, ranges)


def signal_range(config: LiftConfig, seeds: Sequence[int]) -> tuple[float, float]:
    """Least and greatest success rate over quiet and loud rest in the hand, smooth and rough
    surfaces: full runs, the detector as it is."""
    rates = []
    for share, factor in itertools.product(HOLDING_SHARES, TEXTURES):
        pads = msgspec.structs.replace(config.fingertip, holding_share=share)
        texture_m = factor * config.object.texture_rms_m
        body = msgspec.structs.replace(config.object, texture_rms_m=texture_m)
        changed = msgspec.structs.replace(config, fingertip=pads, object=body)
        results = [lift.run(changed, seed, None).result for seed in seeds]
        rates.append(sum(r is not None and bool(r.success) for r in results) / len(results))
    return min(rates), max(rates)


def _range(cause: str, rates: tuple[float, float], paper: tuple[float, float]) -> Range:
    low, high = min(rates), max(rates)
    return Range(cause, low, high, low <= paper[1] and high >= paper[0])


def _moved(config: LiftConfig, seed: int) -> dict[str, bool]:
    begun = at_lift(config, seed)
    onset_ns = find_onset(begun)
    answer = answered(config, seed)
    names = ("as it is", "no reaction time", "slow reaction", "quick detection", "slow detection")
    if onset_ns is None or answer is None:
        return dict.fromkeys(names, False)
    sent_ns, command, registered_ns = answer
    late_ns = max(0, registered_ns - onset_ns)
    path_ns = round(config.hand.command_latency_s * 1e9) + sent_ns - registered_ns
    shortest, longest = (round(s * 1e9) - path_ns for s in REACTION_RANGE_S)
    quick, slow = (round(late_ns * (factor - 1)) for factor in DETECTION_FACTORS)
    shifts = (0, shortest, longest, quick, slow)
    return {
        key: react(config, begun, sent_ns + shift, command).success
        for key, shift in zip(names, shifts, strict=True)
    }
