"""Runs of the fault campaign: a sample of all, and that sharing a lift changes none."""

import re
from pathlib import Path

import msgspec
import pytest

from drivers.errors import BadFile, CouldNotRecord
from grasp.guard import GuardSettings
from grasp.phases import Phase
from scenarios.studies.faults import store as store_module
from scenarios.studies.faults.cases import SCENES, TOUCHING, Case, Fault, by_scene, in_turn, plan
from scenarios.studies.faults.page import generated
from scenarios.studies.faults.run import Ended, goes, run, run_scene
from scenarios.studies.faults.schedule import SCHEDULE
from scenarios.studies.faults.store import FaultStore
from scenarios.studies.faults.verdict import MOST_N, declared, fell, misled, problems
from scenarios.studies.faults.wires import ArmWire
from scenarios.trial.ending import LOOK

SAMPLE = 40
MIXED = in_turn(plan(), seed=1)
BY_ANOTHER = [case for case in MIXED if case.fault and case.fault.part == "registers"][:8]
SAMPLES = by_scene([*MIXED[:SAMPLE], *BY_ANOTHER], SAMPLE)
CUT = Fault("gripper", "link", "link", "cut")
FROZEN = Fault("arm", "state", "moving", "frozen")


@pytest.mark.parametrize("lot", range(len(SAMPLES)))
def test_a_sample_of_all_faults_ends_well(lot: int) -> None:
    ended = run_scene(SAMPLES[lot])
    assert sorted(e.case.number for e in ended) == sorted(c.number for c in SAMPLES[lot])
    assert {str(e.case): found for e in ended if (found := fell(e))} == {}
    assert all(e.struck_in == (e.case.phase or "") for e in ended)
    assert all(e.taken for e in ended if e.case.fault and e.case.fault.part == "command")


SAFE = [case for case in plan() if case.safe]
HOLDS = [c for c in SAFE if c.object == "ball" and c.then is not None and c.then.what == "hold"]


@pytest.mark.parametrize(
    "lot",
    [pytest.param(HOLDS, id="holds of the ball"),
     *(pytest.param(lot, id=str(lot[0].number), marks=pytest.mark.slow)
       for lot in by_scene(SAFE, SAMPLE))],
)  # fmt: skip
def test_a_fault_that_is_to_take_a_safe_state_s_own_command_takes_it(lot: list[Case]) -> None:
    ended = run_scene(lot)
    assert len(ended) == len(lot) and HOLDS
    assert [str(e.case) for e in ended if not e.taken_safe] == []
    assert {str(e.case): found for e in ended if (found := fell(e))} == {}


def test_a_plain_lift_goes_as_its_schedule_says() -> None:
    assert goes("box", 6) == SCHEDULE["box", 6]


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES + TOUCHING, ids=str)
def test_every_plain_lift_goes_as_its_schedule_says(scene: tuple[str, int]) -> None:
    assert goes(*scene) == SCHEDULE[scene]


class Deaf(ArmWire):
    """It takes the stop that answers slip, and none after that."""

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        if "stop" not in self.heard:
            self.heard.add("stop")
            super().stop_l(deceleration_mps2, now_ns)

    def __init__(self) -> None:
        super().__init__()
        self.heard: set[str] = set()


UNPLUGGED = Fault("fingertips", "link", "link", "cut")


def test_an_arm_that_takes_no_stop_falls_though_it_stands_in_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("scenarios.studies.faults.run.ArmWire", Deaf)
    found = run(Case(0, "can", 0, UNPLUGGED, Phase.LIFT, 2, 73))
    assert "unstopped" in fell(found) and found.safe_way_m > 0.1 and found.later_arm_mps == 0.0
    assert "arm_goes_on" in found.message and LOOK in found.advice  # and the user is told


STOP_LOST = Fault("arm", "command", "stop", "lost")


def test_a_stop_that_is_lost_in_a_safe_state_is_named_and_told() -> None:
    case = Case(
        0, "can", 0, UNPLUGGED, Phase.LIFT, 2, 73, False, STOP_LOST, 0, False, safe=True
    )  # fmt: skip
    found = run(case)
    assert (found.taken, found.taken_safe) == (0, True) and found.then_taken > 3
    assert "unstopped" in problems(found) and fell(found) == {}
    assert fell(
        ended(found, message="the tactile board is unplugged", unreached=(), arm="the arm stands")
    )
    page = generated([found], ["abc"], "none")  # that it goes on for longer was named later
    assert "0 did what had been named before any run was looked at, 1 what was named after" in page
    assert "| before any run; unstopped **after it was seen** |" in page


