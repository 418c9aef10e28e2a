"""The terminal view of a run: panel, lines and verdict."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from rich.console import Console

from grasp.cli import live, view
from grasp.control.fault import Fault
from grasp.control.states import State
from grasp.run.loop import Tick
from scenarios.report.run_view import facts
from scenarios.trial.final_state import FinalState

SLIPPING = view.TickView(
    t_s=107.31, phase="compensate", slip="REGISTERED (masked)", registered=True, event=True,
    estimated_n=(10.0, 5.0, 5.0), probabilities=[0.93, 0.5, 0.02], positions=(155, 100, 100),
    arm_m=0.312,
)  # fmt: skip


def output(width: int, shown_view: view.TickView = SLIPPING) -> list[str]:
    console = Console(width=width, force_terminal=True, color_system=None)
    with console.capture() as capture:
        console.print(view.panel(shown_view, console.width))
    return capture.get().splitlines()


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_bars_fit_into_any_width(width: int) -> None:
    lines = output(width)
    assert len(lines) == 5
    assert all(len(line) <= width for line in lines)
    assert not any("…" in line for line in lines[1:])
    cells = min((width - view.TEXT_CELLS) // 2, view.BAR_CELLS)
    assert [line.count("█") + line.count("·") for line in lines[1:4]] == [2 * cells] * 3
    assert "155 counts" in lines[1]


@pytest.mark.parametrize(
    ("forces", "mode", "lines"),
    [
        (
            {"peak_force_n": {"A": 21.84, "B": 11.0, "C": 10.8}}, "each_motor",
            ["peak force A 21.8, B 11.0, C 10.8 N (true); commanded 10.0 N",
             "limit 10 N on each motor: the thumb bears the sum of B and C, about 20 N"],
        ),
        (
            {"peak_force_n": None, "peak_estimated_n": {"A": 9.0, "B": 4.5, "C": 4.0}},
            "every_finger",
            ["peak force A 9.0, B 4.5, C 4.0 N (estimated by the fingertips); commanded 10.0 N",
             "limit 10 N on each finger"],
        ),
    ],
)  # fmt: skip
def test_verdict_states_the_peak_of_every_finger_and_which_limit_applies(
    forces: dict[str, object], mode: str, lines: list[str]
) -> None:
    assert facts(verdict(limit_mode=mode, **forces))[-2:] == lines


def verdict(**changes: object) -> SimpleNamespace:
    values = {
        "success": False, "outcome": "dropped", "object": "can", "rig": "emulated",
        "seed": 3, "end": None,
        "detection_latency_ms": None, "slip_distance_m": None, "paused_s": 0.0,
        "peak_force_n": {"A": 1.0}, "peak_estimated_n": None, "commanded_force_n": 10.0,
        "force_limit_n": 10.0, "limit_mode": "every_finger", "recording": None, "grip": None,
        "faults": (Fault("lost", "trial", "contact lost on the way down", kind="lost"),),
    }  # fmt: skip
    return SimpleNamespace(**(values | changes))


def test_verdict_of_a_fault_names_its_code_and_device() -> None:
    faults = (Fault("stale", "arm", "the arm sends no data", kind="stale"),)
    output = live.verdict(verdict(outcome="fault", faults=faults))
    assert output.startswith("\nFAILED: stale (arm)  (can, rig emulated, seed 3)\n")


def test_status_lines_pause_while_a_question_is_open(capsys: pytest.CaptureFixture[str]) -> None:
    operator = SimpleNamespace(asking=True)
    slip = SimpleNamespace(event=False, registered=False, masked=False, armed=False)
    tick = SimpleNamespace(
        t_ns=0, decision=SimpleNamespace(slip=slip, state=State.HOLD),
        estimated_n=(0.0, 0.0, 0.0), observation=SimpleNamespace(probabilities=np.zeros(3)),
        gripper=SimpleNamespace(positions=(0, 0, 0)), arm=SimpleNamespace(position_m=(0, 0, 0)),
    )  # fmt: skip
    with live.Display("simulated", quiet=False, operator=operator) as display:

        def lines() -> int:
            for _ in range(2 * live.STATUS_TICKS):
                display.tick(cast(Tick, tick))
            return len(capsys.readouterr().out.splitlines())

        assert lines() == 1  # the start of the phase
        operator.asking = False
        assert lines() == 2


def test_verdict_of_an_object_that_was_lost_ends_with_arm_and_hand_and_the_way_out() -> None:
    closed = FinalState(
        "the arm is stationary", "the hand is closed", "to let go, run `grasp release`"
    )
    output = live.verdict(verdict(end=closed))
    assert output.startswith("\nFAILED: dropped  (can, rig emulated, seed 3)\n")
    assert output.endswith(
        "  lost: contact lost on the way down\n  the arm is stationary; the hand is closed\n"
        "  to let go, run `grasp release`"
    )
    opened = live.verdict(verdict(end=FinalState("the arm is stationary", "the hand is open", "")))
    assert opened.endswith("  the arm is stationary; the hand is open")


class FakeView:
    """Fake viewer that records its messages."""

    def __init__(self) -> None:
        self.taken: list[view.Message] = []

    def take(self, message: view.Message) -> None:
        self.taken.append(message)

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("brief", "phases", "shown"), [(True, "aaabb", 0), (False, "aaabb", 2), (False, "a" * 101, 3)]
)
def test_one_trial_shows_phases_and_a_series_only_registrations(
    brief: bool, phases: str, shown: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown_view = FakeView()
    monkeypatch.setattr(view, "Lines", lambda: shown_view)
    monkeypatch.setattr(view, "tick_view", lambda *_: SLIPPING)
    display = live.Display(
        "simulated", quiet=False, operator=SimpleNamespace(asking=False), brief=brief
    )
    for phase in phases:
        decision = SimpleNamespace(state=phase, slip=SimpleNamespace(event=None))
        display.tick(SimpleNamespace(decision=decision))
    assert len(shown_view.taken) == shown
    event = SimpleNamespace(state=phases[-1], slip=SimpleNamespace(event="slip"))
    display.tick(SimpleNamespace(decision=event))
    assert len(shown_view.taken) == shown + 1
