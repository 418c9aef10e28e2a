"""The speed slider of an arm on real wires is turned in the midst of a lift."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from grasp.loop import Tick
from grasp.phases import Phase
from scenarios.campaign.config import load_config
from scenarios.lift import lift
from scenarios.lift.config import LiftConfig
from scenarios.rigs.opening import open_rig
from scenarios.rigs.permission import MotionPermit
from scenarios.rigs.rig import Rig
from scenarios.trial import series
from scenarios.world.truth import Truth
from tests.wire.scenarios.cell.staged import QUICK

AT_PACE = ("controller.lower_speed_mps=0.05", "controller.phase_timeout_s=5")
STANDING_MPS = 1e-3


class Turned:
    """One lift in which the slider is turned, a step into a phase, to each of these."""

    def __init__(self, fractions: dict[Phase, float]) -> None:
        self._fractions = fractions
        self._rig: Rig | None = None
        self.ticks: list[Tick] = []
        self.truth: Truth | None = None
        self.arm_mps = 0.0  # when all is over

    def run(self, monkeypatch: pytest.MonkeyPatch, *settings: str) -> Any:
        monkeypatch.setattr(series, "open_rig", self._open)
        config = load_config("can", "emulated", None, None, (*QUICK, *AT_PACE, *settings))
        return lift.run(config.for_lift(), 0, None, on_tick=self._tick)

    @contextmanager
    def _open(
        self, config: LiftConfig, seed: int, paced: bool, permit: MotionPermit | None
    ) -> Iterator[Rig]:
        with open_rig(config, seed, paced, permit) as rig:
            self._rig = rig
            try:
                yield rig
            finally:
                self.truth = self._cell.truth()
                self.arm_mps = self._cell.control.ask("motion")["arm_mps"]

    @property
    def _cell(self) -> Any:
        return self._rig.world.__self__  # type: ignore[union-attr]

    def _tick(self, tick: Tick) -> None:
        self.ticks.append(tick)
        fraction = self._fractions.pop(tick.decision.phase, None)
        if fraction is not None:
            self._cell.control.ask("fault", name="speed_slider", fraction=fraction)


def test_lift_with_the_slider_at_60_percent_ends_as_planned(monkeypatch) -> None:
    turned = Turned({Phase.LIFT: 0.6})
    result = turned.run(monkeypatch).result
    assert result.success, result
    assert turned.ticks[-1].decision.phase is Phase.DONE
    assert turned.ticks[-1].arm.speed_fraction == 0.6


def test_lift_with_the_slider_at_20_percent_ends_safely_and_says_why(monkeypatch) -> None:
    turned = Turned({Phase.LIFT: 0.2})
    finished = turned.run(monkeypatch)
    assert finished.result.outcome == "fault"
    assert finished.failure is not None
    assert "the arm's speed slider is at 20 %" in finished.failure.message
    assert finished.failure.end is not None and finished.failure.end.arm == "the arm stands"
    assert turned.arm_mps == 0.0
    assert turned.truth is not None and turned.truth.touched
    assert abs(turned.truth.slip_speed_mps) < STANDING_MPS
