"""Workers: results do not depend on their number; effects of dying and failing tasks."""

import os
import signal
from contextlib import closing
from unittest.mock import Mock

import pytest

from drivers.errors import GraspError, UsageError
from scenarios.rigs.workers import ONE_THREAD, Outcome, Workers, outcomes, results


def squared(number: int) -> int:
    return number * number


@pytest.mark.parametrize("processes", [0, 1, 2])
def test_results_are_the_same_from_any_number_of_workers(processes: int) -> None:
    assert sorted(results(squared, range(5), Workers(processes))) == [0, 1, 4, 9, 16]


def test_only_the_task_that_kills_its_worker_is_lost() -> None:
    def work(number: int) -> int:
        if number == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    found: list[Outcome[int, int]] = list(outcomes(work, range(4), Workers(2)))
    assert sorted(o.result for o in found if o.result is not None) == [0, 2, 3]
    (died,) = [o.error for o in found if o.error is not None]
    assert isinstance(died, GraspError) and died.message == "the worker process died"


def test_workers_have_one_thread_and_leave_ctrl_c_to_their_parent() -> None:
    def environment(_: int) -> tuple[bool, bool]:
        limits = {name: os.environ.get(name) for name in ONE_THREAD}
        return limits == ONE_THREAD, signal.getsignal(signal.SIGINT) is signal.SIG_IGN

    assert list(results(environment, [0], Workers(1))) == [(True, True)]


def test_closing_the_results_ends_the_workers() -> None:
    with closing(results(squared, range(1000), Workers(2))) as found:
        next(found)  # the leak fixture checks that no process remains


def test_one_worker_runs_here_without_shared_memory_and_several_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("multiprocessing.Lock", Mock(side_effect=OSError(30, "Read-only")))
    assert list(results(lambda task: os.getpid(), [0], Workers(1))) == [os.getpid()]
    with pytest.raises(UsageError, match=r"/dev/shm: Read-only"):
        list(results(lambda task: 0, [0], Workers(2)))
