"""What a lift through spoilt wires is judged by: made-up ones in which one thing was not so."""

import msgspec
import pytest

from scenarios.world.truth import Truth
from tests.wire.scenarios.chaos.one_lift import Ended, config, stated_s
from tests.wire.scenarios.chaos.onlooker import Left, Look, left
from tests.wire.scenarios.chaos.plans import Trouble
from tests.wire.scenarios.chaos.proxy import Passed
from tests.wire.scenarios.chaos.verdict import (
    AWAY_S,
    GONE_S,
    dropped,
    judged,
    problems,
    takes_the_hand,
)
from tests.wire.scenarios.chaos.waits import Wait

TIPS, GRIPPER, ARM = 8, 2, 26  # plans: hardly any trouble of the fingertips; of that wire alone
MILD = 104  # of the gripper's wire, over which the hand can be told all the same
PRESSED_N = (9.8, 5.0, 5.0)  # of a hand that is closed to the limit


def seen(height_m: float, touched: bool, slip_m: float = 0.0, **more: float) -> Look:
    force_n = PRESSED_N if touched else (0.0, 0.0, 0.0)
    truth = Truth(
        t_ns=0, height_m=height_m, speed_mps=0.0, slip_distance_m=slip_m,
        slip_speed_mps=more.get("slip_mps", 0.0), normal_n=force_n, shear_n=(0.0, 0.0, 0.0),
        peak_n=force_n, slip_onset_s=None, force_rise_s=None, flank_slope=0.0,
    )  # fmt: skip
    return Look(
        truth, more.get("arm_mps", 0.0), more.get("fingers_mps", 0.0), 0.05 if touched else 0.0
    )


HELD = [seen(0.0, True), seen(0.03, True), *[seen(0.06, True, 0.002)] * 8]
LET_GO = [*HELD, seen(0.05, False), *[seen(0.0, False)] * 8]
SET_DOWN = [*HELD, seen(0.0, True), *[seen(0.0, False)] * 8]
NEVER_LIFTED = [seen(0.0, False)] * 12
OPEN = "the hand is open"
FELT = "2.0 N measured at finger A"
KEPT = "closed with the grip that it had, at (60, 55, 55) counts"
CLOSED = "the hand is closed to the limit of 10 N, its force is not measured"
ALONE = (
    f"the hand cannot be told anything and holds by itself: when last heard it was {KEPT}, {FELT}"
)


def later(looks: list[Look]) -> Left:
    return left(looks, len(looks) - 8)


def ended(**changed: object) -> Ended:
    """A lift through the plan that spoils the fingertips' wire, and ended as it must."""
    plain = Ended(
        TIPS, "fault", "stale", "stale: no fresh fingertip sample", "the arm stands", CLOSED, 9.0,
        10.1, later(HELD), [], Wait("after wait_placed", 0.2, 0.0), 0.0, Passed(writes=8),
    )  # fmt: skip
    return msgspec.structs.replace(plain, **changed)


def success(**changed: object) -> Ended:
    plain = ended(outcome="held", kind="", message="", arm="", hand="", left=later(SET_DOWN))
    return msgspec.structs.replace(plain, **changed)


def test_what_became_of_the_object_is_told_by_the_cell_alone() -> None:
    held = later(HELD)
    assert (held.object, held.let_go_m, dropped(held)) == ("held in the air", 0.0, "")
    assert held.slid_m == pytest.approx(0.002) and held.lifted_m == 0.06
    assert (held.pressed_n, held.opened, held.looks_later) == (9.8, False, 8)
    let_go = later(LET_GO)
    assert (let_go.object, dropped(let_go)) == ("on the table", "let go at 60 mm")
    set_down = later(SET_DOWN)
    assert (set_down.object, set_down.opened, dropped(set_down)) == ("on the table", True, "")
    assert "slid 30 mm" in dropped(left([*HELD, seen(0.03, True, 0.03)], 4))
    slides = left([*HELD, seen(0.059, True, 0.003, slip_mps=0.02)], 4)
    assert dropped(slides) == "slips"


def test_lifts_that_ended_as_they_must_are_not_blamed() -> None:
    settings = config()
    assert problems(ended(), settings) == []
    assert problems(success(), settings) == []
    not_opened = ended(
        number=ARM, outcome="not opened", kind="link_lost", message="RTDE port: no answer in time",
        arm="", hand="", left=Left(), peak_n=0.0, passed=Passed(),
    )  # fmt: skip
    assert problems(not_opened, settings) == []
    script = msgspec.structs.replace(not_opened, message="ur_rtde: Failed to start control script")
    assert problems(script, settings) == []
    board = msgspec.structs.replace(not_opened, number=TIPS, message="no TakkTile board at tcp://x")
    assert problems(board, settings) == []
    assert problems(msgspec.structs.replace(board, number=ARM), settings)


