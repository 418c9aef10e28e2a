"""A seeded sample of faults at moments of a lift, in virtual time (`make test-faults`).

`make test-faults RUNS=300 SEED=2` makes another sample, of so many cases in each scene, and as
many pairs of contradictory signals and wrong descriptions in proportion.
The complete sample writes studies/results/faults.csv.
"""

import csv
import os
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import pytest

from grasp.control.states import State
from scenarios.campaign.config import load_config
from tests.nightly.faults.cases import SCENES, Case, Fault, commands, faults, sample
from tests.nightly.faults.contradictions import OBJECTS, sample_descriptions, sample_pairs
from tests.nightly.faults.run import Ended, run, schedule
from tests.nightly.faults.verdict import fell, problems
from tests.nightly.last_line import MOST_N

RUNS, SEED = int(os.environ.get("RUNS", "20")), int(os.environ.get("SEED", "1"))
CUT = Fault("gripper", "link", "link", "cut")
FROZEN = Fault("arm", "state", "moving", "frozen")
UNPLUGGED = Fault("fingertips", "link", "link", "cut")
STOP_LOST = Fault("arm", "command", "stop", "lost")
OPENED, FORCED = (
    Fault("gripper", "registers", "all fingers", f"{what} by another client")
    for what in ("opened", "closed")
)


EVIDENCE = Path(__file__).parents[3] / "studies/results/faults.csv"
Sample = dict[tuple[str, int], list[Ended]]  # by scene


@pytest.fixture(scope="module")
def complete() -> Iterator[Sample]:
    """Collects the runs of every scene; writes them when all scenes ran."""
    ended: Sample = {}
    yield ended
    if ended.keys() == set(SCENES):
        write_csv(EVIDENCE, [e for each in ended.values() for e in each])


def write_csv(path: Path, ended: Sequence[Ended]) -> None:
    """One line per fault and state. The delay is the longest time from the safe state until arm and
    fingers were at rest."""
    groups = defaultdict(list)
    for end in ended:
        groups[str(end.case.fault), end.case.phase.value].append(end)
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(("fault", "state", "runs", "failures", "delay_s"))
        for (fault, state), group in sorted(groups.items()):
            rests = [s for end in group for s in (end.arm_s, end.hand_s) if s is not None]
            failures = sum(bool(fell(end)) for end in group)
            delay = f"{max(rests):.3f}" if rests else ""
            lines.writerow((fault, state, len(group), failures, delay))


@pytest.mark.timeout(600 + 30 * RUNS)
@pytest.mark.parametrize("scene", SCENES, ids=str)
def test_a_sample_of_faults_ends_well(scene: tuple[str, int], complete: Sample) -> None:
    complete[scene] = ended = [run(case) for case in sample(scene, schedule(*scene), RUNS, SEED)]
    assert {str(e.case): found for e in ended if (found := fell(e))} == {}
    assert [str(e.case) for e in ended if e.injected_in != e.case.phase] == []
    commanded = [e for e in ended if e.case.fault and e.case.fault.part == "command"]
    assert [str(e.case) for e in commanded if not e.taken] == []
    assert [str(e.case) for e in ended if e.case.safe and not e.taken_safe] == []


@pytest.mark.timeout(600 + 30 * RUNS)
@pytest.mark.parametrize("scene", SCENES, ids=str)
def test_signals_that_contradict_each_other_end_well(scene: tuple[str, int]) -> None:
    ended = [run(case) for case in sample_pairs(scene, schedule(*scene), 2 * RUNS + 4, SEED)]
    assert {str(e.case): found for e in ended if (found := fell(e))} == {}