@pytest.fixture(scope="module")
def lifted() -> list[Ended]:
    """Two that share a lift, and one that is never struck: this lift comes to no probe."""
    cases = [
        Case(1, "can", 0, CUT, Phase.LIFT, 1, 4),
        Case(2, "can", 0, FROZEN, Phase.RETREAT, 1, 20),
        Case(3, "can", 0, CUT, Phase.PROBE),
    ]  # fmt: skip
    return sorted(run_scene(cases), key=lambda ended: ended.case.number)


def test_a_run_that_shares_its_lift_with_others_is_the_run_alone(lifted: list[Ended]) -> None:
    assert [ended.case.number for ended in lifted] == [1, 2, 3]
    assert run(lifted[0].case) == lifted[0]


def test_an_arm_that_is_told_after_a_standstill_has_not_moved_before() -> None:
    still = Fault("loop", "whole", "", "stands still 3 s")
    found = run(Case(0, "box", 1, still, Phase.LIFT))
    assert found.message.startswith("loop_stood_still")
    assert found.lifted_m == 0.0 and found.slid_m == 0.0 and problems(found) == {}


def test_what_a_fault_led_to_is_told(lifted: list[Ended]) -> None:
    cut, frozen, none = lifted
    assert (cut.outcome, cut.phase, cut.struck) == ("fault", "lift", True)
    assert "gripper does not answer" in cut.message and "holds by itself" in cut.hand
    assert cut.noticed_s == 0.01 and cut.later_arm_mps == 0.0
    assert cut.struck_in == "lift" and cut.arm_s is not None and cut.arm_s > 0.0
    assert cut.entered_n is not None and cut.least_n is not None
    assert 1.0 < cut.least_n <= cut.entered_n  # it presses on, as the first grasp did
    assert frozen.message.startswith("arm_frozen") and frozen.phase == "retreat"
    assert (none.outcome, none.struck, none.struck_in) == ("held_within_6cm", False, "")
    assert none.entered_n is None and none.least_n is None


OPENED = Fault("gripper", "registers", "all fingers", "opened by another client")
FORCED = Fault("gripper", "registers", "all fingers", "closed by another client")


@pytest.mark.parametrize(
    ("fault", "most_n"),
    [(OPENED, 10.3), (FORCED, 11.5)],  # 20.1 and 65.5 N as long as it was not written over
    ids=str,
)
def test_what_another_client_writes_once_is_written_over_and_told_with_its_values(
    fault: Fault, most_n: float
) -> None:
    ticks = range(0, 55, 6)
    struck = [Case(t, "can", 0, fault, Phase.COMPENSATE, 1, t, recovers=True) for t in ticks]
    for found in run_scene(struck):
        assert found.peak_n < most_n and fell(found) == {}
        assert found.outcome == ("over_force" if found.peak_n > MOST_N else "fault")
        assert re.search(r"another client changed .*targets \(.*\), expected", found.message)


def test_a_force_of_another_client_beyond_the_limit_is_the_verdict_and_its_writes_the_cause() -> (
    None
):
    found = run(Case(0, "ball", 1, FORCED, Phase.COMPENSATE, 1, 18))
    assert found.peak_n > MOST_N and found.outcome == "over_force"
    assert "another client changed the gripper's registers" in found.message and found.hand


# what fell once
MENDED = [
    # it had closed by all motors, 20.1 N, for rICF was taken for written
    Case(0, "can", 0, OPENED, Phase.COMPENSATE, 1, 4, recovers=True),
    # it had opened in the air
    Case(0, "can", 0, OPENED, Phase.HOLD, 1, 33, recovers=True),
    Case(0, "foam", 0, Fault("gripper", "state", "gMOD", "jump"), Phase.GRASP),
    Case(0, "can", 0, Fault("gripper", "state", "gMOD", "jump"), Phase.LISTEN, 1, 20),
    Case(0, "ball", 1, FROZEN, Phase.RETREAT),
    # a finger that says that it moves and does not is doubted only after the standstill
    Case(
        0, "cardboard", 2, Fault("gripper", "state", "gDTA", "missing"), Phase.RELAX,
        then=Fault("loop", "whole", "", "stands still 0.3 s"),
    ),
    # steps of 0.12 s: the hand has not had the time to answer
    Case(0, "can", 0, Fault("detector", "whole", "", "late"), Phase.APPROACH, 1, 11),
    # what was felt last is not what the hand feels that has begun to open
    Case(0, "box", 1, Fault("fingertips", "state", "finger B", "missing"), Phase.RELEASE),
]  # fmt: skip


