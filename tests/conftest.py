"""Rules of every test: leave no thread, process or socket; connect only to this machine."""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from ipaddress import ip_address
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import hypothesis
import pytest

GRACE_S = 2.0  # time for resources that are being closed
NIGHTLY = Path(__file__).parent / "nightly"

hypothesis.settings.register_profile("local", deadline=None, print_blob=True)
hypothesis.settings.register_profile("ci", deadline=None, print_blob=True, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")

# A developer's settings, such as addresses of real devices, must not affect a test.
for name in [name for name in os.environ if name.startswith("GRASP_")]:
    del os.environ[name]
os.environ["MPLBACKEND"] = "Agg"

# Begun in the background of a script or by nohup, the tests would ignore Ctrl-C or a closed
# terminal, and so would what they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if NIGHTLY in item.path.parents:
            item.add_marker(pytest.mark.slow)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(900))


def threads() -> set[str]:
    return {f"thread {thread.name} ({thread.ident})" for thread in threading.enumerate()}


def children() -> set[str]:
    """Child processes, unreaped ones too; not the helpers that process pools keep for good."""
    pids: set[int] = set()
    for path in Path("/proc/self/task").glob("*/children"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread that has ended
            pids |= {int(pid) for pid in path.read_text().split()}
    trackers = (resource_tracker, sys.modules.get("joblib.externals.loky.backend.resource_tracker"))
    helpers = {t._resource_tracker._pid for t in trackers if t is not None}  # type: ignore[attr-defined]
    return {f"process {pid}" for pid in pids - helpers}


def sockets() -> set[str]:
    found = set()
    for entry in os.scandir("/proc/self/fd"):
        try:
            target = os.readlink(entry.path)
        except FileNotFoundError:  # the one that scandir itself had open
            continue
        if target.startswith("socket:"):
            found.add(target)
    return found


def held() -> set[str]:
    return threads() | children() | sockets()


@pytest.fixture(autouse=True)
def nothing_left_behind() -> Iterator[None]:
    """Fail a test that leaves a thread, a child process or a socket that did not exist before."""
    before = held()
    yield
    deadline = time.monotonic() + GRACE_S
    while (left := held() - before) and time.monotonic() < deadline:
        time.sleep(0.01)
    if left:
        pytest.fail("left behind: " + ", ".join(sorted(left)), pytrace=False)


def is_here(address: Any) -> bool:
    """True for addresses of this machine: loopback, or a path of the file system."""
    if not isinstance(address, tuple):
        return True
    host = address[0]
    if host in ("", "localhost"):
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def only_here(call: Callable[..., Any]) -> Callable[..., Any]:
    def guarded(self: socket.socket, *args: Any) -> Any:
        if not is_here(args[-1]):
            raise AssertionError(f"a test may talk to loopback only, not to {args[-1]}")
        return call(self, *args)

    return guarded


@pytest.fixture(scope="session", autouse=True)
def loopback_only() -> Iterator[None]:
    """Refuse every connection that would leave this machine."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("connect", "connect_ex", "sendto"):
            patch.setattr(socket.socket, name, only_here(getattr(socket.socket, name)))
        yield
