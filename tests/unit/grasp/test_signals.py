"""Signals: raised at once, at the next check, or late; handled only by the command line."""

import signal
from collections.abc import Iterator

import pytest

from grasp.run import signals
from grasp.run.signals import SIGNALS, Interruption, Stuck


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


@pytest.mark.usefixtures("taken")
def test_a_watched_main_thread_that_hangs_after_a_signal_is_interrupted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(signals, "HANG_S", 0.02)
    with signals.watched(), signals.deferred():
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Stuck, match=r"terminated \(SIGTERM\) while the program hung"):
            signals.time.sleep(60.0)


@pytest.mark.usefixtures("taken")
def test_a_watched_main_thread_that_checks_is_not_interrupted() -> None:
    with signals.watched(), signals.deferred():
        signal.raise_signal(signal.SIGINT)
        for _ in range(3):
            signals.check(end=False)
            signal.raise_signal(signal.SIGALRM)  # of the timer, once a second
        with pytest.raises(Stuck):
            signal.raise_signal(signal.SIGALRM)


@pytest.mark.usefixtures("taken")
def test_after_a_run_no_timer_is_left() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with signals.watched(), signals.deferred():
        signal.raise_signal(signal.SIGINT)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) == before


@pytest.mark.usefixtures("taken")
def test_a_timer_of_somebody_else_is_left_alone() -> None:
    signal.setitimer(signal.ITIMER_REAL, 60.0)
    try:
        with signals.watched():
            pass
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


@pytest.mark.usefixtures("taken")
def test_a_hang_after_an_earlier_signal_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "HANG_S", 0.02)
    with signals.deferred():
        signal.raise_signal(signal.SIGINT)
        with signals.watched(), pytest.raises(Stuck):
            signals.time.sleep(60.0)
