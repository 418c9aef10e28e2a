"""Probes of the effect of a setting on a verdict, or on a pressing fingertip."""

from typing import Any

import msgspec
import numpy as np

from scenarios.acquire.press import PressController, PressControlSettings, PressPhase
from scenarios.lift.scoring import LiftFacts, LiftOutcome, outcome
from scenarios.tap.scoring import Alarm, ObjectMotion, TapFacts, TapOutcome, verdict
from scenarios.world.truth import Truth
from tests.unit.grasp.builders import arm
from tests.unit.scenarios.conftest import config

ZERO = (0.0, 0.0, 0.0)


# Acquisition


# Verdicts


HELD = Truth(
    t_ns=0, height_m=0.2, speed_mps=0.0, slip_distance_m=0.02, slip_speed_mps=0.0,
    normal_n=(10.0, 5.0, 5.0), shear_n=ZERO, peak_n=(10.0, 5.0, 5.0), slip_onset_s=1.0,
    force_rise_s=1.1, flank_slope=0.0,
)  # fmt: skip
FACTS = LiftFacts(
    end=HELD, estimated_n=5.0, had_compensated=True, registered_s=1.1, onset_s=1.0,
    open_loop_onset_s=1.0, peak_force_n=10.0, force_bound_n=11.0,
    limit_reached=False, alarm_stayed=False, fault="",
)  # fmt: skip


def lift_verdict(
    end: dict[str, float] | None, crush_n: float | None = None, **facts: Any
) -> LiftOutcome:
    """Verdict of a held long object with changed facts; ``end`` None: no simulation."""
    truth = None if end is None else msgspec.structs.replace(HELD, **end)
    changed = msgspec.structs.replace(FACTS, end=truth, **facts)
    body = msgspec.structs.replace(config().object, long_body=True, crush_n=crush_n)
    return outcome(changed, body)


MOVED = ObjectMotion(impact_s=9.99, from_s=10.0, until_s=10.02, displacement_m=0.006)


def tap_verdict(
    alarms: list[Alarm],
    moved_m: float = 0.006,
    turned_rad: float | None = None,
) -> TapOutcome:
    motion = msgspec.structs.replace(MOVED, displacement_m=moved_m, turned_rad=turned_rad)
    facts = TapFacts(
        motion=motion, alarms=alarms, watched_until_s=30.0, peak_before_n=10.5, force_bound_n=11.0
    )
    return verdict(facts)


# A pressing fingertip


def presser(**settings: Any) -> PressController:
    made = PressControlSettings(**settings)
    return PressController(made, 100.0, None, np.random.default_rng(0))


def pressing_mps(pressed_n: float, below_m: float = 0.0, **settings: Any) -> float:
    """Downward speed at a estimated force, ``below_m`` below first contact, at 100 counts per N."""
    p = presser(**settings)
    p.step(0.0, np.array([-1000] + [0] * 5, dtype=np.int16), arm())
    counts = np.array([round(-100 * pressed_n)] + [0] * 5, dtype=np.int16)
    p.step(0.01, counts, arm(height_m=-below_m))
    return -p.step(0.02, counts, arm(height_m=-below_m)).velocity_mps[2]


def touched(value: float, pressed_n: float) -> bool:
    p = presser(touch_n=value)
    p.step(0.0, np.array([round(-100 * pressed_n)] + [0] * 5, dtype=np.int16), arm())
    return p.phase is not PressPhase.APPROACH
