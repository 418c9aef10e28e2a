"""Parallel execution of tasks: in worker processes of this machine or on a Dask cluster.

Results come in the order of completion; their values depend only on the tasks.
"""

import gc
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import closing, contextmanager
from typing import Generic, TypeVar, cast

import msgspec

from drivers.errors import GraspError, LinkLost, UsageError, on_failure
from grasp import signals

T = TypeVar("T")
R = TypeVar("R")
AHEAD = 2  # tasks in flight per worker, so that no worker waits for the parent's disk
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
FOR_THE_PARENT = (signal.SIGINT, signal.SIGHUP)
PARENT_POLL_S = 0.5
GC_OBJECTS = 20_000  # a trial leaves few cycles: less frequent collection saves a tenth of the time
CONNECT_S = 10.0


class Workers(msgspec.Struct, frozen=True):
    """Number and location of the workers."""

    processes: int  # single-threaded worker processes; 0: this process
    cluster: str | None = None  # address of a Dask scheduler, used instead


class Outcome(msgspec.Struct, Generic[T, R], frozen=True):
    """Result or error of one task."""

    task: T
    result: R | None = None
    error: BaseException | None = None


def results(
    work: Callable[[T], R], tasks: Sequence[T], workers: Workers
) -> Generator[R, None, None]:
    """Results in order of completion; the first error ends the other tasks and is raised."""
    with closing(outcomes(work, tasks, workers)) as found:
        for outcome in found:
            if outcome.error is not None:
                raise outcome.error
            yield cast(R, outcome.result)


def outcomes(
    work: Callable[[T], R], tasks: Sequence[T], workers: Workers
) -> Generator[Outcome[T, R], None, None]:
    """Outcomes in order of completion; closing the generator or Ctrl-C ends all workers.

    Raises UsageError without Dask or shared memory, LinkLost if the scheduler cannot be reached or
    is lost.
    """
    if not tasks:
        return
    if workers.cluster is not None:
        yield from _cluster(work, tasks, workers.cluster)
    elif (no_semaphores := _why_no_semaphores()) and workers.processes > 1:
        raise UsageError(
            f"worker processes need shared memory: /dev/shm: {no_semaphores}",
            "make /dev/shm writable or use --jobs 1",
        )
    elif workers.processes == 0 or no_semaphores:
        yield from (_run_task(work, task) for task in tasks)
    else:
        yield from _processes(work, tasks, min(workers.processes, len(tasks)))


def _why_no_semaphores() -> str | None:
    try:
        multiprocessing.Lock()
    except OSError as error:
        return error.strerror
    return None


def _run_task(work: Callable[[T], R], task: T) -> Outcome[T, R]:
    try:
        result = work(task)
    except Exception as error:
        return Outcome(task, error=error)
    signals.raise_if_received()
    return Outcome(task, result)


def _processes(
    work: Callable[[T], R], tasks: Sequence[T], processes: int
) -> Iterator[Outcome[T, R]]:
    """A worker that dies breaks its pool, and which task caused it is unknown. The tasks in flight
    run again one at a time; the one whose worker dies again gets the error."""
    died = GraspError("the worker process died", "if memory ran out, use fewer --jobs")
    waiting = deque(tasks)
    while waiting:
        suspects: list[T] = []
        with _pool(processes) as executor:
            for outcome in _drain(executor, waiting, AHEAD * processes, work):
                if isinstance(outcome.error, BrokenExecutor):
                    suspects.append(outcome.task)
                else:
                    yield outcome
        for task in suspects:
            with _pool(1) as executor:
                for outcome in _drain(executor, deque([task]), 1, work):
                    broken = isinstance(outcome.error, BrokenExecutor)
                    yield Outcome(task, error=died) if broken else outcome


def _drain(
    executor: Executor, waiting: deque[T], ahead: int, work: Callable[[T], R]
) -> Iterator[Outcome[T, R]]:
    """Submit tasks until none waits or the executor breaks; yields the outcomes of all submitted
    ones."""
    out: dict[Future[R], T] = {}
    broken = False
    while (waiting and not broken) or out:
        while waiting and not broken and len(out) < ahead:
            try:
                out[executor.submit(work, waiting[0])] = waiting[0]
                waiting.popleft()
            except BrokenExecutor:
                broken = True
        for future in wait(out, return_when=FIRST_COMPLETED).done:
            task = out.pop(future)
            error = future.exception()
            broken = broken or isinstance(error, BrokenExecutor)
            yield Outcome(task, None if error else future.result(), error)


@contextmanager
def _pool(processes: int) -> Iterator[Executor]:
    from joblib.externals.loky import ProcessPoolExecutor

    executor = ProcessPoolExecutor(
        max_workers=processes, initializer=_prepare, initargs=(os.getpid(),), env=ONE_THREAD
    )
    # unfinished work is discarded
    with on_failure(lambda: executor.shutdown(wait=True, kill_workers=True)):
        yield executor
    executor.shutdown(wait=True)


def _prepare(parent: int) -> None:
    """Initialize a worker: it ignores Ctrl-C and hang-up, and ends when its parent ends."""
    gc.set_threshold(GC_OBJECTS)
    for number in FOR_THE_PARENT:
        signal.signal(number, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, name="parent watch", daemon=True).start()


def _cluster(work: Callable[[T], R], tasks: Sequence[T], address: str) -> Iterator[Outcome[T, R]]:
    """Outcomes from a Dask cluster. The scheduler moves tasks of a lost worker to others; a task
    that repeatedly kills workers gets the error."""
    try:
        from distributed import Client
    except ImportError:
        remedy = "make install-cluster, or elsewhere pip install 'grasp-controller[cluster]'"
        raise UsageError("--cluster needs Dask", remedy) from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise LinkLost(
            f"no Dask scheduler at {address}: {error}", "start one: dask scheduler, dask worker"
        ) from None
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise LinkLost(f"the scheduler at {address} has no workers", "start one: dask worker")
        executor = client.get_executor(pure=False)
        try:
            yield from _drain(executor, deque(tasks), AHEAD * threads, work)
        except CancelledError:
            raise LinkLost(
                f"the Dask scheduler at {address} is gone", "start it again, then go on"
            ) from None
