"""Workers: results do not depend on their number; effects of dying and failing tasks."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, Mock

import pytest

from drivers.errors import GraspError, LinkLost, UsageError
from scenarios.rigs import workers
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


class Waits:
    """Virtual time of ``wait``: nothing ends before ``end`` is called at a time, s."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.t_s = 0.0
        self.at: dict[float, Callable[[Any], object]] = {}
        monkeypatch.setattr(workers, "wait", self._wait)

    def _wait(self, futures: Any, timeout_s: float, _: str) -> SimpleNamespace:
        self.t_s += timeout_s
        if act := self.at.get(self.t_s):
            act(futures)
        return SimpleNamespace(done={future for future in futures if future.done()})


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> Waits:
    return Waits(monkeypatch)


def hang(_: int) -> bool:
    return threading.Event().wait()


def test_a_caller_may_end_workers_that_give_no_result(waits: Waits) -> None:
    def quiet(silent_s: float) -> None:
        if silent_s >= 30.0:
            raise UsageError(f"nothing for {silent_s:g} s", "")

    with pytest.raises(UsageError, match="nothing for 30 s"):
        list(results(hang, [0], Workers(1), quiet))  # the leak fixture checks that it has ended
    assert waits.t_s == 30.0


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """The client of a cluster with a worker of two threads, whose tasks never end."""
    client = MagicMock()
    client.__enter__.return_value = client
    client.nthreads.return_value = {"one": 2}
    client.run = lambda function, on_error: {"one": function()}
    client.get_executor.return_value.submit = lambda *_: Future()
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=lambda *_, **__: client))
    return client


def on_cluster() -> list[int]:
    return list(results(squared, range(3), Workers(1, "tcp://there:1")))


def test_a_cluster_that_has_no_workers_for_a_minute_ends_the_work(
    waits: Waits, dask: MagicMock
) -> None:
    def leave(_: object) -> None:
        dask.nthreads.return_value = {}

    def come(_: object) -> None:
        dask.nthreads.return_value = {"one": 2}

    waits.at = {20.0: leave, 70.0: come, 200.0: leave}
    with pytest.raises(LinkLost, match="tcp://there:1 has had no workers for 60 s") as caught:
        on_cluster()
    assert waits.t_s == 250.0  # of busy workers no result is expected
    assert "--resume" in caught.value.remedy


def test_workers_that_came_back_finish_the_work(waits: Waits, dask: MagicMock) -> None:
    dask.nthreads.side_effect = [{"one": 2}, *[{}] * 5, {"one": 2}, *[{}] * 5]

    def finish(futures: Any) -> None:
        for future in futures:
            future.set_result(9)

    waits.at = {120.0: finish}
    assert on_cluster() == [9, 9, 9]


@pytest.mark.parametrize("theirs", ["Python 3.12, numba 0.1", ImportError("no module 'scenarios'")])
def test_a_cluster_with_other_versions_gets_no_task(theirs: object, dask: MagicMock) -> None:
    dask.run = lambda function, on_error: {"one": function(), "two": theirs}
    with pytest.raises(UsageError, match=r"other versions than this process: \{'two'") as caught:
        on_cluster()
    assert repr(theirs)[:20] in caught.value.message and "Python 3." in caught.value.remedy
    assert not dask.get_executor.called


def test_a_scheduler_that_ends_while_its_workers_are_asked_for_is_named(
    waits: Waits, dask: MagicMock
) -> None:
    dask.nthreads.side_effect = [{"one": 2}, OSError("closed")]
    with pytest.raises(LinkLost, match="the Dask scheduler at tcp://there:1 is gone"):
        on_cluster()
