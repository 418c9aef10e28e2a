"""Signals: raised at once, at the next check, or late; handled only by the command line."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from grasp.run import signals
from grasp.run.signals import SIGNALS, Interruption


@pytest.fixture
def taken() -> Iterator[None]:
    with signals.taken():
        yield


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in SIGNALS]


def test_handlers_are_restored() -> None:
    before = handlers()
    with signals.taken():
        assert all(now is not then for now, then in zip(handlers(), before, strict=True))
    assert handlers() == before


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.usefixtures("taken")
def test_signal_outside_deferred_is_raised_at_once(number: signal.Signals) -> None:
    with pytest.raises(Interruption):
        signal.raise_signal(number)
    assert signals.number() == number


@pytest.mark.usefixtures("taken")
def test_deferred_signal_is_raised_at_the_next_check_and_only_once() -> None:
    with signals.deferred():
        signal.raise_signal(signal.SIGTERM)
        signals.check(end=False)
        with pytest.raises(Interruption) as stop:
            signals.check()
        assert stop.value.args == (signal.SIGTERM,)
        assert signals.received()
        signal.raise_signal(signal.SIGINT)
        signals.check()


@pytest.mark.usefixtures("taken")
def test_deferred_signal_after_five_seconds_is_raised_but_key_repeat_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with signals.deferred():
        for _ in range(50):
            signal.raise_signal(signal.SIGINT)
        later_s = signals.time.monotonic() + signals.FORCE_AFTER_S
        monkeypatch.setattr(signals.time, "monotonic", lambda: later_s)
        with pytest.raises(Interruption):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("taken")
def test_immediate_wait_is_interrupted_but_not_its_clean_up() -> None:
    unwound = False
    with signals.deferred():
        with pytest.raises(Interruption), signals.immediate():
            try:
                signal.raise_signal(signal.SIGHUP)
            finally:
                signal.raise_signal(signal.SIGHUP)
                unwound = True
        signals.check()
    assert unwound


@pytest.mark.usefixtures("taken")
def test_a_signal_that_ended_a_trial_ends_the_caller_too() -> None:
    signals.raise_if_received()
    with pytest.raises(Interruption):
        signal.raise_signal(signal.SIGTERM)
    with pytest.raises(Interruption):
        signals.raise_if_received()


@pytest.mark.usefixtures("taken")
def test_check_raises_nothing_while_checks_are_ignored() -> None:
    with signals.deferred():
        with signals.deferred(ignore_checks=True):
            signal.raise_signal(signal.SIGTERM)
            signals.check()
        with pytest.raises(Interruption):
            signals.check()


def test_keyboard_interrupt_of_python_has_a_cause() -> None:
    assert signals.cause(KeyboardInterrupt()) == "stopped by hand"
    assert "SIGHUP" in signals.cause(Interruption(signal.SIGHUP))


WATCHED = """
import ctypes, os, signal, sys, threading, time
from grasp.run import signals
def send_signals():
    time.sleep(0.1)
    os.kill(os.getpid(), signal.SIGTERM)
    if sys.argv[1] == "twice":
        time.sleep(1.3)
        os.kill(os.getpid(), signal.SIGTERM)
    while sys.argv[1] == "held":
        time.sleep(0.03)
        os.kill(os.getpid(), signal.SIGTERM)
with signals.taken():
    try:
        with signals.watchdog(lambda: os.write(1, b"devices are safe")), signals.deferred():
            threading.Thread(target=send_signals, daemon=True).start()
            try:
                while sys.argv[1] in ("twice", "held"):  # in a safe state
                    signals.check(end=False)
                    time.sleep(0.01)
            except signals.Stuck as stuck:
                print(stuck)
                for _ in range(250):  # during an abort
                    signals.check(end=False)
                    time.sleep(0.01)
                if sys.argv[1] == "held":
                    print("stopped")
                sys.stdout.flush()
                os._exit(0)
            if sys.argv[1] == "native":
                lock, mutex = ctypes.CDLL(None).pthread_mutex_lock, ctypes.create_string_buffer(64)
                lock(mutex)
                lock(mutex)
            time.sleep(60)
    except signals.Stuck as stuck:
        print(stuck)
"""


def watched(how: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, how], capture_output=True, text=True, timeout=30,
        check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


@pytest.mark.parametrize("how", ["stuck", "twice"])
def test_main_thread_that_does_not_end_is_interrupted(how: str) -> None:
    assert watched(how) == (0, "terminated (SIGTERM) while the program hung\n")


def test_held_key_interrupts_the_requested_stop_only_once() -> None:
    assert watched("held") == (0, "terminated (SIGTERM) while the program hung\nstopped\n")


def test_process_that_hangs_in_native_code_ends_once_the_devices_are_safe() -> None:
    assert watched("native") == (5, "devices are safe")
