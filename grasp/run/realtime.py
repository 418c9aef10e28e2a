"""Real-time priority for a loop in wall time, and no garbage collection while it runs."""

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

THREADS = Path("/proc/self/task")
PRIORITY = 20  # above ordinary programs, below the kernel's interrupt threads


class RealTimeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Scheduling of a run in wall time."""

    priority: Annotated[
        int, Meta(ge=0, le=90, description="SCHED_FIFO; 0: none; if refused, the run continues")
    ] = PRIORITY


@contextmanager
def real_time(settings: RealTimeSettings) -> Iterator[bool]:
    """Within, the existing threads of this process run before all ordinary ones, and no garbage is
    collected. Later threads and processes are ordinary. Yields whether the priority was granted.
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
    """Raise the priority of all threads; returns their former policies, none where it failed."""
    if not hasattr(os, "SCHED_FIFO"):
        return {}
    policy, raised = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, {}
    for thread in (int(entry.name) for entry in THREADS.iterdir()):
        before = os.sched_getscheduler(thread), os.sched_getparam(thread)
        if _schedule(thread, policy, os.sched_param(priority)):
            raised[thread] = before
    return raised


def _schedule(thread: int, policy: int, parameters: os.sched_param) -> bool:
    try:
        os.sched_setscheduler(thread, policy, parameters)
    except (PermissionError, ProcessLookupError):  # not allowed; the thread has ended
        return False
    return True
