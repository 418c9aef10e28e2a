"""What the wires of the fault campaign do to what passes."""

import math
from typing import Any

import numpy as np
import pytest

from drivers.errors import LinkLost
from drivers.robotiq.model.gripper import GripperModel, HandSettings, ModelTransport
from drivers.takktile.board import Transfer
from drivers.takktile.model.codec import bulk_frame
from drivers.ur.model import ArmModel, ArmModelSettings
from scenarios.studies.faults.cases import AXES, Fault
from scenarios.studies.faults.registers import FIELDS, verb
from scenarios.studies.faults.struck import Struck
from scenarios.studies.faults.wires import ArmWire, HandWire, PadWire

MS = 1_000_000
GOES, ACTIVE = 0x0900, 0x0100


class Hand:
    """Registers that are written are read again."""

    def __init__(self) -> None:
        self.words = [0] * 8
        self.writes: list[tuple[int, ...]] = []

    def write(self, first: int, registers: Any, now_ns: int) -> None:
        self.words[first : first + len(registers)] = registers
        self.writes.append(tuple(registers))

    def read(self, first: int, count: int, now_ns: int) -> Any:
        return self.words[first : first + count]


def hand(fault: Fault, recovers: bool = False) -> tuple[Hand, HandWire]:
    device, wire = Hand(), HandWire()
    wire.around(device)
    wire.struck.append(Struck(fault, 0, recovers))
    return device, wire


def close(count: int) -> tuple[int, ...]:
    return GOES, count, 0xFF00 | 150, 0, 0, 0, 0, 0


OPEN, HOLD = (GOES, 0, 0xFF00, 0, 0, 0, 0, 0), (GOES, 40, 0, 0, 0, 0, 0, 0)


def test_verbs_are_told_by_the_registers_of_a_command_and_where_the_fingers_are() -> None:
    here = (40, 1, 0)
    told = (close(60), OPEN, HOLD, (ACTIVE, 40, 0xFFFF))
    assert [verb(0, words, here) for words in told] == ["close", "open", "hold", "hold"]
    assert verb(1, close(60)[1:], here) == "close"
    # at least speed and force, as a hold has them
    assert [verb(0, HOLD, (at, 0, 0)) for at in (20, 37, 38, 42, 43, 60)] == [
        "close", "close", "hold", "hold", "open", "open",
    ]  # fmt: skip


def test_a_short_way_is_an_opening_or_a_closing_by_its_direction() -> None:
    def two(count: int, b: int = 0) -> tuple[int, ...]:
        return GOES, count, 0xFF00, b << 8, 0, 0, 0, 0

    assert [verb(0, two(at), (40, 1, 0)) for at in (41, 42, 43)] == ["close"] * 3
    assert [verb(0, two(at), (40, 0, 0)) for at in (37, 38, 39)] == ["open"] * 3
    assert verb(0, two(10), (8, 12, 0)) == "open"  # another finger goes far back


def test_a_hold_at_the_open_stop_is_a_hold_though_fingers_are_told_less_than_they_say() -> None:
    def at_least(a: int, b: int, c: int) -> tuple[int, ...]:
        return GOES, a, 0, b << 8, c, 0, 0, 0

    said = ((0, 0, 0), (6, 6, 6)), ((0, 8, 8), (6, 8, 8)), ((0, 12, 12), (6, 12, 12))
    assert [verb(0, at_least(*told), here) for told, here in said] == ["hold"] * 3
    assert verb(0, at_least(0, 0, 0), (0, 0, 0)) == "hold"  # of a status that lies
    assert verb(0, at_least(0, 0, 0), (9, 6, 6)) == "open"
    assert verb(0, OPEN, (6, 6, 6)) == "open"


def test_commands_that_pass_are_kept_in_their_order() -> None:
    _, wire = hand(Fault("gripper", "command", "close", "lost"))
    for words in (OPEN, close(60)):
        wire.write(0, words, 0)
    assert wire.told == ["open", "close"]
    assert (wire.struck[0].times, wire.struck[0].took_ns) == (1, 0)


