"""Compensate and hold must not take turns: the default is in the clean region, and force rises
only so far."""

import itertools

import msgspec
import pytest

from scenarios.studies.reaction.hunting import (
    LOOSENING,
    RATCHET,
    REGRASP,
    HuntingSettings,
    bound,
    default_loop,
    hunt,
    hunting_map,
)
from tests.unit.scenarios.conftest import changed, config

CLOSINGS_S = (0.02, 0.05, 0.3)  # rigid at full speed, rigid, foam at the slowest speed
TRANSIENTS_S = (0.03, 0.07, 0.1)  # assumed range


@pytest.mark.parametrize("transient_s", TRANSIENTS_S)
@pytest.mark.parametrize("closing_s", CLOSINGS_S)
def test_the_default_answers_a_slip_once(closing_s: float, transient_s: float) -> None:
    assert hunt(default_loop(config(), closing_s, transient_s)) == 1


@pytest.mark.parametrize("transient_s", TRANSIENTS_S)
@pytest.mark.parametrize("closing_s", CLOSINGS_S)
def test_its_timing_alone_keeps_it_clean_even_in_small_steps(
    closing_s: float, transient_s: float
) -> None:
    loop = default_loop(config(), closing_s, transient_s)
    small = msgspec.structs.replace(loop, step_n=0.5, needed_force_n=2.5)
    assert hunt(small) == 1


def test_a_mask_shorter_than_our_own_transient_would_hunt() -> None:
    short = changed(config(), "slip", mask_after_closing_s=0.09)
    loop = default_loop(short, closing_s=0.02, transient_s=0.1)
    small = msgspec.structs.replace(loop, step_n=0.5, needed_force_n=2.5)
    assert hunt(small) > 5


def test_a_hand_that_only_tightens_is_bounded_everywhere() -> None:
    grid = [0.01 * k for k in range(0, 41, 2)]
    worst = 0
    for step_n, hold_s in itertools.product((0.5, 1.0, 2.0, 8.0), (0.03, 0.1)):
        m = hunting_map(RATCHET, step_n, hold_s, grid[:11], grid)
        assert m.bound is not None and m.compensations.max() <= m.bound
        worst = max(worst, int(m.compensations.max()))
    assert worst > 5  # the map does reach where it hunts


@pytest.mark.parametrize("policy", [LOOSENING, REGRASP])
def test_giving_force_back_takes_the_bound_away(policy: int) -> None:
    longer = 0
    for horizon_s in (6.0, 24.0):
        loop = HuntingSettings(
            latency_s=0.1, refractory_s=0.2, hold_s=0.03, step_n=8.0, horizon_s=horizon_s,
            loosening_nps=2.0 if policy == LOOSENING else 0.0, regrasp=policy == REGRASP,
        )  # fmt: skip
        found = hunt(loop)
        assert found > 2 * longer
        assert found > bound(loop)
        longer = found
