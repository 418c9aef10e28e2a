"""Signals: raised at once, held for the next look, or too late; taken by the command line alone."""

import importlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

import msgspec
import pytest

from grasp import interruption
from grasp.interruption import SIGNALS, Interruption

ROOT = Path(__file__).parents[3]


@pytest.fixture
def taken() -> Iterator[None]:
    with interruption.taken():
        yield


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in SIGNALS]


def test_handlers_are_given_back() -> None:
    before = handlers()
    with interruption.taken():
        assert all(now is not then for now, then in zip(handlers(), before, strict=True))
    assert handlers() == before


def test_what_the_caller_of_the_program_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruption.taken():
            signal.raise_signal(signal.SIGHUP)
            assert not interruption.asked()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_no_other_thread_takes_or_holds_signals() -> None:
    before, seen = handlers(), []

    def work() -> None:
        with interruption.taken(), interruption.held():
            seen.extend(handlers())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == before


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.usefixtures("taken")
def test_signal_is_raised_at_once_where_nothing_holds_it(number: signal.Signals) -> None:
    with pytest.raises(Interruption):
        signal.raise_signal(number)
    assert interruption.number() == number


@pytest.mark.usefixtures("taken")
def test_held_signal_is_raised_at_the_next_look_and_only_once() -> None:
    with interruption.held():
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        with pytest.raises(Interruption) as stop:
            interruption.check()
        assert stop.value.number == signal.SIGTERM
        assert interruption.asked()
        interruption.check()
        signal.raise_signal(signal.SIGINT)
        interruption.check()


@pytest.mark.usefixtures("taken")
def test_wait_that_allows_it_is_cut_short_but_not_what_it_unwinds() -> None:
    unwound = False
    with interruption.held():
        with pytest.raises(Interruption), interruption.allowed():
            try:
                signal.raise_signal(signal.SIGHUP)
            finally:
                signal.raise_signal(signal.SIGHUP)
                unwound = True
        signal.raise_signal(signal.SIGHUP)
    assert unwound


@pytest.mark.usefixtures("taken")
def test_loop_that_stands_still_is_cut_by_a_second_signal_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with interruption.held(), interruption.watched():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        monkeypatch.setattr(interruption, "STUCK_NS", -1)
        with pytest.raises(Interruption):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("taken")
def test_what_stands_still_again_is_cut_again_and_what_goes_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_ns = 0
    monkeypatch.setattr(interruption, "stopwatch_ns", lambda: now_ns)
    with interruption.watched():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interruption):
            interruption.check()
        for _ in range(10):
            now_ns += interruption.STUCK_NS // 2
            interruption.goes()
            signal.raise_signal(signal.SIGINT)
        now_ns += interruption.STUCK_NS + 1
        with pytest.raises(Interruption):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("mode", [interruption.held, interruption.sealed])
