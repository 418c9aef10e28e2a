"""The modelled hand: modes, faults, release."""

import pytest

from drivers.robotiq.model.gripper import HandSettings
from drivers.robotiq.protocol import CommandRegisters
from tests.unit.drivers.robotiq.hand import Hand, command

# Modes, faults, release


def test_a_mode_change_opens_first_and_delays_motion_with_fault_06() -> None:
    hand = Hand(HandSettings())
    hand.write(command(120))
    hand.rest()
    hand.write(command(120, mode=1))
    status = hand.run(1500)
    assert (status.initialization, status.fault, status.go_to) == (2, 0x06, False)
    assert status.a.position == 6
    status = hand.rest()
    assert (status.initialization, status.mode, status.a.position) == (3, 1, 120)
    assert status.scissor.position == 200


def test_auto_release_opens_slowly_to_the_stops_and_ends_in_fault_0f() -> None:
    hand = Hand()
    hand.write(command(100))
    hand.rest()
    hand.write(command(100, auto_release=True))
    status = hand.run(500)
    assert (status.fault, status.go_to, status.initialization) == (0x0B, False, 0)
    assert hand.model.velocity_mps == pytest.approx([-0.022] * 3, rel=1e-3)
    status = hand.rest()
    assert (status.fault, status.a.position) == (0x0F, 0)
    hand.write(command(100))
    assert hand.run(300).fault == 0x0F
    hand.write(CommandRegisters())
    assert hand.run(20).fault == 0


def test_a_major_fault_stops_the_hand_until_ract_is_cleared() -> None:
    for code, imc in [(0x0D, 1), (0x0E, 2), (0x0F, 0)]:
        hand = Hand()
        hand.write(command(255))
        hand.run(300)
        hand.model.inject_fault(code)
        status = hand.run(20)
        assert (status.fault, status.initialization, status.go_to) == (code, imc, False), (
            code,
            imc,
        )
        assert not hand.model.velocity_mps.any(), (code, imc)
        hand.write(command(0))
        hand.model.inject_fault(0)
        assert hand.run(100).fault == code, (code, imc)
        hand.write(CommandRegisters())
        assert hand.run(20).fault == 0, (code, imc)
