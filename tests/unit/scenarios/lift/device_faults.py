"""Faults of the devices of a simulated rig, each a function of the rig."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from drivers.errors import LinkLost
from scenarios.rigs.rig import Rig
from scenarios.world.cell import SimulatedCell
from scenarios.world.contact import initial_state

Act = Callable[[Rig], None]
FINGER = slice(0, 6)  # of the 18 codes: finger A


def cell(rig: Rig) -> SimulatedCell:
    assert isinstance(rig.cell, SimulatedCell)
    return rig.cell


def interrupt(rig: Rig) -> None:
    raise KeyboardInterrupt


def take_object_away(rig: Rig) -> None:
    cell(rig).contact.state[:] = initial_state(present=False)


# Links


def lost(*_: object) -> None:
    raise LinkLost("gripper: no answer", "check cable, power and address")


def unplug_fingertips(rig: Rig) -> None:
    cell(rig).board.unplug()


def silence_fingertips(rig: Rig) -> None:
    cell(rig).board.time_out(10_000)


def trip_arm(rig: Rig) -> None:
    cell(rig).arm.trip(rig.clock.now_ns)


def fault_gripper(rig: Rig) -> None:
    cell(rig).gripper.inject_fault(0x0E)


def cut_gripper(rig: Rig) -> None:
    rig.devices.gripper.poll = lost  # type: ignore[method-assign]


LINKS = (unplug_fingertips, trip_arm, fault_gripper, silence_fingertips, cut_gripper)


# Fingertips


def freeze_fingertips(rig: Rig) -> None:
    _keep(rig, slice(None))


def freeze_thumb(rig: Rig) -> None:
    _keep(rig, FINGER)


def freeze_finger_c(rig: Rig) -> None:
    _keep(rig, slice(12, 18))


def freeze_taxels(of_thumb: int) -> Act:
    """Freeze the first ``of_thumb`` taxels of the thumb."""

    def act(rig: Rig) -> None:
        _keep(rig, slice(0, of_thumb))

    act.__name__ = f"freeze_{of_thumb}_taxels"
    return act


def _keep(rig: Rig, cells: slice) -> None:
    """Repeat the next codes of these cells without end."""
    kept: list[Any] = []

    def lie(codes: np.ndarray) -> np.ndarray:
        if not kept:
            kept.append(codes[cells].copy())
        out = codes.copy()
        out[cells] = kept[0]
        return out

    cell(rig).board.misreport(lie)


def fingertips_read(code: int, cells: slice = slice(None)) -> Act:
    def act(rig: Rig) -> None:
        def lie(codes: np.ndarray) -> np.ndarray:
            out = codes.copy()
            out[cells] = code
            return out

        cell(rig).board.misreport(lie)

    act.__name__ = f"fingertips_read_{code}"
    return act


def shift_fingertips(rig: Rig) -> None:
    cell(rig).board.misreport(lambda codes: np.clip(codes - 150, 0, 1023))


def swap_fingertips(one: int, other: int) -> Act:
    """Each of two fingers has the other's fingertip, or its cable."""

    def act(rig: Rig) -> None:
        order = np.arange(3)
        order[[one, other]] = other, one
        cell(rig).board.misreport(lambda codes: codes.reshape(3, -1)[order].ravel())

    act.__name__ = f"swap_{one}_and_{other}"
    return act


def stick_one_taxel_at_the_rail(rig: Rig) -> None:
    fingertips_read(0, slice(2, 3))(rig)


def replug_fingertips(rig: Rig) -> None:
    """Replug the board between two polls: the link reopens it and reports no error."""
    cell(rig).board.unplug()
    cell(rig).board.replug()
    rig.tactile._link.start()  # type: ignore[attr-defined]


# Detector: every later one, and the running one


# Gripper


def swallow_writes(rig: Rig) -> None:
    cell(rig).gripper.ignores_writes = True


def freeze_gripper_status(rig: Rig) -> None:
    gripper = cell(rig).gripper
    kept = gripper.read(rig.clock.now_ns)
    gripper.misreport(lambda words: kept)


def zero_gripper_status(rig: Rig) -> None:
    cell(rig).gripper.misreport(lambda words: (0,) * len(words))


def always_contact(rig: Rig) -> None:
    """The status reports contact for every finger."""
    cell(rig).gripper.misreport(lambda w: (w[0] & ~0x003F | 0x002A, *w[1:]))


def jam_gripper(rig: Rig) -> None:
    cell(rig).gripper.jam()


def power_cycle_gripper(rig: Rig) -> None:
    cell(rig).gripper.power_cycle()


def make_finger_b_jump(rig: Rig) -> None:
    cell(rig).gripper.misreport(lambda w: (*w[:3], w[3] & 0xFF00 | (w[3] + 90) & 0xFF, *w[4:]))


def make_thumb_jump(rig: Rig) -> None:
    cell(rig).gripper.misreport(lambda w: (*w[:2], (w[2] + (90 << 8)) & 0xFFFF, *w[3:]))


# Arm


def lose_arm_position(rig: Rig) -> None:
    nan = (float("nan"),) * 3
    cell(rig).arm.misreport(lambda sample: msgspec.structs.replace(sample, position_m=nan))


def freeze_arm_values(rig: Rig) -> None:
    arm = cell(rig).arm
    kept = arm.read(rig.clock.now_ns)
    arm.misreport(lambda sample: msgspec.structs.replace(kept, t_ns=sample.t_ns))


def push_arm(rig: Rig) -> None:
    """The arm moves without a command."""
    arm, now_ns = cell(rig).arm, rig.clock.now_ns
    x, y, z = arm.at(now_ns).position_m
    arm.move_l((x + 0.1, y, z), 0.1, 0.5, now_ns)


def make_arm_jump(rig: Rig) -> None:
    def lie(sample: msgspec.Struct) -> msgspec.Struct:
        x, y, z = sample.position_m
        return msgspec.structs.replace(sample, position_m=(x, y, z + 0.05))

    cell(rig).arm.misreport(lie)


def lose_stops(rig: Rig, times: int) -> list[int]:
    """The arm's controller loses ``times`` stops; returns the times of those that it received."""
    arm, left, received_ns = cell(rig).arm, [times], list[int]()
    whole = arm.stop_l

    def stop_l(deceleration_mps2: float, now_ns: int) -> None:
        if left[0] > 0:
            left[0] -= 1
            return
        received_ns.append(now_ns)
        whole(deceleration_mps2, now_ns)

    arm.stop_l = stop_l  # type: ignore[method-assign]
    return received_ns


# Loop


def pause_loop(seconds: float) -> Act:
    def act(rig: Rig) -> None:
        rig.clock.sleep_until_ns(rig.clock.now_ns + round(seconds * 1e9))

    act.__name__ = f"pause_loop_{seconds:g}_s"
    return act
