"""Time from a decision to its reply, on the emulated rig."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from grasp.cli.live import Display
from grasp.control.commands import MoveFingers
from grasp.control.observation import Observation
from grasp.control.states import State
from grasp.control.step import GraspStep, StepResult
from scenarios.campaign.config import load_config
from scenarios.lift.lift import lift
from scenarios.report.live_feed import LiveTrials
from scenarios.trial import execution
from scenarios.trial.experiment import TrialContext
from scenarios.trial.series import run_series

LONG_HOLD = ("hand.activation_s=0.5", "controller.hold_s=20", "controller.lift_height_m=0.05")


class Commanding:
    """A control step that, during the hold, also commands the hand in every third period: to stay
    where it is, at another speed. Each command is one write, and nothing moves."""

    def __init__(self, step: GraspStep[Any], force_n: float) -> None:
        self._step, self._force_n = step, force_n
        self._steps = self.commands = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._step, name)

    def decide(self, obs: Observation) -> StepResult:
        result = self._step.decide(obs)
        self._steps += 1
        decision = result.decision
        if self._steps % 3 or decision.state is not State.HOLD or decision.commands:
            return result
        self.commands += 1
        speed_mps = (0.03, 0.05)[self.commands % 2]
        command = MoveFingers(obs.gripper.requested, speed_mps, self._force_n)
        decision = msgspec.structs.replace(decision, commands=(command,))
        return StepResult(obs, decision, (command,))


@pytest.mark.bench
@pytest.mark.timeout(300)
def test_time_from_decision_to_reply_with_recorder_display_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = load_config("can", "emulated", None, None, LONG_HOLD).for_lift()
    made: list[Commanding] = []

    def make_step(*args: Any, **more: Any) -> Commanding:
        made.append(Commanding(real(*args, **more), config.controller.grip_force_n))
        return made[-1]

    real = execution.make_step
    monkeypatch.setattr(execution, "make_step", make_step)
    page = LiveTrials(config, "bench", 1)
    try:
        with Display("emulated", quiet=False) as display:
            context = TrialContext(tmp_path, on_tick=display.tick, watch=page.watch)
            [finished] = run_series(lift, config, (0,), context)
    finally:
        page.feed.close()
    assert finished.result is not None
    timing, [step] = finished.result.timing, made
    print(f"\n{step.commands} decisions in the hold, {timing.missed_periods} missed periods")
    assert step.commands >= 600
    spreads = {
        "frame to decision": timing.frame_to_decision_us,
        "decision to acknowledged write": timing.decision_to_ack_us,
    }
    for text, spread in spreads.items():
        assert spread is not None
        print(f"{text}: p50 {spread.p50:.0f}, p90 {spread.p90:.0f}, p99 {spread.p99:.0f}, "
              f"max {spread.max:.0f} us")  # fmt: skip
