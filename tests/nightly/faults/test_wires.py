"""What the wires of the fault harness do to what passes."""

import math
from typing import Any

import numpy as np
import pytest

from drivers.errors import LinkLost
from drivers.robotiq.model.registers import AxisStatus, HandStatus, decode, encode
from drivers.takktile.board import Transfer
from drivers.takktile.model.codec import bulk_frame
from drivers.ur.driver import ArmSample
from drivers.ur.model import ArmModel, ArmModelSettings
from tests.nightly.faults.cases import ARM_FIELDS, Fault
from tests.nightly.faults.registers import COMMAND_FIELDS, FIELDS, IMAGES, verb
from tests.nightly.faults.struck import Struck
from tests.nightly.faults.wires import ArmWire, HandWire, PadWire

MS = 1_000_000
GOES = 0x0900
OPEN, HOLD = (GOES, 0, 0xFF00, 0, 0, 0, 0, 0), (GOES, 40, 0, 0, 0, 0, 0, 0)


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


def test_fields_of_hand_and_arm_are_those_of_their_models() -> None:
    axes = tuple(AxisStatus(10 * i + 1, 10 * i + 2, 10 * i + 3, i) for i in range(4))
    words = encode(HandStatus(True, 2, True, 3, 1, 0x0B, axes))  # type: ignore[arg-type]
    said = {name: field.of(words) for name, field in FIELDS.items()}
    assert [said[n] for n in ("gACT", "gMOD", "gGTO", "gIMC", "gSTA", "gFLT")] == [
        1,
        2,
        1,
        3,
        1,
        11,
    ]
    for i, axis in enumerate("ABCS"):
        values = [said[f"g{what}{axis}"] for what in ("PR", "PO", "CU", "DT")]
        assert values == [10 * i + 1, 10 * i + 2, 10 * i + 3, i]
    for name, field in COMMAND_FIELDS.items():
        told = decode(field.set((0,) * 8, field.most))
        said = {
            "rACT": told.activate, "rMOD": told.mode, "rGTO": told.go_to,
            "rATR": told.auto_release, "rICF": told.individual_fingers,
            "rICS": told.individual_scissor,
        }  # fmt: skip
        for axis, request in zip("ABCS", (*told.fingers, told.scissor), strict=True):
            said |= {f"rPR{axis}": request.position, f"rSP{axis}": request.speed,
                     f"rFR{axis}": request.force}  # fmt: skip
        assert {at for at, value in said.items() if value} == {name} and said[name] == field.most
    opened, closed = (decode(image) for image in IMAGES.values())
    assert opened.fingers[0].position == 0 and closed.fingers[0].force == 255
    assert set(ARM_FIELDS) == set(ArmSample.__struct_fields__) - {"silent_s"}


def test_a_command_is_a_close_an_open_or_a_hold_by_its_registers_and_the_fingers() -> None:
    told = (close(60), OPEN, HOLD, (0x0100, 40, 0xFFFF))
    assert [verb(0, words, (40, 1, 0)) for words in told] == ["close", "open", "hold", "hold"]
    assert verb(1, close(60)[1:], (40, 1, 0)) == "close"
    assert [verb(0, HOLD, (at, 0, 0)) for at in (37, 38, 42, 43)] == [
        "close", "hold", "hold", "open",
    ]  # fmt: skip
    assert verb(0, (GOES, 0, 0, 8 << 8, 8, 0, 0, 0), (6, 8, 8)) == "hold"  # at the open stop


@pytest.mark.parametrize(
    ("kind", "said"),
    [("frozen", [7, 7]), ("late", [7, 7]), ("missing", [0, 0]), ("out of range", [255, 255]),
     ("jump", [97, 99])],
)  # fmt: skip
def test_a_field_of_the_hand_is_wrong_and_the_others_are_not(kind: str, said: list[int]) -> None:
    device, wire = hand(Fault("gripper", "state", "gPOA", kind))
    field, other = FIELDS["gPOA"], FIELDS["gPOB"]
    found = []
    for t_ns, value in ((0, 7), (50 * MS, 9)):
        device.words = list(other.set(field.set(device.words, value), value))
        words = wire.read(0, 8, t_ns)
        found.append(field.of(words))
        assert other.of(words) == value
    assert found == said


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
    wire.write(0, close(70), 200 * MS)  # it recovers
    assert device.writes[-1] == close(70) and wire.told[:2] == ["open", "close"]


def test_a_link_is_cut_blinks_or_is_slow_and_a_state_recovers() -> None:
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
    wire.write(0, close(60), 0)
    assert wire.read(0, 8, 50 * MS)[0] == 0 and device.writes == []
    wire.read(0, 8, 100 * MS)
    assert device.writes == [close(60)]
    device, wire = hand(Fault("gripper", "state", "gPOA", "missing"), recovers=True)
    device.words = list(FIELDS["gPOA"].set(device.words, 9))
    assert [FIELDS["gPOA"].of(wire.read(0, 8, ms * MS)) for ms in (299, 300)] == [0, 9]


def arm(fault: Fault) -> tuple[ArmModel, ArmWire]:
    model, wire = ArmModel(ArmModelSettings(), 0), ArmWire()
    wire.around(model)
    wire.struck.append(Struck(fault, 0, False))
    return model, wire


def up(m: float) -> tuple[float, float, float]:
    return 0.5, 0.1, 0.3 + m


def test_a_sample_of_the_arm_is_wrong_in_one_field() -> None:
    for kind, wrong in (("not a number", math.nan), ("out of range", 99.0), ("jump", 0.15)):
        sample = arm(Fault("arm", "state", "position_m y", kind))[1].read(80 * MS)
        assert sample.position_m == pytest.approx((0.5, wrong, 0.3), nan_ok=True)
        assert sample.t_ns == 80 * MS and not sample.moving
    assert arm(Fault("arm", "state", "position_m", "missing"))[1].read(80 * MS).position_m[2] == 0.0
    _, wire = arm(Fault("arm", "state", "moving", "flickers"))
    assert [wire.read(ms * MS).moving for ms in (0, 39, 40, 80)] == [True, True, False, True]


def test_an_arm_that_is_cut_off_is_stopped_by_its_watchdog() -> None:
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


@pytest.mark.parametrize(
    ("kind", "thumb"),
    [("frozen", 500), ("late", 500), ("out of range", 1023), ("jump", 360), ("missing", None)],
)
def test_a_fingertip_is_wrong_and_its_neighbours_are_not(kind: str, thumb: int | None) -> None:
    usb, wire = Usb(), PadWire()
    wire.around(usb)  # type: ignore[arg-type]
    wire.struck.append(Struck(Fault("fingertips", "state", "finger A", kind), 0, False))
    for t, code in enumerate((500, 510)):
        usb.codes[0] = code
        transfer = wire.bulk_read(512, t * 10 * MS)
    assert transfer is not None and (len(transfer.data) == 72) == (thumb is not None)
    if thumb is not None:
        words = np.frombuffer(transfer.data, ">u2").reshape(-1, 2) >> 6
        assert words[:, 0].tolist()[0::6][0] == thumb and words[0, 1] == 510
        assert words[6:, 0].tolist() == list(range(406, 418))
