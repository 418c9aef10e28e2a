"""The plan of the fault campaign: generated, whole, and the same every time."""

from itertools import product

from drivers.robotiq.model.registers import AxisStatus, HandStatus, encode
from drivers.ur.driver import ArmSample
from grasp.phases import Phase
from scenarios.studies.faults.cases import (
    ARM_FIELDS,
    COMMAND,
    LINK,
    MOMENTS,
    PAIRS,
    PHASES,
    SCENES,
    STATE,
    TOUCHING,
    by_scene,
    faults,
    in_turn,
    plan,
)
from scenarios.studies.faults.registers import FIELDS

EVERY = plan()
ALONE = [case for case in EVERY if case.fault is not None and case.then is None]


def test_over_nine_thousand_runs_are_planned_and_always_the_same() -> None:
    assert len(EVERY) > 9000
    assert plan() == EVERY
    assert [case.number for case in EVERY] == list(range(len(EVERY)))
    assert sum(case.then is not None for case in EVERY) == PAIRS


def test_every_fault_strikes_every_phase_at_three_moments() -> None:
    struck = {(case.fault, case.phase, case.ticks) for case in ALONE}
    assert struck == set(product(faults(), PHASES, MOMENTS))
    assert len(struck) == len(ALONE)
    assert {Phase.LOWER, Phase.RELEASE, Phase.GRASP, Phase.COMPENSATE} <= set(PHASES)


def test_every_fault_in_every_phase_recovers_once_and_stays_once() -> None:
    struck = {(case.fault, case.phase, case.recovers) for case in ALONE}
    assert struck == set(product(faults(), PHASES, (False, True)))


def test_every_fault_strikes_every_scene_with_recovery_and_without() -> None:
    struck = {(case.fault, (case.object, case.seed), case.recovers) for case in ALONE}
    assert struck == set(product(faults(), SCENES + TOUCHING, (False, True)))


def test_every_field_of_every_device_is_wrong_in_every_way_that_it_can_be() -> None:
    kinds = {(f.device, f.what, f.kind) for f in faults()}

    def of(device: str, what: str) -> set[str]:
        return {k for d, w, k in kinds if (d, w) == (device, what)}

    assert set(ARM_FIELDS) == set(ArmSample.__struct_fields__)
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


def test_runs_are_mixed_and_lots_are_of_one_scene() -> None:
    mixed = in_turn(EVERY)
    assert mixed != EVERY and sorted(mixed, key=lambda case: case.number) == EVERY
    assert len({case.fault for case in mixed[:400]}) > 150
    lots = by_scene(mixed, 60)
    assert sorted((c for lot in lots for c in lot), key=lambda case: case.number) == EVERY
    assert all(len({(case.object, case.seed) for case in lot}) == 1 for lot in lots)
    assert max(map(len, lots)) == 60
