"""Bytes of the registers, against the worked frames of the Robotiq manual (2014, p. 67-74)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.robotiq.protocol import (
    FAULTS,
    RTU,
    TCP,
    AxisCommand,
    AxisStatus,
    CommandRegisters,
    Severity,
    StatusRegisters,
    to_bytes,
    to_registers,
)

byte = st.integers(0, 255)
axis_commands = st.builds(AxisCommand, byte, byte, byte)
axis_statuses = st.builds(AxisStatus, byte, byte, byte, st.integers(0, 3))
commands = st.builds(
    CommandRegisters,
    activate=st.booleans(),
    mode=st.integers(0, 3),
    go_to=st.booleans(),
    auto_release=st.booleans(),
    individual_fingers=st.booleans(),
    individual_scissor=st.booleans(),
    a=axis_commands,
    b=axis_commands,
    c=axis_commands,
    scissor=axis_commands,
)
statuses = st.builds(
    StatusRegisters,
    active=st.booleans(),
    mode=st.integers(0, 3),
    go_to=st.booleans(),
    initialization=st.integers(0, 3),
    stopped=st.integers(0, 3),
    fault=st.integers(0, 15),
    a=axis_statuses,
    b=axis_statuses,
    c=axis_statuses,
    scissor=axis_statuses,
)


def status_of(frame: str) -> StatusRegisters:
    return StatusRegisters.from_bytes(bytes.fromhex(frame))


GOLDEN = {
    "moving after close": (
        "39C0 00FF 080F 0008 1000 080F 0089 0000",
        StatusRegisters(
            active=True,
            go_to=True,
            initialization=3,
            a=AxisStatus(255, 8, 15),
            b=AxisStatus(0, 8, 16),
            c=AxisStatus(0, 8, 15),
            scissor=AxisStatus(0, 137, 0, 3),
        ),
    ),
    "grip done": (
        "B9EA 00FF BC00 00C1 0000 BD00 0089 0000",
        StatusRegisters(
            active=True,
            go_to=True,
            initialization=3,
            stopped=2,
            a=AxisStatus(255, 188, 0, 2),
            b=AxisStatus(0, 193, 0, 2),
            c=AxisStatus(0, 189, 0, 2),
            scissor=AxisStatus(0, 137, 0, 3),
        ),
    ),
    "opening": (
        "39C0 0000 B80B 00BD 0E00 BA0B 0089 0000",
        StatusRegisters(
            active=True,
            go_to=True,
            initialization=3,
            a=AxisStatus(0, 184, 11),
            b=AxisStatus(0, 189, 14),
            c=AxisStatus(0, 186, 11),
            scissor=AxisStatus(0, 137, 0, 3),
        ),
    ),
    "open done": (
        "F9FF 0000 0700 0006 0000 0600 0089 0000",
        StatusRegisters(
            active=True,
            go_to=True,
            initialization=3,
            stopped=3,
            a=AxisStatus(0, 7, 0, 3),
            b=AxisStatus(0, 6, 0, 3),
            c=AxisStatus(0, 6, 0, 3),
            scissor=AxisStatus(0, 137, 0, 3),
        ),
    ),
    "activating": ("1100" + 14 * "00", StatusRegisters(active=True, initialization=1)),
    "ready": ("3100" + 14 * "00", StatusRegisters(active=True, initialization=3)),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_worked_status_frames_of_the_manual_decode_and_encode(name: str) -> None:
    frame, status = GOLDEN[name]
    assert status_of(frame) == status
    assert status.to_bytes() == bytes.fromhex(frame)


def test_ready_is_activation_bit_and_both_initialization_bits() -> None:
    assert status_of(GOLDEN["ready"][0]).ready
    assert not status_of(GOLDEN["activating"][0]).ready


def test_command_bytes_are_position_speed_force_after_a_reserved_third_byte() -> None:
    command = CommandRegisters(
        activate=True, go_to=True, a=AxisCommand(255, 254, 1), b=AxisCommand(2, 3, 4)
    )
    assert command.to_bytes().hex() == "090000fffe0102030400000000000000"


def test_each_command_bit_has_the_place_that_the_manual_gives_it() -> None:
    fields = {
        "activate": "0100",
        "go_to": "0800",
        "auto_release": "1000",
        "individual_fingers": "0004",
        "individual_scissor": "0008",
    }
    for name, start in fields.items():
        assert CommandRegisters(**{name: True}).to_bytes().hex() == start + 28 * "0"
    assert CommandRegisters(mode=3).to_bytes()[0] == 0b110


def test_even_bytes_are_the_high_half_of_a_register() -> None:
    registers = CommandRegisters(activate=True, go_to=True, a=AxisCommand(0xAB)).to_registers()
    assert registers[:2] == (0x0900, 0x00AB)
    assert to_bytes((0x0102,) + (0,) * 7)[:2] == b"\x01\x02"


@given(commands)
def test_commands_survive_bytes_and_registers(command: CommandRegisters) -> None:
    assert CommandRegisters.from_bytes(command.to_bytes()) == command
    assert CommandRegisters.from_registers(command.to_registers()) == command


@given(statuses)
def test_statuses_survive_bytes_and_registers(status: StatusRegisters) -> None:
    assert StatusRegisters.from_bytes(status.to_bytes()) == status
    assert StatusRegisters.from_registers(status.to_registers()) == status


@given(st.binary(min_size=16, max_size=16))
def test_any_16_bytes_decode_and_lose_only_reserved_bits(data: bytes) -> None:
    kept = bytes([255, 255, 15, *[255] * 12, 0])
    again = StatusRegisters.from_bytes(data).to_bytes()
    assert again == bytes(a & b for a, b in zip(data, kept, strict=True))
    CommandRegisters.from_bytes(data)


@given(st.binary().filter(lambda data: len(data) != 16))
def test_a_wrong_length_is_the_only_decoding_error(data: bytes) -> None:
    for decode in (StatusRegisters.from_bytes, CommandRegisters.from_bytes, to_registers):
        with pytest.raises(ValueError, match="need 16"):
            decode(data)


@pytest.mark.parametrize(
    "registers", [(), (0,) * 7, (0,) * 9, (-1,) + (0,) * 7, (65536,) + (0,) * 7, ("x",) * 8]
)
def test_registers_of_a_wrong_shape_are_a_value_error(registers: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="not 8 registers"):
        StatusRegisters.from_registers(registers)


def test_values_that_would_spill_into_other_bits_are_refused() -> None:
    for make in (
        lambda: CommandRegisters(mode=4),
        lambda: AxisCommand(256),
        lambda: AxisCommand(force=-1),
        lambda: AxisStatus(detection=4),
        lambda: StatusRegisters(fault=16),
    ):
        with pytest.raises(ValueError, match="need 0 to"):
            make()


def test_a_current_count_is_ten_milliamperes() -> None:
    assert status_of(GOLDEN["moving after close"][0]).a.current_ma == 150


def test_individual_fingers_are_not_honoured_in_scissor_mode_alone() -> None:
    assert CommandRegisters(individual_fingers=True).honours_fingers
    assert not CommandRegisters(individual_fingers=True, mode=3).honours_fingers
    assert CommandRegisters(
        individual_fingers=True, individual_scissor=True, mode=3
    ).honours_fingers


def test_first_registers_differ_between_tcp_and_rtu() -> None:
    assert (TCP.command_register, TCP.status_register) == (0, 0)
    assert (RTU.command_register, RTU.status_register) == (1000, 2000)


def test_fault_is_the_low_nibble() -> None:
    assert StatusRegisters.from_bytes(bytes([0x31, 0, 0x2F, *13 * [0]])).fault == 0x0F


def test_every_fault_has_a_rank_and_a_text() -> None:
    ranks = {code: FAULTS[code].severity for code in range(16)}
    assert [c for c, r in ranks.items() if r is Severity.PRIORITY] == [5, 6, 7]
    assert [c for c, r in ranks.items() if r is Severity.MAJOR] == [0x0D, 0x0E, 0x0F]
    assert all(FAULTS[code].text and FAULTS[code].remedy for code in range(1, 16))
    assert FAULTS[0].severity is Severity.NONE
