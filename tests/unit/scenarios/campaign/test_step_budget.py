"""Cost of a campaign's trial in steps and in Python calls a step, which no machine changes."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Literal, NamedTuple

import pytest

from grasp.run.loop import ControlLoop
from scenarios.campaign.spec import CampaignSpec, combinations, trials
from scenarios.campaign.worker import run_once

MARGIN = 1.05
TICK = ControlLoop.tick.__code__


class Cost(NamedTuple):
    steps: int
    calls: int  # of Python functions, a step


# Lower them with a change that makes trials cheaper.
BUDGETS = {"lift": Cost(712, 163), "tap": Cost(834, 167)}


@contextmanager
def counted(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Cost]]:
    """Costs of the control loops that run in the context."""
    costs: list[Cost] = []
    run = ControlLoop.run

    def counting(loop: ControlLoop, deadline_s: float) -> None:
        steps = calls = 0

        def count(frame: FrameType, event: str, arg: Any) -> None:
            nonlocal steps, calls
            if event == "call":
                calls += 1
                steps += frame.f_code is TICK

        sys.setprofile(count)
        try:
            run(loop, deadline_s)
        finally:
            sys.setprofile(None)
        costs.append(Cost(steps, round(calls / steps)))

    with monkeypatch.context() as patch:
        patch.setattr(ControlLoop, "run", counting)
        yield costs


@pytest.mark.parametrize("scenario", ["lift", "tap"])
def test_a_trial_keeps_its_budget(
    scenario: Literal["lift", "tap"], monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = CampaignSpec(name="can", scenarios=(scenario,), objects=("can",), repetitions=1)
    (trial,) = trials(spec, combinations(spec))
    run_once(trial, None)  # compiles and fills caches
    with counted(monkeypatch) as costs:
        run_once(trial, None)
    (cost,) = costs
    budget = BUDGETS[scenario]
    print(f"{scenario}: {cost}")  # for new budgets: pytest -s
    assert cost.steps <= MARGIN * budget.steps
    assert cost.calls <= MARGIN * budget.calls
