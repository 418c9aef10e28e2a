import gc
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from grasp.run.realtime import RealTimeSettings, real_time


def policy() -> int:
    return os.sched_getscheduler(threading.get_native_id())


@contextmanager
def another_thread() -> Iterator[int]:
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    assert thread.native_id is not None
    try:
        yield thread.native_id
    finally:
        end.set()
        thread.join()


def test_every_thread_gets_priority_and_later_its_former_policy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[tuple[int, int, int]] = []
    monkeypatch.setattr(
        os, "sched_setscheduler",
        lambda thread, policy, of: calls.append((thread, policy, of.sched_priority)),
    )  # fmt: skip
    with another_thread() as other:
        before = policy()
        with real_time(RealTimeSettings(priority=7)) as granted:
            assert granted
            raised = {thread for thread, _, _ in calls}
            assert {threading.get_native_id(), other} <= raised
            assert {of[1:] for of in calls} == {(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 7)}
            calls.clear()
        assert {thread for thread, _, _ in calls} == raised
        assert (threading.get_native_id(), before, 0) in calls


def test_a_refused_priority_is_reported_and_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with real_time(RealTimeSettings()) as granted:
        assert not granted
        assert not gc.isenabled()
    assert gc.isenabled()
