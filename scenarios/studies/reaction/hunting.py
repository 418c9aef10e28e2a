"""Where the loop itself fails: compensate and hold taking turns, on a reduced controller.

The hand latches and holds by itself, so its force only rises: nothing can swing for ever. What can
still take turns is the *status*: our own closing shakes the pads, a detector hears that as slip,
and each false slip adds one more step of force. Two other policies, which this controller does not
have, are mapped beside it: one that loosens the grip slowly, one that regrasps at the cap.

Time and force alone are kept: no contact, no object but the force that it needs.
"""

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numba import njit
from numpy.typing import NDArray

from drivers.robotiq.model.hand import HandSettings
from scenarios.trial.config import TrialConfig

RATCHET, LOOSENING, REGRASP = range(3)
POLICIES = ("own transients", "loosening", "regrasp")


class HuntingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One reduced loop. ``refractory_s`` runs from one command to the next."""

    latency_s: Annotated[float, Meta(ge=0, le=1, description="command to rise of force")]
    refractory_s: Annotated[float, Meta(ge=0, le=2, description="between two commands")]
    hold_s: Annotated[
        float, Meta(ge=0, le=2, description="status nominal for so long ends a compensation")
    ]
    step_n: Annotated[float, Meta(gt=0, le=60, description="force added by a command")]
    detector_s: Annotated[
        float, Meta(ge=0, le=1, description="slip to registered slip; assumed, 20-300 ms")
    ] = 0.06
    transient_s: Annotated[
        float,
        Meta(ge=0, le=1, description="own closing reads as slip for so long; assumed, 30-100 ms"),
    ] = 0.1
    loosening_nps: Annotated[
        float, Meta(ge=0, le=20, description="force given up while holding, N/s")
    ] = 0.0
    regrasp: Annotated[bool, Meta(description="open and close when the cap is reached")] = False
    first_force_n: Annotated[float, Meta(ge=0, le=60)] = 2.0
    needed_force_n: Annotated[float, Meta(ge=0, le=60, description="below it the object slips")] = (
        6.0
    )
    cap_n: Annotated[float, Meta(gt=0, le=60)] = 10.0
    horizon_s: Annotated[float, Meta(gt=0, le=60)] = 6.0


def bound(settings: HuntingSettings) -> int:
    """Most compensations that a hand which only tightens can make: the steps from first force to
    cap, and one in which nothing moves any more."""
    s = settings
    return math.ceil((s.cap_n - s.first_force_n) / s.step_n) + 1


def hunt(settings: HuntingSettings) -> int:
    """Compensations of the reduced loop, transitions from hold to compensate: one is what a slip
    deserves."""
    s = settings
    return int(_hunt(
        s.latency_s, s.refractory_s, s.hold_s, s.step_n, s.detector_s, s.transient_s,
        s.loosening_nps, s.regrasp, s.first_force_n, s.needed_force_n, s.cap_n, s.horizon_s,
    ))  # fmt: skip


_STEP_S = 0.005
_REGRASP_S = 0.05


@njit(cache=True)
def _hunt(
    latency: float, refractory: float, hold: float, step: float, detector: float, transient: float,
    loosening: float, regrasp: bool, first: float, needed: float, cap: float, horizon: float,
) -> int:  # fmt: skip
    steps = round(horizon / _STEP_S)
    delay = round(detector / _STEP_S)
    slipping = np.zeros(steps + 1, dtype=np.bool_)
    force, target = first, first
    rise_at, shaken_until, open_until = -1.0, -1.0, -1.0
    last_command, last_seen = -1e9, -1e9
    compensating, compensations = False, 0
    for i in range(steps):
        t = i * _STEP_S
        if rise_at >= 0.0 and t >= rise_at:
            if regrasp and force >= cap:
                open_until = t + _REGRASP_S
                shaken_until = open_until + transient
            elif target > force:
                shaken_until = t + transient
                force = target
            rise_at = -1.0
        slipping[i] = force < needed or t < open_until or t < shaken_until
        seen = i >= delay and slipping[i - delay]
        if seen:
            last_seen = t
        if seen and t - last_command >= refractory:
            if not compensating:
                compensations += 1
                compensating = True
            last_command = t
            target = min(cap, force + step)
            rise_at = t + latency
        elif compensating and t - max(last_seen, last_command) >= hold:
            compensating = False
        if not compensating and loosening > 0.0 and compensations > 0:
            force = max(0.0, force - loosening * _STEP_S)
    return compensations


def default_loop(config: TrialConfig, closing_s: float, transient_s: float) -> HuntingSettings:
    """The reduced loop of a configuration whose fingers close for so long.

    Commands are masked from one closing to ``mask_after_closing_s`` after its end, and the cap is
    asked for at once.
    """
    hand: HandSettings = config.hand
    latency_s = config.loop.decision_delay_s + 0.5 / hand.refresh_hz + hand.command_latency_s
    return HuntingSettings(
        latency_s=latency_s,
        refractory_s=latency_s + closing_s + config.slip.mask_after_closing_s,
        hold_s=config.rule.release * config.loop.period_s,
        step_n=config.guard.force_limit_n,
        transient_s=transient_s,
        cap_n=config.guard.force_limit_n,
    )


class HuntingMap(msgspec.Struct, frozen=True):
    """Compensations over latency (rows) and refractory time (columns)."""

    policy: str
    step_n: float
    hold_s: float
    latencies_s: list[float]
    refractories_s: list[float]
    compensations: NDArray[np.int64]  # (latencies, refractories)
    bound: int | None  # None: the policy gives force back, so there is none


def hunting_map(
    policy: int, step_n: float, hold_s: float, latencies_s: Sequence[float],
    refractories_s: Sequence[float],
) -> HuntingMap:  # fmt: skip
    """One panel of the map."""
    loosening = 2.0 if policy == LOOSENING else 0.0
    loops = [
        [
            HuntingSettings(
                latency_s=latency, refractory_s=refractory, hold_s=hold_s, step_n=step_n,
                loosening_nps=loosening, regrasp=policy == REGRASP,
            )
            for refractory in refractories_s
        ]
        for latency in latencies_s
    ]  # fmt: skip
    counts = np.array([[hunt(loop) for loop in row] for row in loops])
    most = bound(loops[0][0]) if policy == RATCHET else None
    return HuntingMap(
        POLICIES[policy], step_n, hold_s, list(latencies_s), list(refractories_s), counts, most
    )
