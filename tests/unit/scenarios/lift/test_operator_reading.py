"""The operator reads the slip distance of a lifted object from the tape mark."""

from typing import Any

import pytest

from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.lift.lift import lift
from scenarios.lift.scoring import LiftFacts, LiftOutcome, outcome
from scenarios.trial.experiment import TrialContext
from scenarios.trial.operator_prompts import TapeMark, read_mark
from scenarios.trial.series import run_series
from tests.unit.scenarios.conftest import changed, config
from tests.unit.scenarios.safety_probes import lift_verdict


class Typist:
    """Types one line per question, a few polls after it was asked."""

    def __init__(self, *answers: str, after: int = 3) -> None:
        self.questions: list[str] = []
        self._answers = list(answers)
        self._after, self._left = after, 0

    def say(self, text: str) -> None:
        self.questions.append(text)
        self._left = self._after

    def poll(self) -> str | None:
        self._left -= 1
        return self._answers.pop(0) if self._left == 0 and self._answers else None


def facts(mark: TapeMark | None, registered_s: float | None = 1.0, **others: Any) -> LiftFacts:
    known = {
        "end": None, "estimated_n": 5.0, "had_compensated": True, "registered_s": registered_s,
        "onset_s": None, "open_loop_onset_s": None, "peak_force_n": 9.0, "force_bound_n": 11.0,
        "limit_reached": False, "alarm_stayed": False, "fault": "",
    }  # fmt: skip
    return LiftFacts(**(known | others), mark=mark)


def test_object_lost_in_the_air_while_lowering_is_dropped() -> None:
    for lost_at_m, dropped in ((0.0, False), (0.0049, False), (0.005, True), (0.18, True)):
        verdict = LiftOutcome.DROPPED if dropped else LiftOutcome.HELD_WITHIN_6CM
        assert lift_verdict({}, lost_at_m=lost_at_m) is verdict


def test_operator_s_reading_decides_without_a_simulation() -> None:
    for known, verdict in (
        (facts(None), LiftOutcome.HELD),
        (facts(TapeMark(0.06, True)), LiftOutcome.HELD_WITHIN_6CM),
        (facts(TapeMark(0.061, True)), LiftOutcome.HELD_WITHIN_12CM),
        (facts(TapeMark(0.121, True)), LiftOutcome.BEYOND_12CM),
        (facts(TapeMark(0.0, False)), LiftOutcome.DROPPED),
        (facts(TapeMark(0.0, False), limit_reached=True), LiftOutcome.DROPPED),
        (facts(TapeMark(0.01, True), limit_reached=True), LiftOutcome.LIMIT_REACHED),
        (facts(TapeMark(0.01, True), fault="x"), LiftOutcome.FAULT),
        (facts(TapeMark(0.01, True), fault="x", peak_force_n=11.1), LiftOutcome.OVER_FORCE),
        (facts(TapeMark(0.01, True), registered_s=None), LiftOutcome.UNDETECTED),
        (facts(TapeMark(0.0, True), registered_s=None), LiftOutcome.NEVER_SLIPPED),
        (facts(TapeMark(0.0, True), registered_s=None, by_touch=True), LiftOutcome.HELD_WITHIN_6CM),
        (
            facts(TapeMark(0.0009, True), registered_s=None, by_touch=True),
            LiftOutcome.HELD_WITHIN_6CM,
        ),
        (facts(TapeMark(0.0011, True), registered_s=None, by_touch=True), LiftOutcome.UNDETECTED),
    ):
        assert outcome(known, config().object) is verdict, verdict


def test_length_is_read_in_millimetres_and_invalid_input_is_asked_again() -> None:
    for typed, moved_m, held in (
        ("12.5", 0.0125, True), (" 3,5 ", 0.0035, True), ("0", 0.0, True), ("11 mm", 0.011, True),
        ("3,5MM", 0.0035, True), ("L", 0.0, False), ("lost", 0.0, False),
    ):  # fmt: skip
        read = read_mark(Typist(), typed)
        assert read is not None
        assert read.moved_m == pytest.approx(moved_m) and read.held is held
    for typed in ("", "much", "-1", "501", "nan", "inf", "1_0", "mm", "11 cm"):
        typist = Typist()
        assert read_mark(typist, typed) is None, typed
        assert "is not valid" in typist.questions[0], typed


def test_object_is_held_until_its_slip_has_been_read(monkeypatch: pytest.MonkeyPatch) -> None:
    asked_in: list[State] = []
    phases: list[State] = []

    class Noted(Typist):
        def say(self, text: str) -> None:
            asked_in.append(phases[-1])
            super().say(text)

    typist = Noted("", "12", after=400)

    def watch(tick: Tick) -> None:
        phases.append(tick.decision.state)

    monkeypatch.setattr("scenarios.trial.series.place_object", lambda *_: None)
    context = TrialContext(on_tick=watch, operator=typist)
    (done,) = run_series(lift, changed(config(), "controller", hold_s=0.5), (0,), context)
    result = done.result
    assert result is not None
    assert result.outcome == "held_within_6cm"  # the simulated truth overrides the reading
    assert len(typist.questions) == 2
    assert "slipped" in typist.questions[0] and "is not valid" in typist.questions[1]
    assert asked_in == [State.HOLD, State.HOLD]
    assert phases.count(State.HOLD) > 800  # two answers of 4 s each
    assert State.RETREAT in phases
