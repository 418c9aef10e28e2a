"""Parallel execution of tasks: in worker processes of this machine or on a Dask cluster.

Results come in the order of completion; their values depend only on the tasks.
"""

import gc
import multiprocessing
import os
import signal
import sys
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
from importlib.metadata import distributions
from typing import Any, Generic, TypeVar, cast

import msgspec

from drivers.errors import GraspError, LinkLost, UsageError, on_failure
from grasp.run import signals

T = TypeVar("T")
R = TypeVar("R")
AHEAD = 2  # tasks in flight per worker, so that no worker waits for the parent's disk
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
FOR_THE_PARENT = (signal.SIGINT, signal.SIGHUP)
PARENT_POLL_S = 0.5
GC_OBJECTS = 20_000  # a trial leaves few cycles: less frequent collection saves a tenth of the time
CONNECT_S = 10.0
GO_ON = "then go on: a campaign with --resume"
ASK_S, GONE_S = 10.0, 60.0  # without a result: how often workers are asked for, and for how long
PACKAGES = ("grasp-controller", "numba", "numpy")  # results depend on their versions
Quiet = Callable[[float], object]  # gets the time without a result, s, every ASK_S; may raise


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
    work: Callable[[T], R], tasks: Sequence[T], workers: Workers, quiet: Quiet | None = None
) -> Generator[R, None, None]:
    """Results in order of completion; the first error ends the other tasks and is raised."""
    with closing(outcomes(work, tasks, workers, quiet)) as found:
        for outcome in found:
            if outcome.error is not None:
                raise outcome.error
            yield cast(R, outcome.result)


def outcomes(
    work: Callable[[T], R], tasks: Sequence[T], workers: Workers, quiet: Quiet | None = None
) -> Generator[Outcome[T, R], None, None]:
    """Outcomes in order of completion; closing the generator or Ctrl-C ends all workers.

    Raises UsageError without Dask or shared memory and for Dask workers with other versions,
    LinkLost if the scheduler cannot be reached or is lost, or has no workers for GONE_S.
    """
    if not tasks:
        return
    if workers.cluster is not None:
        yield from _cluster(work, tasks, workers.cluster, quiet)
    elif (no_semaphores := _why_no_semaphores()) and workers.processes > 1:
        raise UsageError(
            f"worker processes need shared memory: /dev/shm: {no_semaphores}",
            "make /dev/shm writable or use --jobs 1",
        )
    elif workers.processes == 0 or no_semaphores:
        yield from (_run_task(work, task) for task in tasks)
    else:
        yield from _processes(work, tasks, min(workers.processes, len(tasks)), quiet)


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
    work: Callable[[T], R], tasks: Sequence[T], processes: int, quiet: Quiet | None
) -> Iterator[Outcome[T, R]]:
    """A worker that dies breaks its pool, and which task caused it is unknown. The tasks in flight
    run again one at a time; the one whose worker dies again gets the error."""
    died = GraspError("the worker process died", "if memory ran out, use fewer --jobs")
    waiting = deque(tasks)
    while waiting:
        suspects: list[T] = []
        with _pool(processes) as executor:
            for outcome in _drain(executor, waiting, AHEAD * processes, work, quiet):
                if isinstance(outcome.error, BrokenExecutor):
                    suspects.append(outcome.task)
                else:
                    yield outcome
        for task in suspects:
            with _pool(1) as executor:
                for outcome in _drain(executor, deque([task]), 1, work, quiet):
                    broken = isinstance(outcome.error, BrokenExecutor)
                    yield Outcome(task, error=died) if broken else outcome


def _drain(
    executor: Executor, waiting: deque[T], ahead: int, work: Callable[[T], R], quiet: Quiet | None
) -> Iterator[Outcome[T, R]]:
    """Submit tasks until none waits or the executor breaks; yields the outcomes of all submitted
    ones."""
    out: dict[Future[R], T] = {}
    broken, silent_s = False, 0.0
    while (waiting and not broken) or out:
        while waiting and not broken and len(out) < ahead:
            try:
                out[executor.submit(work, waiting[0])] = waiting[0]
                waiting.popleft()
            except BrokenExecutor:
                broken = True
        done = wait(out, ASK_S, FIRST_COMPLETED).done
        silent_s = 0.0 if done else silent_s + ASK_S
        if quiet and not done:
            quiet(silent_s)
        for future in done:
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


def _cluster(
    work: Callable[[T], R], tasks: Sequence[T], address: str, quiet: Quiet | None
) -> Iterator[Outcome[T, R]]:
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
        _check_versions(client)
        gone_s = 0.0

        def ask(silent_s: float) -> None:
            nonlocal gone_s
            gone_s = 0.0 if client.nthreads() else gone_s + ASK_S
            if gone_s >= GONE_S:
                problem = f"the scheduler at {address} has had no workers for {GONE_S:g} s"
                raise LinkLost(problem, f"start them again, {GO_ON}")
            if quiet:
                quiet(silent_s)

        executor = client.get_executor(pure=False)
        try:
            yield from _drain(executor, deque(tasks), AHEAD * threads, work, ask)
        except (CancelledError, OSError):
            problem = f"the Dask scheduler at {address} is gone"
            raise LinkLost(problem, f"start it again, {GO_ON}") from None


def _check_versions(client: Any) -> None:
    """Raise UsageError for a worker of the cluster with other versions, or without the package:
    its tasks would wait for ever."""
    ours, found = _versions(), client.run(_versions, on_error="return")
    if others := {worker: theirs for worker, theirs in found.items() if theirs != ours}:
        problem = f"workers of the cluster have other versions than this process: {others}"
        raise UsageError(problem, f"install the same on each: {ours}")


def _versions() -> str:
    python = "{}.{}".format(*sys.version_info)
    found = {each.name: each.version for name in PACKAGES for each in distributions(name=name)}
    return ", ".join(f"{name} {version}" for name, version in {"Python": python, **found}.items())
