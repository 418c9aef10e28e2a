"""Runs of the fault campaign: a sample of all, and that sharing a lift changes none."""

from pathlib import Path

import msgspec
import pytest

from grasp.phases import Phase
from scenarios.studies.faults.cases import Case, Fault, by_scene, in_turn, plan
from scenarios.studies.faults.run import Ended, run, run_scene
from scenarios.studies.faults.store import FaultStore
from scenarios.studies.faults.verdict import declared, fell, problems

SAMPLE = 40
SAMPLES = by_scene(in_turn(plan(), seed=1)[:SAMPLE], SAMPLE)
CUT = Fault("gripper", "link", "link", "cut")
FROZEN = Fault("arm", "state", "moving", "frozen")


@pytest.mark.parametrize("lot", range(len(SAMPLES)))
def test_a_sample_of_all_faults_ends_well(lot: int) -> None:
    ended = run_scene(SAMPLES[lot])
    assert sorted(e.case.number for e in ended) == sorted(c.number for c in SAMPLES[lot])
    assert {str(e.case): found for e in ended if (found := fell(e))} == {}


@pytest.fixture(scope="module")
def lifted() -> list[Ended]:
    """Two that share a lift, and one that is never struck: this lift comes to no probe."""
    cases = [
        Case(1, "can", 0, CUT, Phase.LIFT, 4), Case(2, "can", 0, FROZEN, Phase.RETREAT, 20),
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


# what fell once
MENDED = [
    Case(0, "foam", 0, Fault("gripper", "state", "gMOD", "jump"), Phase.GRASP),
    Case(0, "can", 0, Fault("gripper", "state", "gMOD", "jump"), Phase.LISTEN, 20),
    Case(0, "ball", 1, FROZEN, Phase.RETREAT),
]


@pytest.mark.parametrize("case", MENDED, ids=str)
def test_what_fell_once_stands(case: Case) -> None:
    found = run(case)
    assert found.outcome == "fault" and fell(found) == {}


def ended(plain: Ended, **changed: object) -> Ended:
    return msgspec.structs.replace(plain, **changed)


WRONG = [
    ({"let_go_m": 0.05}, "dropped"), ({"slid_m": 0.03}, "dropped"), ({"peak_n": 11.3}, "force"),
    ({"later_arm_mps": 0.01}, "moving"), ({"later_fingers_mps": 0.01}, "moving"),
    ({"least_n": 0.0}, "hand"), ({"finished": False}, "time-out"),
    ({"cause": "phase x lasted longer than 30 s"}, "time-out"),
    ({"arm": "the arm stands", "arm_mps": 0.1}, "misleading"),
    ({"hand": "the hand is open", "pressed_n": 2.0}, "misleading"),
    ({"hand": "the hand is partly closed, and feels nothing", "pressed_n": 2.0}, "misleading"),
    ({"cause": "detector_failed: no"}, "misleading"), ({"message": ""}, "misleading"),
    ({"outcome": "held", "let_go_m": 0.05}, "misleading"),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "check"), WRONG)
def test_what_must_not_be_is_found(
    changed: dict[str, object], check: str, lifted: list[Ended]
) -> None:
    assert problems(lifted[0]) == {}
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
    cases = plan()[:3]
    row = ended(lifted[0], case=cases[1])
    with FaultStore(tmp_path / "a.sqlite", writes=True) as store:
        assert store.lacking(cases) == cases
        store.add(row, "abc")
        store.add(ended(row, case=msgspec.structs.replace(cases[2], ticks=99)), "def")
        with FaultStore(tmp_path / "a.sqlite") as beside:
            assert len(beside.ended()) == 1
    with FaultStore(tmp_path / "a.sqlite") as store:
        assert store.ended() == [row]
        assert store.lacking(cases) == [cases[0], cases[2]]  # another plan's is none
        assert store.codes() == ["abc", "def"]
