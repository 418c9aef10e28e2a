"""Wall time on a shared machine: a test that failed while the machine stood still is run again.

Real clients talk to real servers here, with real timeouts. When the system lets no process run for
longer than those, a failure says nothing about either. Every other failure counts at once.

Workers of pytest-xdist share the waiting. Whole cells keep step with real time, so those run
one after another, whatever the number of workers.
"""

import time

import pytest
from _pytest.runner import runtestprotocol

from tests.wire.stillness import StallMeter

AGAIN = 3  # times at most
CALM_S, PATIENCE_S = 2.0, 20.0
TIMEOUT_S = 420  # of all attempts together
ONE_AT_A_TIME = (
    "cell/",
    "test_acquire.py",
    "test_ends.py",
    "test_rigs.py",
    "test_tap.py",
)  # of wire/scenarios
ONE_WORKER_A_FILE = "scenarios/lab/"  # its tests share one hand, one after the other
COMPUTES = "test_cell_has_compiled_its_world_before_it_answers"  # for most of its time

_meter: StallMeter | None = None
AGAIN_SAID = "run again"  # of a report's properties: those reach the summary from any process


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    shared_out = config.pluginmanager.hasplugin("xdist")
    for item in items:
        _, here, path = item.path.as_posix().partition("tests/wire/")
        if here and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(TIMEOUT_S))
        cell = path.removeprefix("scenarios/").startswith(ONE_AT_A_TIME)
        if shared_out and cell and item.name != COMPUTES:
            item.add_marker(pytest.mark.xdist_group("cell"))
        elif shared_out and path.startswith(ONE_WORKER_A_FILE):
            item.add_marker(pytest.mark.xdist_group(path))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    meter = _started(item.config)
    where = {"nodeid": item.nodeid, "location": item.location}
    item.ihook.pytest_runtest_logstart(**where)
    for left in reversed(range(1 + AGAIN)):
        start_s = time.monotonic()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        stall_s = meter.worst_since_s(start_s)
        if not left or not stall_s or not any(report.failed for report in reports):
            break
        item.user_properties.append((AGAIN_SAID, f"{stall_s * 1e3:.0f} ms"))
        _forget(item)
        meter.wait_for_calm(CALM_S, PATIENCE_S)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(**where)
    return True


def _started(config: pytest.Config) -> StallMeter:
    global _meter  # noqa: PLW0603  (one for the whole run)
    if _meter is None:
        _meter = StallMeter()
        config.add_cleanup(_meter.close)
    return _meter


def _forget(item: pytest.Item) -> None:
    """What the attempt has left set up; fixtures of modules too, since they may be what failed."""
    item.session._setupstate.teardown_exact(None)
    item._initrequest()  # type: ignore[attr-defined]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Also of tests that ran in a worker of pytest-xdist: a report carries what is said here."""
    found = {
        f"{report.nodeid}: everything stood still for {value}"
        for reports in terminalreporter.stats.values()
        for report in reports
        if isinstance(report, pytest.TestReport)
        for name, value in report.user_properties
        if name == AGAIN_SAID
    }
    if found:
        terminalreporter.section(AGAIN_SAID)
        for line in sorted(found):
            terminalreporter.write_line(line)