@pytest.mark.parametrize(
    ("kind", "said"),
    [("frozen", [7, 7]), ("late", [7, 7]), ("missing", [0, 0]), ("out of range", [255, 255]),
     ("jump", [97, 99])],
)  # fmt: skip
def test_a_field_of_the_hand_says_something_else_and_the_others_the_truth(
    kind: str, said: list[int]
) -> None:
    device, wire = hand(Fault("gripper", "state", "gPOA", kind))
    field, other = FIELDS["gPOA"], FIELDS["gPOB"]
    found = []
    for t_ns, value in ((0, 7), (50 * MS, 9)):
        device.words = list(other.set(field.set(device.words, value), value))
        words = wire.read(0, 8, t_ns)
        found.append(field.of(words))
        assert other.of(words) == value
    assert found == said


def test_what_recovers_says_the_truth_again() -> None:
    device, wire = hand(Fault("gripper", "state", "gPOA", "missing"), recovers=True)
    device.words = list(FIELDS["gPOA"].set(device.words, 9))
    assert FIELDS["gPOA"].of(wire.read(0, 8, 299 * MS)) == 0
    assert FIELDS["gPOA"].of(wire.read(0, 8, 300 * MS)) == 9


@pytest.mark.parametrize(
    ("kind", "writes"),
    [("lost", []), ("late", [close(60)]), ("repeated", [close(60), close(60)]),
     ("half done", [close(60)[:4]])],
)  # fmt: skip
def test_a_command_is_lost_late_repeated_or_half_done(kind: str, writes: list[Any]) -> None:
    device, wire = hand(Fault("gripper", "command", "close", kind), recovers=True)
    wire.write(0, OPEN, 0)
    wire.write(0, close(60), 0)
    assert device.writes[1:] == ([] if kind == "late" else writes[:1])
    wire.read(0, 8, 100 * MS)
    assert device.writes == [OPEN, *writes]
    wire.write(0, close(70), 200 * MS)  # it recovers: the next alone is taken
    assert device.writes[-1] == close(70)


def test_a_link_is_cut_blinks_or_is_slow() -> None:
    for kind, gone in (("cut", [True, True, True]), ("blinking", [True, False, True]),
                       ("slow", [False, False, False])):  # fmt: skip
        _, wire = hand(Fault("gripper", "link", "link", kind))
        found = []
        for t_ns in (0, 80 * MS, 160 * MS):
            try:
                wire.read(0, 8, t_ns)
                found.append(False)
            except LinkLost:
                found.append(True)
        assert found == gone
    device, wire = hand(Fault("gripper", "link", "link", "slow"))
    wire.read(0, 8, 0)
    wire.write(0, close(60), 0)
    assert wire.read(0, 8, 50 * MS)[0] == 0 and device.writes == []
    wire.read(0, 8, 100 * MS)
    assert device.writes == [close(60)]
    assert wire.read(0, 8, 210 * MS)[0] == GOES


def test_the_wire_of_a_hand_that_nothing_fails_is_the_hand() -> None:
    wire = HandWire()
    transport = wire.around(ModelTransport(GripperModel(HandSettings(), 0)))
    transport.write(0, [ACTIVE], 0)
    assert FIELDS["gACT"].of(transport.read(0, 8, 100 * MS)) == 1


def arm(fault: Fault) -> tuple[ArmModel, ArmWire]:
    model, wire = ArmModel(ArmModelSettings(), 0), ArmWire()
    wire.around(model)
    wire.struck.append(Struck(fault, 0, False))
    return model, wire


def up(m: float) -> tuple[float, float, float]:
    return 0.5, 0.1, 0.3 + m


