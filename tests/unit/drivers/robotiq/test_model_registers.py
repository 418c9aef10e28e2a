"""Model of the hand: activation, registers and their refresh."""

import msgspec

from drivers.robotiq.model.gripper import HandSettings
from drivers.robotiq.protocol import CommandRegisters
from tests.unit.drivers.robotiq.hand import QUICK, Hand, command

# Activation


def test_activation_ends_ready_and_open_after_its_duration() -> None:
    hand = Hand(HandSettings(), active=False)
    hand.write(CommandRegisters(activate=True))
    assert hand.frame_after(20)[:4] == "1100"
    assert hand.run(2500).a.position > 60, "activation closes the hand on the way"
    assert not hand.run(3400).ready
    assert hand.frame_after(100)[:4] == "3100"
    assert hand.status().a.position == 6


# Registers and refresh


def test_requests_are_taken_up_and_status_is_sampled_on_refresh_ticks_only() -> None:
    hand = Hand(msgspec.structs.replace(QUICK, tick_phase_s=0.005))
    hand.run(6)
    hand.write(command(100))
    assert hand.run(8).a.echo == 0, "tick at 15 ms has not come"
    assert hand.run(1).a.echo == 100
    before = hand.frame_after(60)
    assert hand.frame_after(9) == before, "constant between ticks"
    assert hand.frame_after(1) != before


def test_a_short_write_leaves_the_other_bytes_in_force() -> None:
    hand = Hand()
    hand.write(command(80, 70, 60, force=9))
    hand.rest()
    hand.model.write(1, (90,), hand.now_ns)
    status = hand.rest()
    assert [axis.position for axis in status.fingers] == [90, 70, 60]