@pytest.mark.timeout(600 + 30 * RUNS)
@pytest.mark.parametrize("name", OBJECTS)
def test_wrong_descriptions_end_well(name: str) -> None:
    body = load_config(name, "simulated").object
    told = {k: v for k, v in msgspec.structs.asdict(body).items() if isinstance(v, float)}
    ended = [run(case) for case in sample_descriptions(name, told, max(1, RUNS // 3), SEED)]
    assert {str(e.case): found for e in ended if (found := fell(e))} == {}


def test_a_sample_is_always_the_same_and_has_every_fault() -> None:
    stretches = schedule("can", 0)
    assert {s.phase for s in stretches} >= {State.BRACE, State.LIFT, State.DESCEND, State.OPEN}
    cases = sample(("can", 0), stretches, 2_000, 1)
    assert cases == sample(("can", 0), stretches, 2_000, 1)
    kinds = {(f.device, f.part, f.kind) for case in cases for f in case.faults}
    assert {(f.device, f.part, f.kind) for f in faults() + commands()} <= kinds


def changed(end: Ended, **changes: object) -> Ended:
    return msgspec.structs.replace(end, **changes)


def test_lost_stop_in_a_safe_state_is_accepted_if_it_is_reported() -> None:
    case = Case(0, "can", 0, UNPLUGGED, State.LIFT, 3, 73, False, STOP_LOST, 0, False, safe=True)
    found = run(case)
    assert (found.taken, found.taken_safe) == (0, True) and found.then_taken > 3
    assert "unstopped" in problems(found) and fell(found) == {}
    assert fell(changed(found, message="the tactile board is unplugged", unconfirmed=(),
                        arm="the arm is stationary"))  # fmt: skip


GONE = (
    "the hand cannot be commanded and holds by itself: at its last status it was closed with its "
    "previous grip, at (60, 55, 55) counts, 2.0 N measured at finger A"
)
WRONG: list[tuple[dict[str, object], str]] = [
    ({"lost_at_m": 0.0031}, "dropped"), ({"slid_m": 0.0151}, "dropped"),
    ({"height_m": 0.1, "later_pressed_n": 1.0, "slip_mps": 0.0011}, "dropped"),
    ({"peak_n": 11.01}, "force"), ({"later_arm_mps": 1e-4}, "moving"),
    ({"later_fingers_mps": 1e-4}, "moving"), ({"arm_mps": 1e-4}, "moving"),
    ({"safe_mps": 0.1, "safe_way_m": 0.0211, "arm_s": 0.1}, "unstopped"),
    ({"safe_mps": 0.1, "safe_way_m": 0.0199, "arm_s": 0.5}, "unstopped"),
    ({"hand_s": 3.07}, "unstopped"), ({"entered_n": 9.0, "least_n": 4.4}, "hand"),
    ({"finished": False}, "time-out"), ({"timed_out": True}, "time-out"),
    ({"outcome": "internal_error"}, "bug"), ({"outcome": "false_start"}, "missed"),
    ({"outcome": "held", "lost_at_m": 0.05}, "misleading"), ({"advice": ""}, "misleading"),
    ({"advice": "start the run again", "pressed_n": 1.1}, "misleading"),
    ({"arm": "the arm was stationary at its last status"}, "misleading"),
    ({"arm": ""}, "misleading"),
    ({"message": "all is well"}, "misleading"),
    ({"hand": GONE, "fingers_mps": 1e-4}, "misleading"),
    ({"message": "detector_failed: no"}, "misleading"),
]  # fmt: skip


def test_every_problem_is_found_and_only_reported_declared_ones_are_accepted() -> None:
    cut = run(Case(1, "can", 0, CUT, State.LIFT, 1, 4))
    assert problems(cut) == {}
    for changes, check in WRONG:
        assert check in problems(changed(cut, **changes)), changes
    slid = changed(cut, slid_m=0.03)
    assert problems(slid) and fell(slid) == {}  # the hand could not be commanded to close
    assert fell(changed(slid, peak_n=12.0))
    assert fell(changed(slid, hand="the hand is closed to the limit of 10 N", pressed_n=5.0))
    assert fell(changed(slid, case=msgspec.structs.replace(slid.case, recovers=True)))


@pytest.mark.parametrize(("fault", "most_n"), [(OPENED, 10.3), (FORCED, 11.5)], ids=str)
def test_single_write_of_another_client_is_overwritten_and_reported(
    fault: Fault, most_n: float
) -> None:
    for ticks in range(0, 49, 6):
        found = run(Case(0, "can", 0, fault, State.COMPENSATE, 1, ticks, True))
        assert found.peak_n < most_n and fell(found) == {}
        assert found.outcome == ("over_force" if found.peak_n > MOST_N else "fault")
        assert re.search(r"another client changed .*targets \(.*\), expected", found.message)


def test_regression_cases_end_well() -> None:
    for case in (
        Case(0, "can", 0, OPENED, State.HOLD, 1, 33, recovers=True),
        Case(0, "foam", 0, Fault("gripper", "state", "gMOD", "close"), State.BRACE),
        Case(0, "ball", 1, FROZEN, State.RETREAT),
        Case(
            0, "cardboard", 2, Fault("gripper", "state", "gDTA", "missing"), State.SETTLE,
            then=Fault("loop", "whole", "", "stands still 0.3 s"),
        ),
        Case(0, "can", 0, Fault("detector", "whole", "", "late"), State.SHAPE, 1, 11),
        Case(0, "box", 1, Fault("fingertips", "state", "finger B", "missing"), State.OPEN),
    ):  # fmt: skip
        found = run(case)
        assert found.outcome == "fault" and fell(found) == {}, case
