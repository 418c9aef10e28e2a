"""From which moment a fault could be told from what is normal: delays are counted from there."""

import math
from itertools import pairwise

from grasp.doubt_settings import DoubtSettings
from grasp.fingertip_doubt import at_rail
from grasp.loop import Tick
from grasp.phases import Phase
from tests.unit.scenarios.conftest import Staged

MS = 1e6
SETTINGS = DoubtSettings()
# What is normal, and looks like a fault as long as it lasts.
# An unloaded fingertip repeats itself so often (the quietest real one: 0.21 counts), and one that
# is loaded (confusers, 1.3 hours of three fingertips: ten and eleven times, once each); all three
# did so up to six times there
QUIET_SAMPLES, LOADED_SAMPLES, ALL_SAMPLES = 42, 11, 6
# Latency up to 0.15 s (hand.command_latency_s), two refreshes, lag, first count
STARTS_NS = 235 * MS
# A count at least speed, from stall to reported contact, two refreshes
GOES_ON_NS = 85 * MS


def since_ns(staged: Staged, name: str) -> float:
    """When the fault of this name could be seen first."""
    assert staged.done_at_ns is not None
    ticks = [t for t in staged.ticks if t.t_ns >= staged.done_at_ns]
    began = {
        "fingertips_frozen": lambda ticks: ticks[0].t_ns + ALL_SAMPLES * 10 * MS,
        "fingertip_dead": _dead, "gripper_silent": _silent, "gripper_stands": _stands,
        "arm_wrong_way": _strayed, "arm_frozen": _froze,
        "loop_stood_still": lambda ticks: ticks[1].t_ns,
        "detector_late": lambda ticks: ticks[1].t_ns,
    }  # fmt: skip
    return float(began.get(name, lambda ticks: ticks[0].t_ns)(ticks))


def delay_ms(staged: Staged, name: str) -> float:
    """From that moment to the step that answers."""
    end_ns = next(t.t_ns for t in staged.ticks if t.decision.phase is Phase.FAULT)
    return (end_ns - since_ns(staged, name)) / MS


def _dead(ticks: list[Tick]) -> float:
    """The thumb's, which repeats itself for a while by chance."""
    frame = ticks[1].frame
    assert frame is not None
    live = ~at_rail(frame.raw[0]) & (abs(frame.counts[0]) >= SETTINGS.loaded_counts)
    quiet = LOADED_SAMPLES if live.any() else QUIET_SAMPLES
    return ticks[0].t_ns + quiet * 10 * MS


def _silent(ticks: list[Tick]) -> float:
    """An echo has a deadline of its own."""
    last_ns = next(a.t_ns for a, b in pairwise(ticks) if not b.gripper.fresh)
    return last_ns + SETTINGS.echo_s * 1e9


def _stands(ticks: list[Tick]) -> float:
    """From the last count, or from the request, whichever the hand stood still from."""
    last = ticks[-1].gripper.positions
    stood = next(t.t_ns for t in ticks if t.gripper.positions == last)
    under_way = stood > ticks[0].t_ns or ticks[0].gripper.positions != last
    return stood + (GOES_ON_NS if under_way else STARTS_NS)


def _froze(ticks: list[Tick]) -> float:
    """An arm that stood when it was told to move takes a while to begin."""
    stood = not ticks[0].arm.moving
    return ticks[0].t_ns + (SETTINGS.arm_start_s * 1e9 if stood else 0.0)


def _strayed(ticks: list[Tick]) -> float:
    """The arm is somewhere that it was not told to be, by as little as counts as motion."""
    x0, y0, z0 = ticks[0].arm.position_m

    def off(tick: Tick) -> bool:
        x, y, z = tick.arm.position_m
        down = tick.decision.phase is not Phase.LOWER and z0 - z
        return max(math.hypot(x - x0, y - y0), down) > SETTINGS.arm_moved_m

    return next(t.t_ns for t in ticks if off(t))