@pytest.mark.usefixtures("taken")
def test_where_nobody_looks_it_takes_ten_seconds_until_a_further_signal_cuts_in(
    mode: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = 0
    monkeypatch.setattr(interruption, "stopwatch_ns", lambda: now_ns)
    with mode():
        signal.raise_signal(signal.SIGINT)
        now_ns = interruption.HUNG_NS
        signal.raise_signal(signal.SIGINT)
        now_ns += 1
        with pytest.raises(Interruption):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("taken")
def test_a_signal_that_only_cut_something_off_is_raised_anew_at_the_next_look() -> None:
    interruption.check_put_off()
    with pytest.raises(Interruption):
        signal.raise_signal(signal.SIGINT)
    interruption.check()
    interruption.check_put_off()
    assert interruption.put_off()
    with pytest.raises(Interruption):
        interruption.check_put_off()
    interruption.check_put_off()


def test_without_the_command_line_nothing_is_put_off() -> None:
    assert not interruption.put_off()


@pytest.mark.usefixtures("taken")
def test_a_signal_that_a_trial_took_for_its_end_ends_what_was_to_follow_too() -> None:
    interruption.go_on()
    with pytest.raises(Interruption):
        signal.raise_signal(signal.SIGTERM)
    with pytest.raises(Interruption):
        interruption.go_on()


@pytest.mark.usefixtures("taken")
def test_what_is_sealed_is_not_interrupted_by_anything_within() -> None:
    with interruption.held():
        with interruption.sealed():
            signal.raise_signal(signal.SIGTERM)
            with interruption.allowed(), interruption.watched():
                interruption.check()
        with pytest.raises(Interruption):
            interruption.check()


def test_python_s_own_ctrl_c_has_a_cause_too() -> None:
    assert interruption.cause(KeyboardInterrupt()) == "stopped by hand"
    assert "SIGHUP" in interruption.cause(Interruption(signal.SIGHUP))


# as libraries do that are built in C: what cuts their import is an ImportError to whoever asked
SPOILS = """
import signal
try:
    for _ in range(TIMES):
        signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    raise ImportError("damaged") from None
whole = True
"""


def imported(folder: Path, monkeypatch: pytest.MonkeyPatch, times: int = 1) -> ModuleType:
    name = f"spoils_{folder.name}"
    (folder / f"{name}.py").write_text(SPOILS.replace("TIMES", str(times)))
    monkeypatch.syspath_prepend(str(folder))
    return importlib.import_module(name)


def passes() -> None:
    """Far longer than a look whether an import has ended."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        time.sleep(0.01)


@pytest.mark.usefixtures("taken")
def test_signal_in_an_import_is_raised_once_that_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[ModuleType] = []
    with pytest.raises(Interruption):
        found.append(imported(tmp_path, monkeypatch))
        passes()
    assert all(module.whole for module in found)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_signal_in_an_import_that_is_held_by_its_end_waits_for_the_next_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGALRM)
    with interruption.taken(), interruption.held():
        with interruption.allowed():
            monkeypatch.setattr(interruption, "LOOK_S", 0.2)
            imported(tmp_path, monkeypatch)
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            time.sleep(0.01)
        with pytest.raises(Interruption):
            interruption.check()
    assert signal.getsignal(signal.SIGALRM) is before


@pytest.mark.usefixtures("taken")
def test_import_that_does_not_end_is_cut_by_a_second_signal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = iter(range(0, 10**12, 2 * interruption.STUCK_NS))
    monkeypatch.setattr(interruption, "stopwatch_ns", lambda: next(now_ns))
    monkeypatch.setattr(interruption, "STUCK_NS", 3 * interruption.STUCK_NS)
    with pytest.raises(ImportError, match="damaged"):
        imported(tmp_path, monkeypatch, times=2)


class Strikes:
    """Metadata of a type hint that a signal strikes while it is looked up."""

    armed = False

    def __hash__(self) -> int:
        if self.armed:
            self.armed = False
            signal.raise_signal(signal.SIGINT)
        return 1


@pytest.mark.usefixtures("taken")
def test_signal_that_strikes_while_a_type_hint_is_looked_up_from_c_is_not_lost() -> None:
    strikes = Strikes()
    struck = msgspec.defstruct("Struck", [("a", Annotated[int, strikes], 0)])
    strikes.armed = True
    with pytest.raises(Interruption):  # msgspec drops what a hash raises
        msgspec.convert({}, struck)
        time.sleep(10)
    assert not strikes.armed


GUARDED = """
import ctypes, os, time
from grasp import interruption

def native():
    libc, mutex = ctypes.CDLL(None), ctypes.create_string_buffer(64)
    libc.pthread_mutex_lock(mutex)
    print("hangs", flush=True)
    libc.pthread_mutex_lock(mutex)  # for ever: no signal ends it

def python():
    print("hangs", flush=True)
    time.sleep(3600)

def deaf():
    print("hangs", flush=True)
    while True:
        try:
            time.sleep(3600)
        except BaseException:
            pass

def rescue():
    print("rescued", flush=True)
    return "why"

def report(failure):
    print("reported", failure, flush=True)
    return 7

with interruption.taken(report), interruption.lastly(lambda: print("lastly", flush=True)):
    with interruption.guarded(rescue), interruption.held(), interruption.watched():
        try:
            HANG()
        except interruption.Interruption as stop:
            print("cut", stop.cut, stop.number, flush=True)
"""


@pytest.mark.parametrize(
    ("hang", "code", "said"),
    [("python", 0, ["cut True 15"]), ("native", 7, ["rescued", "lastly", "reported why"]),
     ("deaf", 7, ["rescued", "lastly", "reported why"])],
)  # fmt: skip
def test_guarded_loop_that_stands_still_is_ended_by_the_first_signal(
    hang: str, code: int, said: list[str]
) -> None:
    script = GUARDED.replace("HANG", hang)
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "hangs\n"
            process.send_signal(signal.SIGTERM)
            out, _ = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (out.splitlines(), process.returncode) == (said, code)


@pytest.mark.usefixtures("taken")
def test_guarded_loop_that_looks_takes_a_signal_at_its_next_look_and_leaves_nothing() -> None:
    with interruption.guarded(lambda: None), interruption.held(), interruption.watched():
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Interruption) as stop:
            interruption.check()
        assert not stop.value.cut
    assert signal.set_wakeup_fd(-1) == -1