@pytest.mark.parametrize("case", MENDED, ids=str)
def test_what_fell_once_stands(case: Case) -> None:
    found = run(case)
    assert found.outcome == "fault" and fell(found) == {}


def ended(plain: Ended, **changed: object) -> Ended:
    return msgspec.structs.replace(plain, **changed)


GONE = "the hand cannot be told anything and holds by itself: when last heard it was "
KEPT = "closed with the grip that it had, at (60, 55, 55) counts"
EMPTY = "closed as it was told, at (60, 55, 55) counts, and feels nothing: "
EMPTY += "the object may still be in it"
GONE += f"{KEPT}, 2.0 N measured at finger A"
WRONG: list[tuple[dict[str, object], str]] = [
    ({"let_go_m": 0.0031}, "dropped"), ({"let_go_m": 0.049}, "dropped"),
    ({"slid_m": 0.0151}, "dropped"), ({"slid_m": 0.029}, "dropped"),
    ({"height_m": 0.1, "later_pressed_n": 1.0, "slip_mps": 0.0011}, "dropped"),
    ({"peak_n": 11.01}, "force"), ({"peak_n": 11.29}, "force"),
    ({"later_arm_mps": 1e-4}, "moving"), ({"later_fingers_mps": 1e-4}, "moving"),
    ({"arm_mps": 1e-4, "arm": "the arm is still moving at 0.00 m/s"}, "moving"),
    ({"safe_mps": 0.1, "safe_way_m": 0.0201, "arm_s": 0.1}, "unstopped"),
    ({"safe_mps": 0.1, "safe_way_m": 0.0199, "arm_s": 0.32}, "unstopped"),
    ({"hand_s": 3.07}, "unstopped"),
    ({"least_n": 0.05}, "hand"), ({"entered_n": 9.0, "least_n": 4.4}, "hand"),
    # told nothing, a hand that obeys presses as weakly as before
    ({"fault": "unplugged", "entered_n": 2.2, "least_n": 2.2, "pressed_n": 2.2}, "hand"),
    ({"finished": False}, "time-out"), ({"outcome": "internal_error"}, "bug"),
    ({"outcome": ""}, "bug"), ({"outcome": "interrupted"}, "bug"),
    ({"outcome": "false_start"}, "missed"), ({"outcome": "dropped"}, "missed"),
    ({"cause": "phase x lasted longer than 30 s"}, "time-out"),
]  # fmt: skip
# by what is not so: what is said, and the least that makes it wrong
LIES: list[tuple[str, dict[str, object]]] = [
    ("the arm moves", {"arm": "the arm stands", "arm_mps": 1e-4}),
    ("last line the arm is left moving", {"arm": "the arm is still moving at 0.10 m/s"}),
    ("the arm was heard", {"arm": "the arm stood when last heard"}),
    ("the arm can be believed", {"arm": "the arm says that it stands"}),
    ("the arm moves, and no safety",
     {"arm": "the arm is stopped by its own safety system", "arm_mps": 1e-4}),
    ("no safety system stopped the arm", {"arm": "the arm is stopped by its own safety system"}),
    ("the hand is not open", {"hand": "the hand is open", "pressed_n": 1.1}),
    ("it is not closed to the limit",
     {"hand": "the hand is closed to the limit of 10 N, 9 N measured", "pressed_n": 6.9}),
    ("it feels something",
     {"hand": "the hand is partly closed, and feels nothing", "pressed_n": 1.1}),
    ("it feels something", {"hand": f"the hand is {EMPTY}", "pressed_n": 9.6}),
    ("it holds nothing", {"hand": f"the hand is {KEPT}, 2.0 N measured",
                          "pressed_n": 0.05}),
    ("it is not closed to the limit",
     {"hand": "the hand is closed to its last count, within the limit of 10 N, 9 N measured",
      "pressed_n": 0.0, "phase": "rest"}),
    ("it feels less", {"hand": f"the hand is {KEPT}, 9.9 N measured at finger A",
                       "pressed_n": 3.0}),
    ("it was not lifted", {"outcome": "held", "lifted_m": 0.02}),
    ("no such arm", {"arm": ""}), ("no such arm", {"arm": "the arm was told nothing"}),
    ("no such hand", {"hand": ""}), ("no such hand", {"hand": "the hand is well"}),
    ("no such advice", {"advice": "go home"}), ("no such arm", {"outcome": "held", "arm": ""}),
    ("nothing is wrong with the detector", {"message": "detector_failed: no"}),
    ("nothing is wrong with the detector", {"message": "gripper_silent; then detector_late: 1"}),
    ("the fingers move", {"hand": GONE, "fingers_mps": 1e-4}),
    ("it let go", {"hand": GONE, "pressed_n": 0.05}),
    ("the hand is left moving", {"hand": "the hand is still moving, 2.0 N measured at finger A"}),
    ("the hand was heard", {"hand": GONE, "case": "arm"}),
    ("the hand refuses nothing",
     {"hand": "the hand refuses every motion (x) and holds by itself: it is", "case": "arm"}),
    ("the hand can be believed",
     {"hand": "the hand is not believed, and may still move: it says that it is", "case": "arm"}),
    ("the hand is activated",
     {"hand": "the hand is not activated and holds by itself: it is open", "case": "arm"}),
    ("the hand reports nothing", {"hand": "the hand reports x: it is open", "case": "arm"}),
    ("nobody is told to look", {"advice": "open the hand", "arm": "the arm says that it stands",
                                "later_arm_mps": 1e-4}),
    ("nobody is told what to do", {"advice": ""}),
    ("it says to start with a hand that holds",
     {"advice": "start the run again", "pressed_n": 1.1}),
    ("nothing was missed", {"unreached": ("the arm still moves",)}),
    ("it was dropped", {"outcome": "held", "let_go_m": 0.05}),
    ("no word", {"message": ""}),
    ("nothing is wrong with the detector", {"cause": "detector_failed: no"}),
    ("names nothing: all is well", {"cause": "all is well"}),
]  # fmt: skip


