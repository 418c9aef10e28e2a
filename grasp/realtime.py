"""Keeps the system's scheduler and Python's garbage collector from delaying a loop in wall time."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

THREADS = Path("/proc/self/task")
PRIORITY = 20  # over ordinary programs, under the kernel's own interrupt threads


class RealTimeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a run in wall time asks of the machine; in virtual time it asks for nothing."""

    priority: Annotated[
        int,
        Meta(ge=0, le=90, description="SCHED_FIFO priority of this program's threads while it "
             "runs, 0 to leave them alone; not granted: the run goes on without, and says so"),
    ] = PRIORITY  # fmt: skip


@contextmanager
def real_time(settings: RealTimeSettings) -> Iterator[bool]:
    """While inside, the threads that this process now has run before all ordinary ones, and no
    cycles are collected. Gives whether the priority was granted; afterwards all is as before.

    Threads and processes begun inside are ordinary ones.
    """
    before = _raise_threads(settings.priority) if settings.priority else {}
    collecting = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield bool(before)
    finally:
        gc.unfreeze()
        if collecting:
            gc.enable()
        for thread, (policy, parameters) in before.items():
            _schedule(thread, policy, parameters)


def _raise_threads(priority: int) -> dict[int, tuple[int, os.sched_param]]:
    """Former policies of the threads raised; empty where the system refuses or knows no FIFO."""
    if not hasattr(os, "SCHED_FIFO"):
        return {}
    wanted = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority)
    raised = {}
    for thread in (int(entry.name) for entry in THREADS.iterdir()):
        before = os.sched_getscheduler(thread), os.sched_getparam(thread)
        if _schedule(thread, *wanted):
            raised[thread] = before
    return raised


def _schedule(thread: int, policy: int, parameters: os.sched_param) -> bool:
    try:
        os.sched_setscheduler(thread, policy, parameters)
    except (PermissionError, ProcessLookupError):  # not allowed; ended meanwhile
        return False
    return True
