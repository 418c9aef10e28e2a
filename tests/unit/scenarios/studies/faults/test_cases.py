"""The plan of the fault campaign: generated, whole, and the same every time."""

from collections import Counter
from itertools import product

import msgspec

from drivers.robotiq.model.registers import AxisStatus, HandStatus, Request, decode, encode
from drivers.ur.driver import ArmSample
from grasp.phases import Phase
from scenarios.studies.faults.cases import (
    ARM_FIELDS,
    AXES,
    COMMAND,
    COMMANDS,
    LINK,
    OF_AN_AXIS,
    PAIRS,
    PHASES,
    SCENES,
    SECOND_LIFT,
    SHARES,
    STATE,
    STRETCHES,
    TAXEL,
    TAXELS,
    TOUCHING,
    VECTORS,
    Fault,
    by_scene,
    commands,
    faults,
    in_turn,
    plan,
    scheduled,
    sites,
    subtle,
    written_by_another,
)
from scenarios.studies.faults.registers import COMMAND_FIELDS, FIELDS, IMAGES
from scenarios.studies.faults.schedule import SCHEDULE, line, read

EVERY = plan()
ALL_FAULTS = faults() + subtle() + written_by_another()
STRUCK = [case for case in EVERY if case.fault is not None]
ALONE = [c for c in STRUCK if c.then is None and c.fault is not None and c.fault.part != "command"]
COMMANDED = [
    c for c in STRUCK if c.then is None and c.fault is not None and c.fault.part == "command"
]
SAFE = [case for case in STRUCK if case.safe]


def whole(fault: Fault | None) -> Fault | None:
    """As it was before one of the taxels or axes was drawn."""
    if fault is None:
        return None
    what, _, drawn = fault.what.partition(" ")
    return (
        msgspec.structs.replace(fault, what=what) if drawn and what in (*VECTORS, TAXEL) else fault
    )


def test_over_nine_thousand_runs_are_planned_and_always_the_same() -> None:
    assert len(EVERY) > 9000
    assert plan() == EVERY
    assert [case.number for case in EVERY] == list(range(len(EVERY)))
    assert sum(case.then is not None and not case.safe for case in EVERY) == PAIRS


def test_every_fault_strikes_every_stretch_of_a_lift_at_three_moments() -> None:
    struck = Counter((whole(case.fault), (case.phase, case.visit)) for case in ALONE)
    assert struck == dict.fromkeys(product(ALL_FAULTS, STRETCHES), len(SHARES))
    assert {Phase.LOWER, Phase.RELEASE, Phase.GRASP, Phase.COMPENSATE} <= set(PHASES)
    assert SECOND_LIFT in STRETCHES


def test_every_case_strikes_in_its_own_phase_of_its_scene() -> None:
    for case in STRUCK:
        assert case.phase is not None
        stretch = scheduled((case.object, case.seed), case.phase, case.visit)
        assert stretch is not None and 0 <= case.ticks < stretch.ticks, case


def test_moments_are_shares_of_a_stretch() -> None:
    second = {case.ticks for case in ALONE if (case.phase, case.visit) == SECOND_LIFT}
    assert second == {0, 73, 146, 147}  # of some 220 steps
    first = {c.ticks for c in ALONE if (c.phase, c.visit) == (Phase.LIFT, 1)}
    assert max(first) == 6  # of 5 to 10


def test_every_command_is_struck_where_it_is_sent_with_recovery_and_without() -> None:
    places = {
        (what, *stretch, tick) for (what, stretch, _), at in sites().items() for _, _, tick in at
    }
    for case in COMMANDED:
        assert case.fault is not None
        assert (case.fault.what, case.phase, case.visit, case.ticks) in places
    struck = {(c.fault, (c.phase, c.visit), c.recovers) for c in COMMANDED}
    meant = {
        (fault, stretch, recovers)
        for (what, stretch, _), fault, recovers in product(sites(), commands(), (False, True))
        if fault.what == what
    }
    assert struck == meant
    sent = {what for what, _, _ in sites()}
    assert sent == {what for names in COMMANDS.values() for what in names} - {"hold"}


def test_a_safe_state_s_own_commands_are_struck_hold_and_stop_among_them() -> None:
    for case in SAFE:
        assert case.fault is not None and case.fault.part != "command" and case.then_ticks == 0
    stops = {(c.then, (c.phase, c.visit), c.then_recovers) for c in SAFE if c.then.what == "stop"}  # type: ignore[union-attr]
    meant = [fault for fault in commands() if fault.what == "stop"]
    assert stops == set(product(meant, STRETCHES, (False, True)))
    held = {c.phase for c in SAFE if c.then is not None and c.then.what == "hold"}
    assert {Phase.APPROACH, Phase.GRASP, Phase.RELEASE} <= held


