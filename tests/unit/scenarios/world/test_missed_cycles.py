"""An emulated cell that had no processor time: its world advances to the present before the arm's
controller makes up for missed cycles. Arm positions that were observed do not change."""

import itertools
import math
from contextlib import nullcontext

import pytest

from drivers.ur.emulator.controller import Controller, EmulatorSettings, RuntimeState
from drivers.ur.emulator.motion import RobotMotion
from scenarios.campaign.config import load_for_devices
from scenarios.rigs.simulated import any_cell
from scenarios.world.cell import SimulatedCell

MS = 1_000_000
CYCLE_NS = 8 * MS
FASTEST_MPS = 0.1
AHEAD = "p[0.5, 0.1, 0.5, 3.141592653589793, 0, 0]"


class World:
    """A cell and the controller of its arm, on the clock of the test."""

    def __init__(self) -> None:
        cell = any_cell(load_for_devices("can", "emulated", None, ()), 0)
        assert isinstance(cell, SimulatedCell)
        self.cell, self.now_ns = cell, 0
        x, y, z = cell.arm.at(0).position_m
        settings = EmulatorSettings(host="127.0.0.2", start_m=(x, y, z))
        self.motion = RobotMotion(CYCLE_NS * 1e-9, cell.arm, nullcontext(), 0)
        self.controller = Controller(settings, self.motion, 0)
        self.observed: list[tuple[int, tuple[float, float, float]]] = []  # of the world
        self.commanded: list[tuple[int, tuple[float, float, float]]] = []  # by the controller

    def observe(self, until_ns: int) -> None:
        """Advance the world and record the arm's position every millisecond."""
        for t_ns in range(self.cell.truth().t_ns + MS, until_ns + 1, MS):
            self.cell.advance(t_ns)
            self.observed.append((t_ns, self.cell.arm.at(t_ns).position_m))

    def cycle(self) -> None:
        self.now_ns += CYCLE_NS
        self.cell.advance(self.now_ns)
        self.controller.step(self.now_ns, {})
        self.commanded.append((self.now_ns, self.motion.position))

    def run(self, cycles: int) -> None:
        """Run cycles on time."""
        for _ in range(cycles):
            self.observe(self.now_ns + CYCLE_NS)
            self.cycle()

    def miss(self, cycles: int, then: str = "") -> None:
        """Advance the world without cycles, then run the missed cycles with the program ``then``
        that has arrived."""
        self.observe(self.now_ns + cycles * CYCLE_NS)
        if then:
            self.controller.load(f"def next():\n{then}\nend\n")
        for _ in range(cycles):
            self.cycle()

    @property
    def fastest_mps(self) -> float:
        """Largest speed between two observations or two cycles."""
        return max(_fastest(self.observed), _fastest(self.commanded))


def _fastest(positions: list[tuple[int, tuple[float, float, float]]]) -> float:
    return max(1e9 * math.dist(a, b) / (t - s) for (s, a), (t, b) in itertools.pairwise(positions))


@pytest.fixture
def world() -> World:
    return World()


@pytest.mark.parametrize(
    "then",
    ["stopl(0.5)", "stopl(5.0)", "speedl([0, 0, -0.1, 0, 0, 0], a=0.5, t=5)",
     "movel(p[0.5, 0.2, 0.3, 3.141592653589793, 0, 0], a=0.5, v=0.1)"],
)  # fmt: skip
@pytest.mark.parametrize("missed", [1, 5, 12])
def test_command_in_a_missed_cycle_takes_effect_at_the_present_time_of_the_world(
    world: World, missed: int, then: str
) -> None:
    world.controller.load("def main():\n speedl([0, 0, 0.1, 0, 0, 0], a=0.5, t=9)\nend\n")
    world.run(60)
    world.miss(missed, then)
    world.run(60)
    assert world.fastest_mps <= FASTEST_MPS + 1e-6
    heights = [height for _, (_, _, height) in world.observed]
    if then.startswith("stopl"):
        assert heights == sorted(heights)
        assert world.motion.arrived


def test_motion_with_missed_cycles_reaches_its_target(world: World) -> None:
    world.controller.load(f"def main():\n movel({AHEAD}, a=0.5, v=0.1)\nend\n")
    for _ in range(40):
        world.run(8)
        world.miss(5)
    assert world.controller.runtime_state is RuntimeState.STOPPED
    assert world.motion.position == pytest.approx((0.5, 0.1, 0.5), abs=1e-6)
