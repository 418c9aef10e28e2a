"""An emulated cell that had no time: its world is at the present before the arm's controller has
made up for the cycles that it missed. What everybody has seen of the arm stays as it was."""

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
        x, y, z = cell.arm.position(0)
        settings = EmulatorSettings(host="127.0.0.2", start_m=(x, y, z))
        self.motion = RobotMotion(CYCLE_NS * 1e-9, cell.arm, nullcontext(), 0)
        self.controller = Controller(settings, self.motion, 0)
        self.seen: list[tuple[int, tuple[float, float, float]]] = []  # by whoever looks
        self.told: list[tuple[int, tuple[float, float, float]]] = []  # by the controller

    def look(self, until_ns: int) -> None:
        """Somebody asks for the world of the present, every millisecond."""
        for t_ns in range(self.cell.truth().t_ns + MS, until_ns + 1, MS):
            self.cell.advance(t_ns)
            self.seen.append((t_ns, self.cell.arm.position(t_ns)))

    def cycle(self) -> None:
        self.now_ns += CYCLE_NS
        self.cell.advance(self.now_ns)
        self.controller.step(self.now_ns, {})
        self.told.append((self.now_ns, self.motion.position))

    def run(self, cycles: int) -> None:
        """On time."""
        for _ in range(cycles):
            self.look(self.now_ns + CYCLE_NS)
            self.cycle()

    def miss(self, cycles: int, then: str = "") -> None:
        """The world is asked for all the while; then the cycles are made up for, with a program
        that has come meanwhile."""
        self.look(self.now_ns + cycles * CYCLE_NS)
        if then:
            self.controller.load(f"def next():\n{then}\nend\n")
        for _ in range(cycles):
            self.cycle()

    @property
    def fastest_mps(self) -> float:
        """From one look to the next, or from one cycle to the next."""
        return max(_fastest(self.seen), _fastest(self.told))


def _fastest(places: list[tuple[int, tuple[float, float, float]]]) -> float:
    return max(1e9 * math.dist(a, b) / (t - s) for (s, a), (t, b) in itertools.pairwise(places))


@pytest.fixture
def world() -> World:
    return World()


@pytest.mark.parametrize(
    "then",
    ["stopl(0.5)", "stopl(5.0)", "speedl([0, 0, -0.1, 0, 0, 0], a=0.5, t=5)",
     "movel(p[0.5, 0.2, 0.3, 3.141592653589793, 0, 0], a=0.5, v=0.1)"],
)  # fmt: skip
@pytest.mark.parametrize("missed", [1, 5, 12])
def test_what_is_commanded_in_a_missed_cycle_acts_at_the_present_of_the_world(
    world: World, missed: int, then: str
) -> None:
    world.controller.load("def main():\n speedl([0, 0, 0.1, 0, 0, 0], a=0.5, t=9)\nend\n")
    world.run(60)
    world.miss(missed, then)
    world.run(60)
    assert world.fastest_mps <= FASTEST_MPS + 1e-6
    heights = [height for _, (_, _, height) in world.seen]
    if then.startswith("stopl"):
        assert heights == sorted(heights)
        assert world.motion.arrived


def test_a_plan_that_missed_cycles_comes_to_its_end_none_the_less(world: World) -> None:
    world.controller.load(f"def main():\n movel({AHEAD}, a=0.5, v=0.1)\nend\n")
    for _ in range(40):
        world.run(8)
        world.miss(5)
    assert world.controller.runtime_state is RuntimeState.STOPPED
    assert world.motion.position == pytest.approx((0.5, 0.1, 0.5), abs=1e-6)