SETTINGS = config()
LATE = [Wait("ThreadedGripper.stop", 8.0, 5.0)]
FELL: dict[str, tuple[Ended, str]] = {
    "force byte": (ended(passed=Passed(writes=8, most_force=1)), "force byte 1 of 0"),
    "no write seen of a success": (success(passed=Passed()), "no command to the hand"),
    "no write seen of a hand that pressed": (ended(passed=Passed()), "no command to the hand"),
    "true force": (ended(peak_n=11.4), "11.4 N"),
    "seconds": (ended(seconds=stated_s(SETTINGS) + 0.1), f"{stated_s(SETTINGS) + 0.1:.1f} s"),
    "wait": (ended(overdue=LATE), "ThreadedGripper.stop: 8.0 s"),
    "arm moves": (
        ended(left=later([*HELD, seen(0.06, True, 0.002, arm_mps=0.01)])),
        "the arm moves at 0.0100 m/s after the end",
    ),
    "fingers move": (
        ended(left=later([*HELD, seen(0.06, True, 0.002, fingers_mps=0.02)])),
        "fingers move at 0.0200",
    ),
    "dropped": (ended(left=later(LET_GO)), "let go at 60 mm"),
    "nobody looked": (ended(left=Left()), "never there, in 0 looks"),
    "nobody looked after the end": (ended(left=left(HELD, len(HELD))), "nobody could look"),
    "one look after the end": (ended(left=left(HELD, len(HELD) - 1)), "1 after the end"),
    "kind": (ended(kind="internal"), "kind internal"),
    "outcome": (success(outcome="dropped"), "outcome 'dropped'"),
    "no outcome": (success(outcome=""), "outcome ''"),
    "never lifted": (success(left=later(NEVER_LIFTED)), "lifted 0 mm"),
    "not set down": (success(left=later(HELD)), "then held in the air"),
    "success that failed": (success(kind="stale", message="stale: gripper"), "held, and failed"),
    "no word": (ended(message=""), "no word of the cause"),
    "no word where nothing was opened": (ended(outcome="not opened", message=""), "no word"),
    "no words of ours of the arm": (ended(arm="the arm rests"), "no such arm: 'the arm rests'"),
    "no words of ours of the hand": (ended(hand=f"{OPEN}, I think"), "no such hand"),
    "another blamed where nothing was opened": (
        ended(outcome="not opened", message="the gripper does not answer", left=Left(), arm="",
              hand="", peak_n=0.0, passed=Passed()), "nothing is wrong with the gripper",
    ),
    "this computer blamed, which was there": (
        ended(message="the arm's worker process says nothing"), "nothing is wrong with the arm"
    ),
    "no word of the arm": (ended(arm=""), "no word of the arm"),
    "no word of the hand": (ended(hand=""), "no word of the hand"),
    "time-out of the run": (ended(message="the tactile run did not end in time"), "time-out"),
    "time-out of a phase": (ended(message="phase rest lasted longer than 30 s"), "time-out"),
    "detector blamed": (ended(message="detector_late: 0.4 s"), "nothing is wrong with the detect"),
    "another blamed": (ended(message="the arm is silent"), "nothing is wrong with the arm"),
    "nobody blamed": (ended(message="something happened"), "names nothing"),
    "left moving": (ended(arm="the arm is still moving at 0.09 m/s"), "the arm is left moving"),
    "hand said to move": (ended(hand="the hand is still moving, 2.0 N"), "hand is left moving"),
    "open and is not": (ended(hand=OPEN), "the hand is not open"),
    "closed and presses little": (
        ended(left=msgspec.structs.replace(later(HELD), pressed_n=3.0)), "not closed to the limit",
    ),
    "feels nothing and presses": (
        ended(hand="the hand is partly closed, at (25, 40, 40) counts, and feels nothing"),
        "it feels something",
    ),
    "closed with a grip and empty": (
        ended(hand=f"the hand is {KEPT}, 2.0 N", left=later(NEVER_LIFTED)),
        "it holds nothing",
    ),
    "arm unheard": (ended(arm="the arm stood when last heard"), "the arm was heard"),
    "arm doubted": (ended(arm="the arm says that it stands"), "the arm can be believed"),
    "arm stopped": (
        ended(arm="the arm is stopped by its own safety system"), "no safety system stopped"
    ),
    "hand unheard": (ended(hand=ALONE), "the hand was heard"),
    "hand doubted": (ended(hand="the hand is not believed, and may"), "the hand can be believed"),
    "hand refuses": (ended(hand="the hand refuses every motion (x)"), "the hand refuses nothing"),
    "hand inactive": (ended(hand="the hand is not activated and"), "the hand is activated"),
    "hand reports": (ended(hand="the hand reports x: it is"), "the hand reports nothing"),
}  # fmt: skip


