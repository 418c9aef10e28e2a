"""Signals: raised at once, held for the next look, or too late; taken by the command line alone."""

import signal
from collections.abc import Iterator

import pytest

from grasp import interruption
from grasp.interruption import SIGNALS, Interruption


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


@pytest.mark.usefixtures("taken")
def test_guarded_loop_that_looks_takes_a_signal_at_its_next_look_and_leaves_nothing() -> None:
    with interruption.guarded(lambda: None), interruption.held(), interruption.watched():
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Interruption) as stop:
            interruption.check()
        assert not stop.value.cut
    assert signal.set_wakeup_fd(-1) == -1
