"""The tap as a closed loop over the device models, and with an operator."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import msgspec
import pytest

from grasp.control.fault import lines
from grasp.control.states import State
from grasp.run.loop import Issued, Tick
from scenarios.campaign.config import load_config
from scenarios.rigs.opening import open_rig
from scenarios.rigs.rig import Rig
from scenarios.tap.config import TapConfig
from scenarios.tap.mallet import swing
from scenarios.tap.scoring import TapResult
from scenarios.tap.tap import TapTrial, tap
from scenarios.trial.execution import make_guard
from scenarios.trial.experiment import TrialContext
from scenarios.trial.replay import replay_run
from scenarios.trial.series import run_series
from scenarios.world.cell import Impact


def config(*assignments: str, object_name: str = "can") -> TapConfig:
    return load_config(object_name, "simulated", None, None, assignments).for_tap()


@cache
def _result(assignments: tuple[str, ...], seed: int) -> TapResult:
    result = tap.run(config(*assignments), seed, None).result
    assert result is not None
    return result


def result_of(*assignments: str, seed: int = 0) -> TapResult:
    return _result(assignments, seed)


class Staged:
    """One tap trial with an observer that may act on the rig."""

    def __init__(self, *assignments: str, seed: int = 0) -> None:
        self.config = tap.configure(config(*assignments))
        self.seed = seed
        self.ticks: list[Tick] = []

    def run(self, act: Callable[[Rig, Tick], None] = lambda rig, tick: None) -> TapTrial:
        with open_rig(self.config, self.seed, paced=False) as rig:

            def watch(tick: Tick, truth: object, controller: object) -> None:
                self.ticks.append(tick)
                act(rig, tick)

            return tap.act(self.config, self.seed, rig, make_guard(self.config), watch)


def sent_while_watched(staged: Staged, trial: TapTrial) -> list[Issued]:
    """Commands sent between the impact and the end of the observation."""
    assert trial.sequence.motion is not None
    first, last = trial.sequence.motion.impact_s, trial.sequence.watched_until_s
    issued = [i for tick in staged.ticks for i in tick.issued]
    return [i for i in issued if first * 1e9 < i.sent_ns < last * 1e9]


@pytest.mark.parametrize(("seed", "direction"), [(0, "top"), (1, "side")])
def test_tap_that_moves_the_object_is_registered_and_cleared(seed: int, direction: str) -> None:
    r = result_of(seed=seed)
    assert r.outcome == "registered"
    assert r.success and r.moved
    assert r.direction == direction
    assert r.displacement_m is not None and 0.002 < r.displacement_m < 0.02
    assert r.down_m is not None and r.across_m is not None
    assert (abs(r.down_m) > abs(r.across_m)) == (direction == "top")
    assert r.impact_s is not None and r.slip_onset_s is not None and r.slip_end_s is not None
    assert r.impact_s < r.slip_onset_s < r.slip_end_s
    assert r.slip_duration_ms is not None and 5 < r.slip_duration_ms < 150
    assert r.slip_registered_s is not None and r.slip_registered_s > r.impact_s
    assert r.nominal_again_ms is not None and 0 <= r.nominal_again_ms < 1000
    assert r.mallet_mps is not None and 0.3 < r.mallet_mps < 4


def test_slip_at_the_force_limit_sends_no_command() -> None:
    staged = Staged()
    trial = staged.run()
    assert trial.sequence.motion is not None
    assert trial.controller.slip_monitor.events
    assert sent_while_watched(staged, trial) == []


def test_strong_impact_knocks_the_object_out() -> None:
    r = result_of("tap.impulse_n_s=1.9", "tap.direction=side")
    assert r.outcome == "knocked_out"
    assert r.moved


def test_long_push_with_a_measured_force_above_the_limit_sends_no_command() -> None:
    staged = Staged("tap.direction=closing", "tap.impulse_n_s=1.5", "tap.duration_s=0.05",
                    "tap.follow_s=0.2", "tap.follow_fraction=0.5", "tap.spread=0")  # fmt: skip
    trial = staged.run()
    motion = trial.sequence.motion
    assert motion is not None
    after = [t for t in staged.ticks if motion.impact_s <= t.t_ns * 1e-9 <= motion.impact_s + 0.3]
    assert max(max(tick.estimated_n) for tick in after) > 12.0
    assert all(not tick.issued for tick in after)
    positions = {tick.gripper.positions for tick in after}
    assert len(positions) == 1
    assert not lines(trial.controller.faults)


def test_replay_of_a_recorded_tap_has_no_differences(tmp_path: Path) -> None:
    result = tap.run(config(), 1, tmp_path).result
    assert result is not None and result.recording is not None
    replayed = replay_run(Path(result.recording))
    assert replayed.differences == []
    assert any("set-down requested" in what for _, what in replayed.events)
    assert msgspec.json.decode((Path(result.recording).parent / "result.json").read_bytes())[
        "outcome"
    ] == result.outcome  # fmt: skip


class SimulatedOperator:
    """Taps through the simulation when asked, waits, and types the given readings."""

    def __init__(self, rig: Rig, impact: Impact, answers: list[str]) -> None:
        self.prompts: list[str] = []
        self._rig, self._impact, self._answers = rig, impact, answers
        self._polls = 0
        self._pending: list[str] = []

    def say(self, text: str) -> None:
        self.prompts.append(text)
        self._polls = 0
        if text.startswith("Tap"):
            assert self._rig.tap is not None
            self._rig.tap(self._impact)
            self._pending = [""]
        else:
            self._pending = [self._answers.pop(0)]

    def poll(self) -> str | None:
        self._polls += 1
        return self._pending.pop() if self._pending and self._polls > 20 else None


def by_operator(answers: list[str], *assignments: str) -> tuple[TapResult, SimulatedOperator]:
    """A tap on a rig without access to its simulation, with an operator instead."""
    c = tap.configure(config(*assignments))
    with open_rig(c, 0, paced=False) as rig:
        operator = SimulatedOperator(rig, swing(c, 0).impact, answers)
        blind = msgspec.structs.replace(rig, tap=None, read_truth=None)
        trial = tap.act(c, 0, blind, make_guard(c), lambda *_: None, operator)
    return tap.judge(c, 0, trial, None), operator


def test_operator_taps_and_types_the_displacement_of_the_tape_mark() -> None:
    r, operator = by_operator(["7,5"])
    assert r.outcome == "registered"
    assert r.displacement_m == pytest.approx(0.0075)
    assert r.impulse_n_s is None and r.down_m is None and r.grip_force_n is None
    assert "TOP" in operator.prompts[0]
    assert r.detection_latency_ms is not None and 0 <= r.detection_latency_ms < 100


def test_interrupted_tap_stops_the_arm_keeps_the_grip_and_ends_the_series(tmp_path: Path) -> None:
    def press_ctrl_c(tick: Tick) -> None:
        if tick.decision.state is State.HOLD:
            raise KeyboardInterrupt

    ended = list(run_series(tap, config(), range(3), TrialContext(tmp_path, on_tick=press_ctrl_c)))
    assert ended[0].failure is not None
    assert ended[0].failure.kind == "interrupted"
    assert ended[0].failure.message == "stopped by hand in phase hold"
    assert ended[0].failure.end is not None
    assert ended[0].failure.end.hand.startswith("the hand is closed to the limit")
    assert len(ended) == 1