@pytest.mark.parametrize(("axis", "leapt_m"), [("x", 0.55), ("y", 0.15), ("z", 0.35)])
def test_a_sample_of_the_arm_lies_in_one_field_along_one_axis(axis: str, leapt_m: float) -> None:
    says = {"not a number": math.isnan, "out of range": lambda m: m == 99.0,
            "jump": lambda m: abs(m - leapt_m) < 1e-9}  # fmt: skip
    for kind, check in says.items():
        _, wire = arm(Fault("arm", "state", f"position_m {axis}", kind))
        sample = wire.read(80 * MS)
        wrong = AXES.index(axis)
        for i, (said, true) in enumerate(zip(sample.position_m, up(0.0), strict=True)):
            assert check(said) if i == wrong else said == pytest.approx(true)
        assert sample.t_ns == 80 * MS and not sample.moving


def test_what_flickers_says_the_wrong_thing_and_the_right_one_by_turns() -> None:
    _, wire = arm(Fault("arm", "state", "moving", "flickers"))
    assert [wire.read(ms * MS).moving for ms in (0, 39, 40, 79, 80)] == [
        True, True, False, False, True,
    ]  # fmt: skip


def test_a_field_of_the_arm_can_be_missing_or_a_flag_be_wrong() -> None:
    _, wire = arm(Fault("arm", "state", "position_m", "missing"))
    assert wire.read(80 * MS).position_m == (0.0, 0.0, 0.0)
    _, wire = arm(Fault("arm", "state", "moving", "jump"))
    assert wire.read(80 * MS).moving


def test_an_arm_that_is_cut_off_is_stopped_by_its_own_watchdog() -> None:
    model, wire = arm(Fault("arm", "link", "link", "cut"))
    model.move_l(up(0.2), 0.1, 0.5, 0)
    for t_ns in range(0, 1_000 * MS, 10 * MS):
        with pytest.raises(LinkLost):
            wire.read(t_ns)
    assert model.velocity(1_000 * MS) == (0.0, 0.0, 0.0)
    assert model.position(1_000 * MS)[2] < 0.32


def test_half_a_move_ends_half_way_and_half_a_stop_at_half_the_speed() -> None:
    model, wire = arm(Fault("arm", "command", "move", "half done"))
    assert wire.move_l(up(0.2), 0.1, 0.5, 0)
    assert model.position(5_000 * MS)[2] == pytest.approx(0.4)
    model, wire = arm(Fault("arm", "command", "stop", "half done"))
    model.move_l(up(0.2), 0.1, 0.5, 0)
    wire.stop_l(0.5, 1_000 * MS)
    assert model.velocity(1_500 * MS)[2] == pytest.approx(0.05)


class Usb:
    """A board whose frames the test writes."""

    serial = "test"

    def __init__(self) -> None:
        self.codes = np.arange(18, dtype=np.int16) + 400

    def bulk_read(self, size: int, now_ns: int) -> Transfer:
        return Transfer(bulk_frame(self.codes, self.codes), now_ns)


def frame(kind: str, what: str, *codes: int) -> Any:
    """Pressures of the last frame, after the thumb's first was so and so; None: cut short."""
    usb, wire = Usb(), PadWire()
    wire.around(usb)  # type: ignore[arg-type]
    wire.struck.append(Struck(Fault("fingertips", "state", what, kind), 0, False))
    for t, code in enumerate(codes):
        usb.codes[0] = code
        transfer = wire.bulk_read(512, t * 10 * MS)
    assert transfer is not None
    if len(transfer.data) != 72:
        return None
    return (np.frombuffer(transfer.data, ">u2").reshape(-1, 2) >> 6).T.tolist()


@pytest.mark.parametrize(
    ("kind", "thumb"),
    [("frozen", 500), ("late", 500), ("out of range", 1023), ("jump", 360)],
)
def test_a_fingertip_says_something_else_and_its_neighbours_the_truth(
    kind: str, thumb: int
) -> None:
    pressures, temperatures = frame(kind, "finger A", 500, 510)
    assert pressures[0] == thumb
    assert pressures[6:] == list(range(406, 418))
    assert temperatures[0] == 510
    pressures, temperatures = frame(kind, "temperatures", 500, 510)
    assert (pressures[0], temperatures[0]) == (510, thumb)


def test_cells_that_are_missing_cut_a_frame_short() -> None:
    assert frame("missing", "taxel A2", 500) is None