def test_vectors_are_struck_along_every_axis_in_every_way_that_one_number_can_be_wrong() -> None:
    drawn = {(c.fault.what, c.fault.kind) for c in ALONE if c.fault and c.fault.device == "arm"}
    for what, axis, kind in product(VECTORS, AXES, OF_AN_AXIS):
        assert (f"{what} {axis}", kind) in drawn and (what, kind) not in drawn


def test_taxels_are_drawn_from_all_eighteen() -> None:
    drawn = {case.fault.what for case in ALONE if case.fault is not None}
    assert len(TAXELS) == 18 and set(TAXELS) <= drawn and "taxel" not in drawn


def test_a_schedule_is_written_as_it_is_read() -> None:
    text = "\n".join(line(scene, stretches) for scene, stretches in SCHEDULE.items())
    assert read(text) == SCHEDULE
    assert set(SCHEDULE) == set(SCENES + TOUCHING)


def test_every_fault_in_every_phase_recovers_once_and_stays_once() -> None:
    struck = {(whole(case.fault), (case.phase, case.visit), case.recovers) for case in ALONE}
    assert struck == set(product(ALL_FAULTS, STRETCHES, (False, True)))


def test_every_fault_strikes_every_scene_with_recovery_and_without() -> None:
    struck = {(whole(case.fault), (case.object, case.seed), case.recovers) for case in ALONE}
    assert struck == set(product(ALL_FAULTS, SCENES + TOUCHING, (False, True)))


def test_every_field_of_every_device_is_wrong_in_every_way_that_it_can_be() -> None:
    kinds = {(f.device, f.what, f.kind) for f in faults() + commands()}

    def of(device: str, what: str) -> set[str]:
        return {k for d, w, k in kinds if (d, w) == (device, what)}

    ours = {"silent_s"}  # what a worker of our own says of itself, and no arm
    assert set(ARM_FIELDS) == set(ArmSample.__struct_fields__) - ours
    assert all(of("arm", what) for what in ARM_FIELDS)
    assert of("arm", "position_m") == set(STATE)
    assert of("gripper", "close") == set(COMMAND)
    assert of("arm", "link") == set(LINK)
    assert ("gripper", "gPOA", "out of range") in kinds
    assert ("gripper", "gACT", "out of range") not in kinds  # a bit has no such value


def test_fields_of_the_hand_are_where_its_model_puts_them() -> None:
    axes = tuple(AxisStatus(10 * i + 1, 10 * i + 2, 10 * i + 3, i) for i in range(4))
    words = encode(HandStatus(True, 2, True, 3, 1, 0x0B, axes))  # type: ignore[arg-type]
    said = {name: field.of(words) for name, field in FIELDS.items()}
    assert (said["gACT"], said["gMOD"], said["gGTO"], said["gIMC"], said["gSTA"]) == (1, 2, 1, 3, 1)
    assert said["gFLT"] == 0x0B
    for i, axis in enumerate("ABCS"):
        values = [said[f"g{what}{axis}"] for what in ("PR", "PO", "CU", "DT")]
        assert values == [10 * i + 1, 10 * i + 2, 10 * i + 3, i]
    for field in FIELDS.values():
        changed = field.set(words, field.most)
        assert field.of(changed) == field.most
        assert field.set(changed, field.of(words)) == words


def test_another_client_writes_every_register_and_where_the_model_reads_it() -> None:
    for name, field in COMMAND_FIELDS.items():
        told = decode(field.set((0,) * 8, field.most))
        said = {
            "ACT": told.activate, "MOD": told.mode, "GTO": told.go_to, "ATR": told.auto_release,
            "ICF": told.individual_fingers, "ICS": told.individual_scissor,
        }  # fmt: skip
        for axis, request in zip("ABCS", (*told.fingers, told.scissor), strict=True):
            said |= {f"PR{axis}": request.position, f"SP{axis}": request.speed,
                     f"FR{axis}": request.force}  # fmt: skip
        assert {"r" + at for at, value in said.items() if value} == {name}
        assert said[name[1:]] == field.most
    assert {fault.what for fault in written_by_another()} == {*COMMAND_FIELDS, "all fingers"}
    opened, closed = (decode(image) for image in IMAGES.values())
    assert opened.go_to and not opened.individual_fingers and opened.fingers[0] == Request()
    assert closed.go_to and not closed.individual_fingers
    assert closed.fingers[0] == Request(255, 255, 255)


def test_runs_are_mixed_and_lots_are_of_one_scene() -> None:
    mixed = in_turn(EVERY)
    assert mixed != EVERY and sorted(mixed, key=lambda case: case.number) == EVERY
    assert len({case.fault for case in mixed[:400]}) > 150
    lots = by_scene(mixed, 60)
    assert sorted((c for lot in lots for c in lot), key=lambda case: case.number) == EVERY
    assert all(len({(case.object, case.seed) for case in lot}) == 1 for lot in lots)
    assert max(map(len, lots)) == 60
