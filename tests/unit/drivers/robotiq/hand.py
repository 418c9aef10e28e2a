"""A modelled hand with springs in front of its fingers."""

import numpy as np

from drivers.robotiq.model.gripper import FingerLoads, GripperModel, HandSettings
from drivers.robotiq.protocol import AxisCommand, CommandRegisters, StatusRegisters, to_bytes

MS = 1_000_000


QUICK = HandSettings(activation_s=0.1)


def command(
    a: int = 0,
    b: int | None = None,
    c: int | None = None,
    *,
    speed: int = 255,
    force: int = 0,
    **bits: bool | int,
) -> CommandRegisters:
    """A request of an active hand; individual when B and C are given."""
    individual = b is not None and c is not None
    bits = {"activate": True, "go_to": True, "individual_fingers": individual, **bits}
    axes = [AxisCommand(position or 0, speed, force) for position in (a, b, c)]
    return CommandRegisters(a=axes[0], b=axes[1], c=axes[2], **bits)


class Hand:
    """A model with springs in front of its fingers, stepped at 1 kHz."""

    def __init__(self, hand: HandSettings = QUICK, *, active: bool = True) -> None:
        self.model = GripperModel(hand, 0, active=active)
        self.now_ns = 0
        self.stiffness = np.zeros(3)
        self.touch = np.zeros(3)
        self.peak_n = np.zeros(3)

    def put(self, stiffness_npm: float, touch_m: float) -> None:
        self.stiffness[:], self.touch[:] = stiffness_npm, touch_m

    def write(self, registers: CommandRegisters) -> None:
        self.model.write(0, registers.to_registers(), self.now_ns)

    def force_n(self) -> np.ndarray:
        return np.maximum(0.0, self.stiffness * (self.model.travel_m - self.touch))

    def run(self, ms: int) -> StatusRegisters:
        for _ in range(ms):
            force = self.stiffness * (self.model.travel_m - self.touch)
            self.now_ns += MS
            self.model.advance(self.now_ns, FingerLoads(force, self.stiffness))
            self.peak_n = np.maximum(self.peak_n, self.force_n())
        return self.status()

    def frame(self) -> str:
        """The status bytes, in hex."""
        return to_bytes(self.model.read(self.now_ns)).hex()

    def frame_after(self, ms: int) -> str:
        self.run(ms)
        return self.frame()

    def status(self) -> StatusRegisters:
        return StatusRegisters.from_registers(self.model.read(self.now_ns))

    def rest(self) -> StatusRegisters:
        for _ in range(1000):
            self.run(10)
            if not self.model.moving:
                return self.status()
        raise AssertionError("the hand did not come to rest")

    def grip(self, force: int = 0) -> StatusRegisters:
        """Close on rigid objects until all fingers are in contact."""
        self.put(5000.0, 0.03)
        self.write(command(255, force=force))
        return self.rest()


def detections(status: StatusRegisters) -> list[int]:
    return [axis.detection for axis in status.fingers]
