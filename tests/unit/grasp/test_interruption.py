"""Signals: raised at once, held for the next look, or too late; taken by the command line alone."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

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
