"""Where trials run: worker processes of this machine, or a Dask cluster."""

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager

import msgspec

from drivers.errors import GraspError, LinkLost
from scenarios.campaign.spec import Task
from scenarios.campaign.worker import Finished, error_row

Work = Callable[[Task], Finished]
AHEAD = 2  # trials handed out for every worker: none waits for the parent's disk
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
PARENT_POLL_S = 0.5
CONNECT_S = 10.0


class NoCluster(GraspError):
    """The extra `cluster` is not installed."""

    kind = "usage"


class _Outcome(msgspec.Struct, frozen=True):
    """What became of one trial that was handed out; neither: the worker died under it."""

    trial: Task
    finished: Finished | None = None


def local(trials: Sequence[Task], jobs: int, work: Work) -> Generator[Finished, None, None]:
    """Finished trials as they come, from so many worker processes of one thread each.

    A worker that dies takes its pool with it, and nobody knows which of the trials handed out was
    to blame: they run once more one by one, and the one that dies again is an error row.
    """
    waiting = deque(trials)
    while waiting:
        suspects: deque[Task] = deque()
        with _workers(jobs) as executor:
            for outcome in _drain(executor, waiting, AHEAD * jobs, work):
                if outcome.finished is not None:
                    yield outcome.finished
                else:
                    suspects.append(outcome.trial)
        yield from _one_by_one(suspects, work)


def _one_by_one(waiting: deque[Task], work: Work) -> Iterator[Finished]:
    while waiting:
        with _workers(1) as executor:
            for outcome in _drain(executor, waiting, 1, work):
                died = Finished(error_row(outcome.trial, "the worker process died"))
                yield outcome.finished or died


def _drain(executor: Executor, waiting: deque[Task], ahead: int, work: Work) -> Iterator[_Outcome]:
    """Feed the executor until nothing waits, or until it breaks; then what was out comes back."""
    out: dict[Future[Finished], Task] = {}
    broken = False
    while (waiting and not broken) or out:
        while waiting and not broken and len(out) < ahead:
            try:
                out[executor.submit(work, waiting[0])] = waiting[0]
                waiting.popleft()
            except BrokenExecutor:
                broken = True
        for future in wait(out, return_when=FIRST_COMPLETED).done:
            trial = out.pop(future)
            error = future.exception()
            if isinstance(error, BrokenExecutor):
                broken = True
                yield _Outcome(trial)
            elif error is not None:
                yield _Outcome(
                    trial, Finished(error_row(trial, f"{type(error).__name__}: {error}"))
                )
            else:
                yield _Outcome(trial, future.result())


@contextmanager
def _workers(jobs: int) -> Iterator[Executor]:
    from joblib.externals.loky import ProcessPoolExecutor

    executor = ProcessPoolExecutor(max_workers=jobs, initializer=_prepare, env=ONE_THREAD)
    try:
        yield executor
    except BaseException:  # Ctrl-C among them: what is half done is of no use to anyone
        executor.shutdown(wait=True, kill_workers=True)
        raise
    executor.shutdown(wait=True)


def _prepare() -> None:
    """In each worker: the parent alone answers Ctrl-C, and nobody outlives the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, name="parent watch", daemon=True).start()


def cluster(trials: Sequence[Task], address: str, work: Work) -> Generator[Finished, None, None]:
    """Finished trials as they come from the workers of a Dask scheduler.

    The scheduler moves the trials of a lost worker to others; a trial that keeps killing workers
    becomes an error row. Raises NoCluster without the extra, LinkLost without a scheduler.
    """
    try:
        from distributed import Client
    except ImportError:
        raise NoCluster("--cluster needs Dask", "pip install 'grasp-controller[cluster]'") from None
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
        waiting = deque(trials)
        for outcome in _drain(client.get_executor(pure=False), waiting, AHEAD * threads, work):
            if outcome.finished is not None:
                yield outcome.finished
