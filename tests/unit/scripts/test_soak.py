"""What an hour of lifts is judged by: made-up hours in which one thing was not as it must be."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from scenarios.world.truth import Truth
from scripts import soak
from scripts.soak import Fate
from scripts.soak_verdict import (
    MOST_GROWTH_MB_H,
    MOST_SPREAD_MB,
    After,
    Count,
    Lift,
    Soak,
    growing,
    tell,
    wrong,
)

EACH_S = 14.0  # a lift
DOWN = After(0.0, 0.0, 0.0, True, 0.0, 0.0)
GRIPPED = After(0.0, 0.0, 9.8, False, 0.06, 0.0)
KEPT = "the hand is closed with the grip that it had, at (60, 55, 55) counts"
LIMIT = "the hand is closed to the limit of 10 N, its force is not measured"
ALONE = (
    "the hand cannot be told anything and holds by itself: when last heard it was closed to the "
    "limit of 10 N, 9.5 N measured at finger A"
)
STANDS = "the arm stands"
HELD = Lift(
    1, "can", "", "held", "", "", "", 1_000, 2, 0, 10.2, 0.0, 0.0, EACH_S, "", 0.001, DOWN
)  # fmt: skip
STRUCK = replace(
    HELD, seed=2, struck="gripper_disconnect in hold", outcome="fault", kind="link_lost",
    message="gripper: connection closed", told=ALONE, arm=STANDS, after=GRIPPED,
)  # fmt: skip


def at(number: int, made: Lift) -> Lift:
    """The same, in its place of the hour."""
    return replace(made, begun_s=number * EACH_S, ended_s=(number + 1) * EACH_S)


def counted(**grows: float) -> list[Count]:
    """Once a lift, the memory of one that holds what it held, or as much more an hour."""
    return [
        Count(t_s, 200.0 + grows.get("resident_mb", 0.0) * t_s / 3600.0, 24, 5, 5,
              470.0 + grows.get("children_mb", 0.0) * t_s / 3600.0,
              {"cell": 160.0, "page": 115.0 + grows.get("page_mb", 0.0) * t_s / 3600.0})
        for t_s in (number * EACH_S for number in range(257))
    ]  # fmt: skip


LIFTS = [at(0, HELD), at(1, STRUCK)] + [
    at(n, replace(STRUCK if n % 4 == 1 else HELD, seed=n + 1)) for n in range(2, 257)
]
HOUR = Soak(60.0, True, LIFTS, counted(), (360_000, 3), [9e3, 9.1e3, 9.2e3], [], 0, 60_000)


def of(made: Lift, **changes: Any) -> Soak:
    """The hour in which one lift, that of its seed, was so."""
    changed = at(made.seed - 1, replace(made, **changes))
    return replace(HOUR, lifts=[changed if m.seed == made.seed else m for m in HOUR.lifts])


def test_an_hour_in_which_all_was_well_is_not_blamed() -> None:
    assert wrong(HOUR) == []
    assert tell(HOUR) == 0


@pytest.mark.parametrize("made", [HELD, STRUCK])
@pytest.mark.parametrize(
    "outcome",
    ["dropped", "expelled", "over_force", "", "not opened", "internal_error", "interrupted"],
)
def test_what_no_lift_may_end_as_is_told_struck_or_not(made: Lift, outcome: str) -> None:
    assert len(wrong(of(made, outcome=outcome))) == 1


@pytest.mark.parametrize("made", [HELD, STRUCK])
def test_a_true_force_past_limit_and_overshoot_is_told_whatever_the_outcome(made: Lift) -> None:
    assert any("13.0 N" in text for text in wrong(of(made, peak_n=13.0)))


def test_an_object_let_go_in_the_air_is_told_unless_the_hand_could_not_be_told_to_hold() -> None:
    assert wrong(of(HELD, let_go_m=0.05)) != []
    assert wrong(of(STRUCK, let_go_m=0.05)) == []
    assert wrong(of(STRUCK, let_go_m=0.05, told=LIMIT)) != []
    assert wrong(of(STRUCK, struck="gripper_delay in hold")) == []
    assert wrong(of(STRUCK, struck="gripper_delay in hold", let_go_m=0.05)) != []  # it obeys
    arm = {"struck": "arm_freeze in hold", "message": "the arm is silent", "told": LIMIT}
    assert wrong(of(STRUCK, **arm)) == []
    assert wrong(of(STRUCK, let_go_m=0.05, **arm)) != []


def test_a_struck_lift_that_blames_another_device_is_told() -> None:
    assert wrong(of(STRUCK, message="arm: a protective stop")) != []


@pytest.mark.parametrize(
    ("kind", "message"),
    [("stale", "stale: gripper status too old"), ("safety_stop", "loop_stood_still: for 0.4 s")],
)
def test_lateness_is_excused_only_while_the_idle_loop_missed_too(kind: str, message: str) -> None:
    late = of(HELD, outcome="fault", kind=kind, message=message, told=LIMIT, arm=STANDS,
              after=GRIPPED)  # fmt: skip
    assert len(wrong(late)) == 1  # it missed three, long after
    assert wrong(replace(late, idle_late_s=[EACH_S - 5.9])) == []
    assert wrong(replace(late, idle_late_s=[EACH_S - 6.1]))  # long before it ended


def test_a_fault_that_is_no_lateness_is_told_however_much_the_idle_loop_missed() -> None:
    failed = of(HELD, outcome="fault", kind="device_fault", message="gripper fault 0x0E",
                told=LIMIT, arm=STANDS, after=GRIPPED)  # fmt: skip
    found = wrong(replace(failed, idle_late_s=[EACH_S - 1.0]))
    assert any("failed by itself" in text for text in found)


@pytest.mark.parametrize("made", [HELD, STRUCK])
@pytest.mark.parametrize(
    "message",
    ["the gripper run did not end in time", "phase grasp lasted longer than 30 s; gripper"],
)
def test_what_a_time_out_ended_is_told_struck_or_not(made: Lift, message: str) -> None:
    assert any("ended by a time-out" in text for text in wrong(of(made, message=message)))


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"message": ""}, "no word of the cause"),
        ({"message": "something"}, "names nothing"),
        ({"message": "gripper_silent: 0.8 s; detector_late: 0.4 s"}, "wrong with the detector"),
        ({"message": "loop_stood_still: for 0.4 s nobody was in control"}, "wrong with the loop"),
        ({"told": ""}, "no word of the hand"),
        ({"told": f"{ALONE}, perhaps"}, "no such hand"),
        ({"arm": "the arm rests"}, "no such arm: 'the arm rests'"),
        ({"told": "the hand is open"}, "the hand is not open"),
        ({"told": "the hand is partly closed, and feels nothing"}, "it feels something"),
        ({"told": "the hand is still moving, 2.0 N"}, "the hand is left moving"),
        ({"arm": ""}, "no word of the arm"),
        ({"arm": "the arm is still moving at 0.09 m/s"}, "the arm is left moving"),
        ({"arm": "the arm stood when last heard"}, "the arm was heard"),
        ({"told": LIMIT, "after": replace(GRIPPED, pressed_n=2.0)}, "not closed to the limit"),
        (
            {
                "told": KEPT,
                "after": DOWN,
            },
            "it holds nothing",
        ),
        (
            {
                "told": KEPT,
                "after": None,
                "peak_n": 0.0,
            },
            "holds nothing",
        ),
    ],
)
def test_a_last_line_that_is_not_so_is_told(changes: dict[str, Any], found: str) -> None:
    assert any(found in text for text in wrong(of(STRUCK, **changes)))


def test_a_last_line_may_say_that_a_device_was_late_while_the_machine_was_not_there() -> None:
    late = of(STRUCK, message="gripper_silent; loop_stood_still: for 0.4 s",
              arm="the arm stood when last heard")  # fmt: skip
    assert len(wrong(late)) == 1
    assert wrong(replace(late, idle_late_s=[2 * EACH_S - 1.0])) == []


@pytest.mark.parametrize("made", [HELD, STRUCK])
@pytest.mark.parametrize(
    ("moves", "found"),
    [({"arm_mps": 0.01}, "the arm moves at 0.0100"), ({"fingers_mps": 0.01}, "the fingers move")],
)
def test_what_moves_after_the_end_is_told(made: Lift, moves: dict[str, float], found: str) -> None:
    assert made.after is not None
    assert any(found in text for text in wrong(of(made, after=replace(made.after, **moves))))


def test_an_object_that_slides_in_the_air_is_told_unless_the_hand_could_not_be_told_to_hold() -> (
    None
):
    assert any("slid 40 mm" in text for text in wrong(of(HELD, slid_m=0.04)))
    sliding = replace(GRIPPED, slip_mps=0.02)
    assert any("goes on sliding" in text for text in wrong(of(STRUCK, after=sliding, told=LIMIT)))
    assert wrong(of(STRUCK, slid_m=0.04, after=sliding)) == []


def test_what_becomes_of_an_object_is_told_from_look_to_look() -> None:
    def seen(height_m: float, slip_m: float, touched: bool = True) -> Truth:
        force_n = (9.0, 4.0, 4.0) if touched else (0.0, 0.0, 0.0)
        return Truth(
            t_ns=0, height_m=height_m, speed_mps=0.0, slip_distance_m=slip_m, slip_speed_mps=0.0,
            normal_n=force_n, shear_n=(0.0, 0.0, 0.0), peak_n=force_n, slip_onset_s=None,
            force_rise_s=None, flank_slope=0.0,
        )  # fmt: skip

    def fate(*looks: Truth) -> tuple[float, float]:
        told = Fate()
        for look in looks:
            told.see(look)
        return told.let_go_m, round(told.slid_m, 6)

    lifted = (seen(0.0, 0.0), seen(0.05, 0.001), seen(0.06, 0.003))
    assert fate(*lifted, seen(0.05, 0.0, touched=False)) == (0.06, 0.002)
    assert fate(*lifted, seen(0.04, 0.023)) == (0.0, 0.022)
    assert fate(*lifted, seen(0.0, 0.003), seen(0.0, 0.0, touched=False)) == (0.0, 0.002)


@pytest.mark.parametrize("made", [HELD, STRUCK])
def test_a_lift_that_nobody_looked_at_after_its_end_is_told(made: Lift) -> None:
    for changes in ({"after": None}, {"slid_m": None}):
        assert any("somebody looked at" in text for text in wrong(of(made, **changes)))


def test_a_success_that_nobody_saw_is_told() -> None:
    assert any("nobody saw it" in text for text in wrong(of(HELD, peak_n=None)))
    assert any("nobody saw it" in text for text in wrong(of(HELD, periods=0)))


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"lifts": []}, "0 lifts"),
        ({"lifts": LIFTS[:100]}, "100 lifts"),
        ({"lifts": [made for made in LIFTS if not made.struck]}, "0 struck lifts"),
        ({"lifts": [at(n % 50, made) for n, made in enumerate(LIFTS)]}, "seconds"),
        ({"counts": []}, "0 counts"),
        ({"counts": counted()[:100]}, "100 counts"),
        ({"counts": [replace(c, t_s=c.t_s / 9.0) for c in counted()]}, "0 counts after ten"),
        ({"idle": (0, 0)}, "0 periods of the idle loop"),
        ({"idle": (100_000, 3)}, "100003 periods of the idle loop"),
        ({"seen_rows": None}, "who looked at the page had ended"),
        ({"seen_rows": 9}, "saw 9 rows"),
        ({"left": ["4711"]}, "left behind: process 4711"),
    ],
)
def test_an_hour_in_which_too_little_was_done_or_seen_is_told(
    changes: dict[str, Any], found: str
) -> None:
    assert any(found in text for text in wrong(replace(HOUR, **changes)))


def test_memory_that_grows_by_half_a_float_a_tick_is_told() -> None:
    for name in ("resident_mb", "children_mb", "page_mb"):
        most = MOST_GROWTH_MB_H
        assert growing(replace(HOUR, counts=counted(**{name: most - 0.5}))) == []
        found = wrong(replace(HOUR, counts=counted(**{name: most + 0.5})))
        assert found == [f"{name} grows by {most + 0.5:.1f} MB an hour"]


def test_a_process_that_grows_while_another_shrinks_is_named() -> None:
    counts = [
        replace(c, each_mb={**c.each_mb, "cell": 160.0 - 9.0 * c.t_s / 3600.0})
        for c in counted(page_mb=9.0)
    ]
    assert growing(replace(HOUR, counts=counts)) == ["page_mb grows by 9.0 MB an hour"]


def test_an_hour_that_was_counted_before_each_process_was_is_told_as_ever(tmp_path: Path) -> None:
    out = tmp_path / "soak.json"
    old = msgspec.to_builtins(HOUR)
    for each in old["counts"]:
        del each["each_mb"]
    out.write_bytes(msgspec.json.encode(old))
    assert wrong(soak.read(out)) == []


def test_each_other_process_is_counted_as_what_it_is() -> None:
    waits = "import sys; sys.stdin.read()"
    with (
        soak.beside(("-c", waits, soak.ROLES["page"])),
        soak.beside(("-c", waits, soak.ROLES["cell"])),
        soak.beside(("-c", waits)),
    ):
        counted_now = soak.count(time.monotonic())
    assert set(counted_now.each_mb) >= {"page", "cell", "other"}
    assert min(counted_now.each_mb.values()) > 0.0
    assert sum(counted_now.each_mb.values()) == pytest.approx(counted_now.children_mb)


def test_memory_that_comes_and_goes_is_told_though_it_is_as_it_was_in_the_end() -> None:
    for more_mb in (MOST_SPREAD_MB - 1.0, MOST_SPREAD_MB + 1.0, 200.0):
        hump = [
            replace(c, resident_mb=c.resident_mb + more_mb * (2_000 < c.t_s < 2_300))
            for c in counted()
        ]
        told = growing(replace(HOUR, counts=hump))
        assert (f"resident_mb: 200 to {200.0 + more_mb:.0f} MB" in told) is (
            more_mb > MOST_SPREAD_MB
        )


@pytest.mark.parametrize("name", ["descriptors", "threads", "children"])
def test_one_more_descriptor_thread_or_process_after_ten_minutes_is_told_and_before_is_not(
    name: str,
) -> None:
    for from_s, told in ((300.0, 0), (3_000.0, 1)):
        counts = [replace(c, **{name: getattr(c, name) + (c.t_s > from_s)}) for c in counted()]
        first = [replace(c, **{name: 1}) for c in counts if c.t_s <= from_s < 600.0]
        changed = replace(HOUR, counts=[*first, *counts[len(first) :]])
        assert len(wrong(changed)) == told


@pytest.mark.parametrize("made", [HELD, STRUCK])
def test_periods_missed_far_beyond_those_of_the_idle_loop_are_told(made: Lift) -> None:
    alike = [
        replace(m, periods=700, missed=300) if bool(m.struck) is bool(made.struck) else m
        for m in HOUR.lifts
    ]
    assert len(wrong(replace(HOUR, lifts=alike))) == 1


def test_a_row_that_the_page_was_not_told_is_told() -> None:
    assert len(wrong(replace(HOUR, lost_rows=5_000))) == 1


def test_what_is_wrong_makes_the_command_fail(capsys: pytest.CaptureFixture[str]) -> None:
    assert tell(replace(HOUR, lost_rows=1)) == 1
    assert "WRONG" in capsys.readouterr().out


def test_an_hour_in_which_nothing_was_struck_says_that_it_tells_nothing_of_faults(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tell(replace(HOUR, minutes=2.0, lifts=LIFTS[:1]))
    assert "none was struck, so this tells nothing of faults" in capsys.readouterr().out
    tell(HOUR)
    assert "none was struck" not in capsys.readouterr().out


def test_periods_missed_beside_an_idle_loop_that_missed_none_are_told_with_what_that_means() -> (
    None
):
    late = [replace(m, periods=700, missed=300) for m in HOUR.lifts]
    found = wrong(replace(HOUR, lifts=late))
    assert any("other work on the machine" in text and "docs/testing.md" in text for text in found)


def asked(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["soak.py", *words])
    return soak.main()


@pytest.mark.parametrize("minutes", ["nan", "inf", "0", "-1", "many"])
def test_minutes_that_are_no_time_are_refused_before_anything_begins(
    minutes: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit) as ended:
        asked(monkeypatch, "run", "--minutes", minutes)
    assert ended.value.code == 2


def test_a_file_that_cannot_be_written_is_refused_before_the_first_lift(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(soak, "soak", None)  # it would be called
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file" / "soak.json", tmp_path):
        assert asked(monkeypatch, "run", "--out", str(out)) == 2
        assert f"soak: {out}: " in capsys.readouterr().err
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.parametrize("text", [None, b"", b"[1]", b"\xff"])
def test_a_file_without_lifts_is_named(
    text: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "soak.json"
    if text is not None:
        out.write_bytes(text)
    assert asked(monkeypatch, "tell", "--out", str(out)) == 2
    assert capsys.readouterr().err.startswith(f"soak: {out}: ")


def test_lifts_are_kept_as_they_come_and_told_of_once_a_minute_until_ctrl_c(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, now_s = tmp_path / "soak.json", [0.0]

    def some(minutes: float, only: Sequence[str], keep: soak.Keep) -> Soak:
        for number in range(1, 10):
            now_s[0] += EACH_S
            keep(replace(HOUR, minutes=minutes, lifts=LIFTS[:number]))
            assert len(soak.read(out).lifts) == number
        os.kill(os.getpid(), signal.SIGINT)
        return HOUR

    monkeypatch.setattr(soak, "soak", some)
    monkeypatch.setattr(soak.time, "monotonic", lambda: now_s[0])
    assert asked(monkeypatch, "run", "--out", str(out)) == 130
    said = capsys.readouterr()
    assert said.err == f"soak: 9 lifts kept in {out}\n"
    assert said.out.splitlines() == [
        "1 of 60 min: 5 lifts, 1 struck, 0.2% of their periods missed, 0 failed by themselves",
        "2 of 60 min: 9 lifts, 2 struck, 0.2% of their periods missed, 0 failed by themselves",
    ]
    assert os.listdir(tmp_path) == ["soak.json"]


def test_faults_of_ones_choice_strike_every_lift_and_all_of_them_now_and_then() -> None:
    chosen, any_of_all = soak.Draw(["unplug", "arm_freeze"]), soak.Draw([])
    struck = [due for due in (chosen.due() for _ in range(200)) if due is not None]
    assert len(struck) == 200
    assert {(phase, fault["name"]) for phase, fault in struck} == {
        (phase, name) for phase in soak.PHASES for name in ("unplug", "arm_freeze")
    }
    now_and_then = [due for due in (any_of_all.due() for _ in range(1000)) if due is not None]
    assert {fault["name"] for _, fault in now_and_then} == {one["name"] for one in soak.FAULTS}
    assert len(now_and_then) == pytest.approx(1000 / soak.BETWEEN, rel=0.2)
    assert chosen.seeds() != chosen.seeds()


def still_there(mark: str) -> list[str]:
    """Processes with this in their environment."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            found += [path.parent.name] if mark.encode() in path.read_bytes().split(b"\0") else []
    return found


@pytest.mark.slow
def test_one_ctrl_c_for_the_whole_group_ends_all_and_keeps_the_lifts_that_were_over(
    tmp_path: Path,
) -> None:
    out, mark = tmp_path / "soak.json", f"SOAK_TEST={tmp_path}"  # that all inherit
    command = (
        "env",
        mark,
        sys.executable,
        soak.__file__,
        "run",
        "--minutes",
        "30",
        "--out",
        str(out),
    )
    going = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True)
    try:
        while not out.exists() or not soak.read(out).counts:
            assert going.poll() is None
            time.sleep(0.2)
        assert len(still_there(mark)) > 3
        os.killpg(going.pid, signal.SIGINT)
        said = going.communicate(timeout=90.0)[1]
    finally:
        going.kill()
    kept = soak.read(out)
    lifts = len(kept.lifts)
    assert set(kept.counts[-1].each_mb) == set(soak.ROLES)
    assert said == f"soak: {lifts} lifts kept in {out}\n"
    assert going.returncode == 130
    assert lifts >= 1
    assert still_there(mark) == []
