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


def test_a_client_alone_has_the_whole_part_and_of_two_each_the_half() -> None:
    """Served as often as it may be for two seconds, so much of the time has been used."""
    for clients, share in ((["a"], 0.4), (["a", "b"], 0.2)):
        shares: Shares[str] = Shares(0.4)
        used = dict.fromkeys(clients, 0.0)
        for cycle in range(2000):
            now_s = cycle * 0.001
            for client in clients:
                if not shares.wait_s(client, now_s):
                    shares.charge(client, 0.001, now_s)
                    used[client] += 0.001
        assert all(spent / 2.0 == pytest.approx(share, rel=0.15) for spent in used.values())


def test_who_waited_long_enough_is_served_and_who_left_is_forgotten() -> None:
    shares: Shares[str] = Shares(0.5)
    shares.charge("a", 1.0, 0.0)
    wait_s = shares.wait_s("a", 0.0)
    assert wait_s == pytest.approx(2.0, abs=0.05)
    assert shares.wait_s("a", wait_s) == pytest.approx(0.0, abs=0.02)
    shares.forget("a")
    assert shares.wait_s("a", 0.0) == 0.0


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


def test_a_budget_without_a_part_never_ends() -> None:
    budget = Budget()
    budget.begin(0.001)
    busy(0.005)
    assert not budget.spent()


def test_work_goes_on_in_slices_only_while_it_is_told_to() -> None:
    passes = []

    def work(breathe) -> str:
        for number in range(2000):
            passes.append(number)
            busy(0.00002)
            breathe()
        return "done"

    slowly = Slowly(work)
    assert not passes
    slices = 0
    while not slowly.go_on(0.002):
        slices += 1
        before = len(passes)
        time.sleep(0.002)
        assert len(passes) == before
    assert slices > 3
    assert slowly.result() == "done"
    assert not slowly.go_on(0.0)


def test_the_processors_clock_is_not_read_at_every_call(monkeypatch: pytest.MonkeyPatch) -> None:
    reads = []

    def work(breathe) -> None:
        reads.clear()
        for _ in range(1600):
            breathe()

    slowly = Slowly(work)
    now_s = time.thread_time
    monkeypatch.setattr(time, "thread_time", lambda: reads.append(0) or now_s())
    assert slowly.go_on(60.0)
    assert len(reads) <= 102


@pytest.mark.parametrize("part", [0.5, float("inf")])
def test_what_another_thread_works_is_taken_from_the_budget_that_it_works_for(part) -> None:
    def work(breathe) -> None:
        busy(0.01)
        breathe()

    budget, slowly = Budget(part), Slowly(work)
    budget.begin(0.01)
    assert slowly.go_on(budget.left_s)
    assert 0.01 <= slowly.worked_s < 10.0
    budget.use(slowly.worked_s)
    assert budget.spent() == (part == 0.5)
    slowly.go_on(0.0)
    assert slowly.worked_s == 0.0


def test_an_error_of_the_work_belongs_to_who_asks_for_its_result() -> None:
    def work(breathe) -> None:
        raise KeyError("here")

    slowly = Slowly(work)
    assert slowly.go_on(1.0)
    with pytest.raises(KeyError, match="here"):
        slowly.result()


def test_cancelled_work_leaves_no_thread() -> None:
    def work(breathe) -> None:
        while True:
            breathe()

    slowly = Slowly(work)
    slowly.go_on(0.001)
    assert {t.daemon for t in threading.enumerate() if t.name == "slowly"} == {True}  # or we hang
    slowly.cancel()
    assert "slowly" not in {thread.name for thread in threading.enumerate()}


def test_budget_is_worked_off_in_slices() -> None:
    budget = Budget(0.5)
    budget.begin(20.0)
    budget.slice(0.01)
    assert budget.left_s <= 0.01
    assert not budget.spent()
    busy(0.01)
    assert budget.spent() and not budget.over()
    budget.slice(60.0)
    assert 9.0 < budget.left_s < 10.0
    budget.use(10.0)
    assert budget.spent() and budget.over()
    budget.end()
    budget.begin(0.0)
    budget.slice(1.0)
    assert budget.spent()


def test_some_of_a_budget_that_was_not_needed_is_left_for_later() -> None:
    """A program that needs little on the whole is not torn where it needs more for once."""
    budget = Budget(0.2)
    for _ in range(100):
        budget.begin(0.01)
        budget.end()
    budget.begin(0.002)
    assert 0.004 < budget.left_s < 0.006