@pytest.mark.parametrize("what", FELL)
def test_what_must_not_be_after_a_lift_is_found(what: str) -> None:
    made, expected = FELL[what]
    assert expected in "; ".join(problems(made, SETTINGS))


def test_an_object_may_fall_only_where_the_hand_could_not_be_told_and_the_last_line_says_so() -> (
    None
):
    lost = later(LET_GO)
    plain = ended(number=GRIPPER, left=lost, hand=ALONE, message="stale: gripper status too old")
    assert problems(plain, SETTINGS) == []
    unbelieved = f"the hand is not believed, and may still move: it says that it is {KEPT}, {FELT}"
    assert problems(msgspec.structs.replace(plain, hand=unbelieved), SETTINGS)  # it can be told
    assert problems(msgspec.structs.replace(plain, number=MILD), SETTINGS)
    assert problems(msgspec.structs.replace(plain, hand=CLOSED), SETTINGS)  # not said
    assert problems(msgspec.structs.replace(plain, number=TIPS), SETTINGS)  # another wire


def test_lateness_of_a_device_whose_wire_is_well_is_excused_where_the_onlooker_was_kept_too() -> (
    None
):
    def kept(gap_s: float, message: str) -> list[str]:
        gap = msgspec.structs.replace(later(HELD), gap_s=gap_s)
        return problems(ended(number=ARM, left=gap, message=message), SETTINGS)

    assert kept(AWAY_S + 0.1, "stale: gripper status too old") == []
    assert kept(AWAY_S - 0.1, "stale: gripper status too old")
    assert kept(AWAY_S + 0.1, "the gripper reports fault 0x0E")


@pytest.mark.parametrize(
    "message",
    ["the arm's worker process says nothing",
     "the program on the arm controller has ended: for 0.30 s this computer did not keep it alive "
     "in time"],
)  # fmt: skip
def test_this_computer_may_be_blamed_only_where_the_onlooker_was_kept_waiting_too(
    message: str,
) -> None:
    def told(gap_s: float) -> list[str]:
        gap = msgspec.structs.replace(later(HELD), gap_s=gap_s)
        return problems(ended(left=gap, message=message), SETTINGS)

    assert (told(AWAY_S + 0.1), bool(told(AWAY_S - 0.1))) == ([], True)


def test_only_a_wait_shortly_before_the_end_is_an_excuse() -> None:
    def waited(at: int) -> float:
        times_s = [0.05 * k + (0.5 if k >= at else 0.0) for k in range(300)]
        looks = [msgspec.structs.replace(HELD[-1], at_s=at_s) for at_s in times_s]
        return left(looks, 290).gap_s

    assert waited(250) == pytest.approx(0.55)
    assert waited(100) == pytest.approx(0.05)


def test_a_wire_takes_the_hand_where_it_is_cut_garbled_or_slower_than_an_answer_may_be() -> None:
    def takes(wire: str = "gripper", **spoilt: float) -> bool:
        return takes_the_hand(Trouble(wire, 0.0, 600.0, **spoilt), 0.4)  # type: ignore[arg-type]

    assert takes(reset_share=0.001) and takes(twice_share=0.001)
    assert takes(latency_s=0.2) and not takes(latency_s=0.19)
    assert takes(jitter_s=0.02, slice_bytes=3) and not takes(jitter_s=0.02, slice_bytes=50)
    assert takes(bytes_per_s=150.0) and not takes(bytes_per_s=2_000.0)
    assert not takes("arm", reset_share=0.2) and not takes(slice_bytes=1)


def test_what_a_process_leaves_is_judged_whole() -> None:
    def left_by(code: int = 0, complaint: str = "", later_s: float = 0.0) -> str:
        said = "a line of the run\n" + msgspec.json.encode(ended()).decode() + "\n"
        return judged(TIPS, code, said, complaint, later_s, SETTINGS)[1]

    assert left_by() == ""
    assert "Traceback" in left_by(complaint="Traceback (most recent call last):\n")
    assert f"{TIPS}: " in left_by(code=1) and ": 1: " in left_by(code=1)
    assert "its process ended" in left_by(later_s=GONE_S + 1.0)
