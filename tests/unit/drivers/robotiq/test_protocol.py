"""Bytes of the registers, against the worked frames of the Robotiq manual (2014, p. 67-74)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.robotiq.protocol import (
    FAULTS,
    AxisCommand,
    CommandRegisters,
    Severity,
    StatusRegisters,
    to_registers,
)


def status_of(frame: str) -> StatusRegisters:
    return StatusRegisters.from_bytes(bytes.fromhex(frame))


def test_ready_is_activation_bit_and_both_initialization_bits() -> None:
    assert status_of("3100" + 28 * "0").ready
    assert not status_of("1100" + 28 * "0").ready


@given(st.binary(min_size=16, max_size=16))
def test_any_16_bytes_decode_as_a_status(data: bytes) -> None:
    StatusRegisters.from_bytes(data)


@given(st.binary().filter(lambda data: len(data) != 16))
def test_a_wrong_length_is_the_only_decoding_error(data: bytes) -> None:
    for decode in (StatusRegisters.from_bytes, to_registers):
        with pytest.raises(ValueError, match="need 16"):
            decode(data)


def test_registers_of_a_wrong_shape_are_a_value_error() -> None:
    for registers in [(), (0,) * 7, (0,) * 9, (-1,) + (0,) * 7, (65536,) + (0,) * 7, ("x",) * 8]:
        with pytest.raises(ValueError, match="not 8 registers"):
            StatusRegisters.from_registers(registers)


def test_values_beyond_their_field_are_refused() -> None:
    for make in (
        lambda: CommandRegisters(mode=4),
        lambda: AxisCommand(256),
        lambda: AxisCommand(speed=256),
        lambda: AxisCommand(force=-1),
    ):
        with pytest.raises(ValueError, match="need 0 to"):
            make()


def test_every_fault_has_a_severity_and_a_text() -> None:
    ranks = {code: FAULTS[code].severity for code in range(16)}
    assert [c for c, r in ranks.items() if r is Severity.PRIORITY] == [5, 6, 7]
    assert [c for c, r in ranks.items() if r is Severity.MAJOR] == [0x0D, 0x0E, 0x0F]
    assert all(FAULTS[code].text and FAULTS[code].remedy for code in range(1, 16))
    assert FAULTS[0].severity is Severity.NONE
