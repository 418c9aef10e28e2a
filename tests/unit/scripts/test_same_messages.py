"""A rename that is listed is no difference; every other change is one."""

from pathlib import Path

import pytest

from grasp.clock import VIRTUAL_EPOCH_NS
from grasp.phases import Phase
from scripts import same_messages
from scripts.same_messages import comparable, folded_into, phases_of, undated

ROOT = Path(__file__).parents[3]
NOW = {phase.value for phase in Phase}
FIRST = {"idle", "approach", "grasp", "lift", "compensate", "hold", "lower", "release", "fault"}
SETTLING = FIRST | {"rest", "squeeze", "settle", "retreat"}
LAST = b',"late_ns":0,"took_ns":0,"doubt":""'


def control(phase: str, more: bytes = LAST) -> same_messages.Contents:
    """One message of /control."""
    return {("/control", 0): (5, b'{"phase":"%s","slip":false%s}' % (phase.encode(), more))}


def same(old: same_messages.Contents, new: same_messages.Contents, known: set[str]) -> bool:
    before, after = comparable(old, new, folded_into(known, NOW))
    return before == after


def test_the_phases_of_a_tree_are_read_from_its_table() -> None:
    assert phases_of(ROOT) == NOW


def test_every_phase_that_was_part_of_another_is_one_of_now_or_led_to_one() -> None:
    wholes = {whole for _, whole in same_messages.PARTS}
    assert {part for part, _ in same_messages.PARTS} <= NOW | wholes


def test_phases_that_both_trees_tell_apart_are_compared_as_they_stand() -> None:
    taken_as_one = {
        (before, now) for before in NOW for now in NOW if same(control(before), control(now), NOW)
    }
    assert taken_as_one == {(phase, phase) for phase in NOW}


@pytest.mark.parametrize(
    ("known", "before", "now"),
    [
        (FIRST, "approach", "rest"),
        (FIRST, "grasp", "oppose"),
        (FIRST, "grasp", "squeeze"),
        (FIRST, "grasp", "relax"),
        (FIRST, "grasp", "listen"),
        (FIRST, "release", "retreat"),
        (FIRST, "idle", "done"),
        (SETTLING, "hold", "kept"),
        (SETTLING, "approach", "home"),
        (SETTLING, "settle", "relax"),
        (SETTLING, "settle", "listen"),
        (SETTLING, "grasp", "oppose"),
    ],
)
def test_a_phase_that_was_part_of_another_is_counted_as_that_one(
    known: set[str], before: str, now: str
) -> None:
    assert same(control(before), control(now), known)
    assert not same(control("lift"), control(now), known)


def test_a_phase_that_is_now_another_differs_however_old_the_tree() -> None:
    assert not same(control("settle"), control("squeeze"), SETTLING)
    assert not same(control("approach"), control("grasp"), FIRST)


def test_a_rename_is_made_on_the_old_side_alone() -> None:
    old, new = (
        {("/tap", 0): (0, b'{"%s":1.0}' % name)} for name in (b"impulse_ns", b"impulse_n_s")
    )
    assert same(old, new, NOW)
    assert same(new, new, NOW)
    assert not same(new, old, NOW)


def test_fields_are_left_out_only_beside_a_tree_that_had_none_and_only_while_they_say_nothing() -> (
    None
):
    late = b',"late_ns":7,"took_ns":0,"doubt":""'
    assert same(control("lift", b""), control("lift"), NOW)
    assert not same(control("lift", b""), control("lift", late), NOW)
    assert not same(control("lift", late), control("lift"), NOW)
    assert not same(control("lift"), control("lift", b""), NOW)


def test_a_field_is_left_out_of_its_own_topic_whatever_another_has_said() -> None:
    hand = {("/gripper", 0): (0, b'{"seq":1}')}
    timed = {("/gripper", 0): (0, b'{"seq":1,"took_ns":0}')}
    assert same(hand | control("lift"), timed | control("lift"), NOW)
    assert not same(timed | control("lift"), hand | control("lift"), NOW)
    late = {("/gripper", 0): (0, b'{"seq":1,"took_ns":5}')}
    assert not same(hand | control("lift"), late | control("lift"), NOW)


def test_when_the_arm_sampled_is_compared_only_with_a_tree_that_recorded_it() -> None:
    arm, other = ({("/arm", 0): (0, b'{"seq":1%b}' % more)} for more in (b"", b',"moving":true'))
    dated, later = (
        {("/arm", 0): (0, b'{"seq":1,"sampled_ns":%d}' % t_ns)} for t_ns in (8_000_000, -16)
    )
    assert same(arm | control("lift"), dated | control("lift"), NOW)
    assert same(arm | control("lift"), later | control("lift"), NOW)
    assert not same(other | control("lift"), dated | control("lift"), NOW)
    assert not same(dated | control("lift"), later | control("lift"), NOW)
    pads = {("/tactile", 0): (0, b'{"seq":1,"sampled_ns":8}')}
    assert not same(arm | {("/tactile", 0): (0, b'{"seq":1}')}, dated | pads, NOW)


def test_a_date_is_no_difference_and_another_time_since_the_start_is() -> None:
    assert undated(VIRTUAL_EPOCH_NS + 6_410_000_000) == undated(6_410_000_000) == 6_410_000_000
    assert undated(VIRTUAL_EPOCH_NS + 6_420_000_000) != undated(6_410_000_000)


def test_a_run_that_leaves_no_message_is_no_equal_of_another(tmp_path: Path) -> None:
    main = tmp_path / "grasp" / "cli" / "main.py"
    main.parent.mkdir(parents=True)
    for folder in (main.parent, main.parents[1]):
        (folder / "__init__.py").touch()
    main.write_text("def main():\n    print('{}')\n    return 1\n")
    with pytest.raises(SystemExit, match="left no message"):
        same_messages.record(tmp_path, ("lift", "--object", "can"), tmp_path / "runs")