@pytest.mark.parametrize(("what", "changed"), LIES, ids=[what for what, _ in LIES])
def test_a_sentence_that_is_not_so_is_found(
    what: str, changed: dict[str, object], lifted: list[Ended]
) -> None:
    case = lifted[0].case
    if changed.get("case") == "arm":
        changed = {**changed, "case": msgspec.structs.replace(case, fault=FROZEN), "cause": ""}
    assert what in misled(ended(lifted[0], **changed))


SO: list[dict[str, object]] = [
    {"arm": "the arm stands"}, {"arm": "the arm is still moving at 0.10 m/s", "arm_mps": 0.1},
    {"hand": "the hand is still moving, 2.0 N measured at finger A", "fingers_mps": 0.1},
    {"hand": GONE}, {"advice": "start the run again", "pressed_n": 0.9},
]  # fmt: skip


@pytest.mark.parametrize("changed", SO)
def test_a_sentence_that_is_so_is_none(changed: dict[str, object], lifted: list[Ended]) -> None:
    assert misled(ended(lifted[0], **changed)) == ""


WITHIN: list[dict[str, object]] = [
    {"let_go_m": 0.003}, {"slid_m": 0.015}, {"peak_n": 11.0}, {"entered_n": 9.0, "least_n": 4.6},
    {"safe_mps": 0.1, "safe_way_m": 0.0199, "arm_s": 0.3}, {"hand_s": 3.05},
    {"height_m": 0.1, "later_pressed_n": 1.0, "slip_mps": 0.0009},
    {"least_n": 0.0, "phase": "oppose"}, {"least_n": 0.0, "phase": "release"},
]  # fmt: skip


@pytest.mark.parametrize("changed", WITHIN)
def test_what_is_within_its_bound_is_not_found(
    changed: dict[str, object], lifted: list[Ended]
) -> None:
    assert problems(ended(lifted[0], **changed)) == {}


def test_the_bound_of_force_is_the_guard_s() -> None:
    assert MOST_N == GuardSettings().force_limit_n + GuardSettings().overshoot_n == 11.0


def test_of_a_pair_the_half_that_is_named_must_explain_what_fell(lifted: list[Ended]) -> None:
    case = msgspec.structs.replace(lifted[0].case, fault=UNPLUGGED, then=CUT)
    slid = ended(lifted[0], case=case, slid_m=0.03)
    assert fell(slid) == {}
    silent = ended(slid, cause="stale: no frame", message="no frame", arm="the arm is not heard",
                   hand="")  # fmt: skip
    assert fell(silent)
    lost = Fault("gripper", "command", "close", "lost")
    never = ended(slid, case=msgspec.structs.replace(case, then=lost))
    assert fell(never)  # no command was taken
    assert fell(ended(never, then_taken=1)) == {}


