"""What a person sees of a run fits the terminal."""

from types import SimpleNamespace

import msgspec
import numba
import pytest
from rich.console import Console

from detector.motion import Motion
from grasp.cli import live, view
from scenarios.trial.ending import End

SLIPPING = view.Glimpse(
    t_s=107.31, phase="compensate", slip="REGISTERED (masked)", registered=True, news=True,
    measured_n=(10.0, 5.0, 5.0), probabilities=[0.93, 0.5, 0.02], positions=(155, 100, 100),
    arm_m=0.312,
)  # fmt: skip


def drawn(width: int, seen: view.Glimpse = SLIPPING) -> list[str]:
    console = Console(width=width, force_terminal=True, color_system=None)
    with console.capture() as capture:
        console.print(view.panel(seen, console.width))
    return capture.get().splitlines()


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_bars_are_whole_whatever_the_width(width: int) -> None:
    lines = drawn(width)
    assert len(lines) == 5
    assert all(len(line) <= width for line in lines)
    assert not any("…" in line for line in lines[1:])
    cells = min((width - view.TEXT_CELLS) // 2, view.BAR_CELLS)
    assert [line.count("█") + line.count("·") for line in lines[1:4]] == [2 * cells] * 3
    assert "155 counts" in lines[1]


def test_what_kind_of_slip_it_is_stands_with_the_finger_that_feels_it_and_below() -> None:
    motion = Motion([0.012, 0.02, 0.05], [45, 180, 0], [0.1, 0.2, 0.3])
    seen = msgspec.structs.replace(
        SLIPPING, kind=view.kind_text(motion), ways=view.ways_text(motion)
    )
    for width in (60, 80, 200):
        lines = drawn(width, seen)
        assert len(lines) == 5 and all(len(line) <= width for line in lines)
        for line, way in zip(lines[1:4], "↗←→", strict=True):
            assert f"{way} " in line
        assert "some 20 mm/s" in lines[4]  # the finger in the middle speaks for the hand
    assert (view.kind_text(None), view.ways_text(None)) == ("", "   ")


@pytest.mark.parametrize("width", [60, 80, 200])
def test_which_of_several_trials_it_is_stands_below(width: int) -> None:
    seen = msgspec.structs.replace(SLIPPING, trial="trial 3 of 20", kind="some 20 mm/s")
    lines = drawn(width, seen)
    assert len(lines) == 5 and all(len(line) <= width for line in lines)
    assert "trial 3 of 20 · some 20 mm/s" in lines[4]
    assert "trial" not in "".join(drawn(width))


def test_line_above_the_panel_fits_eighty_columns() -> None:
    line = view.short_line(SLIPPING)
    assert len(line) <= 80
    assert "REGISTERED (masked)" in line and "10.0" in line


@pytest.mark.parametrize("rig", ["simulated", "emulated", "hardware"])
@pytest.mark.parametrize("hand", [True, False])
def test_setting_up_is_one_line_and_speaks_of_a_gripper_only_where_one_is_activated(
    rig: str, hand: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[view.Message] = []
    display = live.Display(rig, quiet=True)
    monkeypatch.setattr(display, "tell", told.append)
    display.setting_up(hand)
    (busy,) = told
    assert isinstance(busy, view.Busy)
    assert len(busy.text) <= 78  # beside its spinner
    # no run activates a real one
    assert ("gripper" in busy.text) == (hand and rig == "emulated")


def test_line_and_its_end_are_one_write(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[str] = []
    monkeypatch.setattr("sys.stdout.write", written.append)
    view.Lines().take(view.Note("lift 0    held"))
    view.Lines().take(SLIPPING)
    assert written[0] == "lift 0    held\n"
    assert len(written) == 2 and written[1].endswith("(masked)\n")


@pytest.mark.parametrize(("late_ms", "says"), [(51.0, "51 ms after"), (-314.1, "314 ms before")])
def test_slip_registered_before_its_onset_is_told_so(late_ms: float, says: str) -> None:
    result = SimpleNamespace(
        detection_latency_ms=late_ms, reaction_latency_ms=None, slip_distance_m=None,
        peak_force_n={"A": 1.0}, peak_measured_n={"A": 1.0}, commanded_force_n=10.0,
        force_limit_n=10.0, cap_mode="every_finger", paused_s=0.0,
    )  # fmt: skip
    assert live.facts(result)[0] == f"slip registered {says} its onset"


def test_slip_is_told_as_finely_as_a_person_reads_it() -> None:
    told = live.facts(verdict(slip_distance_m=0.0015, turned_rad=None))
    assert "the object slipped 1.5 mm" in told


@pytest.mark.parametrize(
    ("forces", "mode", "lines"),
    [
        (
            {"peak_force_n": {"A": 21.84, "B": 11.0, "C": 10.8}}, "each_motor",
            ["peak force A 21.8, B 11.0, C 10.8 N (true); commanded 10.0 N",
             "limit 10 N, each_motor: the thumb bears what B and C press, about 20 N"],
        ),
        (
            {"peak_force_n": None, "peak_measured_n": {"A": 9.0, "B": 4.5, "C": 4.0}},
            "every_finger",
            ["peak force A 9.0, B 4.5, C 4.0 N (estimated by the fingertips); commanded 10.0 N",
             "limit 10 N, every_finger: no finger shall bear more"],
        ),
    ],
)  # fmt: skip
def test_verdict_states_the_peak_of_every_finger_and_which_limit_applies(
    forces: dict[str, object], mode: str, lines: list[str]
) -> None:
    assert live.facts(verdict(cap_mode=mode, **forces))[-2:] == lines


def verdict(**changes: object) -> SimpleNamespace:
    told = {
        "success": False, "outcome": "dropped", "object": "can", "seed": 3, "end": None,
        "detection_latency_ms": None, "slip_distance_m": None, "paused_s": 0.0,
        "peak_force_n": {"A": 1.0}, "peak_measured_n": None, "commanded_force_n": 10.0,
        "force_limit_n": 10.0, "cap_mode": "every_finger", "recording": None,
    }  # fmt: skip
    return SimpleNamespace(**(told | changes))


def test_verdict_of_an_object_that_was_lost_ends_with_arm_and_hand_and_the_way_out(
    capsys: pytest.CaptureFixture[str],
) -> None:
    closed = End("the arm stands", "the hand is closed", "to let go, run `grasp release`")
    live.print_verdict(verdict(end=closed))
    said = capsys.readouterr().out
    assert said.startswith("\nFAILED: dropped  (can, seed 3)\n")
    assert said.endswith("  the arm stands; the hand is closed\n  to let go, run `grasp release`\n")
    live.print_verdict(verdict(end=End("the arm stands", "the hand is open", "")))
    assert capsys.readouterr().out.endswith("  the arm stands; the hand is open\n")


class Seen:
    """In place of what draws: what it was given."""

    def __init__(self) -> None:
        self.taken: list[view.Message] = []

    def take(self, message: view.Message) -> None:
        self.taken.append(message)

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("brief", "phases", "shown"), [(True, "aaabb", 0), (False, "aaabb", 2), (False, "a" * 101, 3)]
)
def test_lines_of_one_trial_follow_its_phases_and_those_of_many_only_registrations(
    brief: bool, phases: str, shown: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = Seen()
    monkeypatch.setattr(view, "make", lambda _: seen)
    monkeypatch.setattr(view, "glimpse", lambda *_: SLIPPING)
    display = live.Display("simulated", quiet=False, plain=True, brief=brief)
    for phase in phases:
        decision = SimpleNamespace(phase=phase, slip=SimpleNamespace(event=None))
        display.tick(SimpleNamespace(decision=decision))
    assert len(seen.taken) == shown
    event = SimpleNamespace(phase=phases[-1], slip=SimpleNamespace(event="slip"))
    display.tick(SimpleNamespace(decision=event))
    assert len(seen.taken) == shown + 1


def test_lines_above_a_panel_are_of_one_colour(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    panel = view.Panel()
    panel.take(SLIPPING)
    panel.take(view.Note("seed 3: held, 12 mm"))
    panel.close()
    said = capsys.readouterr().out
    assert "\x1b[" in said
    assert view.short_line(SLIPPING) in said and "seed 3: held, 12 mm" in said


def test_only_who_waits_for_the_world_to_be_compiled_is_told_of_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    grown = numba.njit(lambda x: x + 1)
    for compiled in (True, False):
        with live.Display("simulated", quiet=False, plain=True) as display:
            display.setting_up()
            assert grown(1) == 2
        told = capsys.readouterr().out
        assert "setting up" in told and ("the world is compiled" in told) == compiled
