"""Compensate and hold must not take turns: the default loop does not, and force is bounded."""

import msgspec

from studies.hunting import LOOSENING, RATCHET, Loop, Task, bound, default_loop, hunt, trial
from tests.unit.scenarios.conftest import changed, config


def test_default_controller_compensates_once_per_slip_also_in_small_steps() -> None:
    for transient_s in [0.03, 0.07, 0.1]:
        for closing_s in [0.02, 0.05, 0.3]:
            loop = default_loop(config(), closing_s, transient_s)
            assert hunt(loop) == 1, (transient_s, closing_s)
            assert hunt(msgspec.structs.replace(loop, step_n=0.5, needed_n=2.5)) == 1, (
                transient_s,
                closing_s,
            )


def test_a_mask_shorter_than_the_transient_would_hunt() -> None:
    short = changed(config(), "slip", mask_after_closing_s=0.09)
    loop = default_loop(short, closing_s=0.02, transient_s=0.1)
    assert hunt(msgspec.structs.replace(loop, step_n=0.5, needed_n=2.5)) > 5


def test_a_hand_that_only_tightens_is_bounded_and_one_that_loosens_is_not() -> None:
    row = trial(Task(RATCHET, 0.5, 0.03))
    assert row.bound is not None and 5 < row.most <= row.bound
    assert trial(Task(LOOSENING, 0.5, 0.03)).bound is None
    loop = Loop(latency_s=0.1, refractory_s=0.2, hold_s=0.03, step_n=8.0, loosening_nps=2.0)
    assert hunt(loop) > bound(loop)