def test_an_object_that_falls_while_nobody_is_in_control_is_no_excuse(lifted: list[Ended]) -> None:
    for fault in (Fault("loop", "whole", "", "stands still 3 s"),
                  Fault("detector", "whole", "", "hears nothing")):  # fmt: skip
        case = msgspec.structs.replace(lifted[0].case, fault=fault)
        slid = ended(lifted[0], case=case, slid_m=0.03, outcome="dropped", message="dropped",
                     cause="loop_stood_still", arm="", hand="")  # fmt: skip
        assert "dropped" in fell(slid)


@pytest.mark.parametrize(("changed", "check"), WRONG)
def test_what_must_not_be_is_found(
    changed: dict[str, object], check: str, lifted: list[Ended]
) -> None:
    assert problems(lifted[0]) == {}
    if changed.get("fault") == "unplugged":
        case = msgspec.structs.replace(lifted[0].case, fault=UNPLUGGED)
        changed = {**{k: v for k, v in changed.items() if k != "fault"}, "case": case}
    assert check in problems(ended(lifted[0], **changed))


def test_a_hand_that_opens_may_go_on_opening(lifted: list[Ended]) -> None:
    assert "hand" not in problems(ended(lifted[0], least_n=0.0, phase="release"))
    assert "hand" not in problems(ended(lifted[0], least_n=0.0, entered_n=0.0))


def test_only_what_was_named_beforehand_and_is_told_does_not_count(lifted: list[Ended]) -> None:
    slid = ended(lifted[0], slid_m=0.03)
    found = declared(slid, problems(slid))
    assert found is not None and found.name == "the hand cannot be told to close"
    assert fell(slid) == {}
    assert fell(ended(slid, peak_n=12.0))  # not that as well
    silent = ended(slid, hand="the hand is closed to the limit of 10 N", unreached=())
    assert fell(msgspec.structs.replace(silent, pressed_n=9.0))
    passes = msgspec.structs.replace(slid.case, recovers=True)
    assert fell(ended(slid, case=passes))


def test_rows_are_kept_and_only_what_lacks_is_run(lifted: list[Ended], tmp_path: Path) -> None:
    cases, out = plan()[:3], tmp_path / "a.sqlite"
    row = ended(lifted[0], case=cases[1])
    with FaultStore(out, writes=True) as store:
        assert store.lacking(cases) == cases
        store_module.add(out, row, "abc")
        store_module.add(out, ended(row, case=msgspec.structs.replace(cases[2], ticks=99)), "def")
        assert store.lacking(cases, {"def"}) == [cases[0], cases[2]]
        assert store.lacking(cases, {"abc", "def"}) == cases  # made with another commit
        with FaultStore(tmp_path / "a.sqlite") as beside:
            assert len(beside.ended()) == 1
    with FaultStore(tmp_path / "a.sqlite") as store:
        assert store.ended() == [row]
        assert store.lacking(cases) == [cases[0], cases[2]]  # another plan's is none
        assert store.codes() == ["abc", "def"]


def test_each_run_of_a_lot_is_on_the_disk_before_the_next_and_none_after_a_disk_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, tries, whole = tmp_path / "a.sqlite", list[int](), store_module.add

    def add(path: Path, row: Ended, code: str) -> None:
        tries.append(row.case.number)
        if len(tries) == 2:
            raise CouldNotRecord("the disk is full", "free it")
        whole(path, row, code)

    monkeypatch.setattr(store_module, "add", add)
    # what is struck in the beginning: a lift that was stopped there is short
    early = [c for c in plan() if c.fault and c.phase is Phase.APPROACH and (c.object, c.seed)
             == ("can", 0)][:3]  # fmt: skip
    with FaultStore(out, writes=True) as store:
        with pytest.raises(CouldNotRecord, match="the disk is full"):
            store_module.make(store_module.Lot(early, out, "abc"))
        assert [row.case.number for row in store.ended()] == tries[:1]
        assert len(tries) == 2


def test_a_row_that_cannot_be_written_names_the_file(lifted: list[Ended], tmp_path: Path) -> None:
    with pytest.raises(CouldNotRecord, match=r"a\.sqlite: no such table"):
        store_module.add(tmp_path / "a.sqlite", lifted[0], "abc")


def test_a_file_that_holds_no_rows_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.sqlite").write_bytes(b"")
    with (
        pytest.raises(BadFile, match=r"a\.sqlite: no such table"),
        FaultStore(tmp_path / "a.sqlite"),
    ):
        pass
