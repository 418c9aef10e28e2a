"""Shares of time, places, budgets and slices of work, with times that the test says."""

import threading
import time

import pytest

from drivers.fairness import IDLE_S, Allowance, Budget, Places, Shares, Slowly


def test_who_asks_for_little_never_waits_beside_one_who_floods() -> None:
    shares: Shares[str] = Shares(0.4)
    now_s = 0.0
    for cycle in range(200):
        now_s = cycle * 0.01
        shares.charge("flood", 0.005, now_s)
        shares.charge("polite", 0.0005, now_s)
        assert shares.wait_s("polite", now_s) == 0.0
    assert shares.wait_s("flood", now_s) > 1.0


def test_who_may_have_more_at_once_waits_later_and_who_used_less_goes_first() -> None:
    """0.2 of the time: a burst of two seconds is 0.4 s of work."""
    shares: Shares[str] = Shares(0.2, burst_s=2.0)
    shares.charge("a", 0.39, 0.0)
    assert shares.wait_s("a", 0.0) == 0.0
    shares.charge("a", 0.21, 0.0)
    assert shares.wait_s("a", 0.0) == pytest.approx(1.0)
    assert shares.used_s("a", 0.0) == pytest.approx(0.6)
    assert shares.used_s("a", 1.0) == pytest.approx(0.4)
    assert shares.used_s("b", 0.0) == 0.0


def test_more_is_begun_once_what_was_used_has_leaked_away() -> None:
    allowance = Allowance(0.1, at_once_s=0.5, longest_s=2.0)
    assert allowance.wait_s == 0.0
    allowance.use(0.6)
    assert allowance.wait_s == pytest.approx(1.0)
    allowance.elapse(0.4)
    assert allowance.wait_s == pytest.approx(0.6)
    allowance.elapse(0.7)
    assert allowance.wait_s == 0.0
    allowance.use(1000.0)
    assert allowance.wait_s == pytest.approx(2.0)
    allowance.elapse(1e9)
    allowance.use(0.5)
    assert allowance.wait_s == 0.0


def test_places_are_given_to_newcomers_once_somebody_is_silent() -> None:
    places: Places[str] = Places(2)
    assert places.enter("a", 0.0) is None
    assert places.enter("b", 0.0) is None
    with pytest.raises(OverflowError, match="too many connections: 2 are open"):
        places.enter("c", IDLE_S - 0.1)
    places.heard("a", 1.0)
    assert places.enter("c", IDLE_S) == "b"
    places.leave("a")
    assert places.enter("d", IDLE_S) is None


def busy(seconds: float) -> None:
    """Of this thread's processor time."""
    until_s = time.thread_time() + seconds
    while time.thread_time() < until_s:
        pass


def test_what_a_budget_is_overdrawn_by_is_paid_back() -> None:
    budget = Budget(0.5)
    budget.begin(0.02)
    assert not budget.spent()
    busy(0.03)
    assert budget.spent()
    budget.end()
    budget.begin(0.02)
    assert budget.spent()  # 20 ms behind, 10 ms granted
    budget.end()
    budget.begin(0.05)
    assert not budget.spent()


def test_cancelled_work_leaves_no_thread() -> None:
    def work(breathe) -> None:
        while True:
            breathe()

    slowly = Slowly(work)
    slowly.go_on(0.001)
    assert {t.daemon for t in threading.enumerate() if t.name == "slowly"} == {True}  # or we hang
    slowly.cancel()
    assert "slowly" not in {thread.name for thread in threading.enumerate()}
