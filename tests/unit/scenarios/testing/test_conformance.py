"""The three packaged drivers pass the conformance tests for foreign drivers."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from drivers.errors import LinkLost
from drivers.interfaces import Arm, Gripper, TactileSensor
from drivers.robotiq.driver import RobotiqDriver
from drivers.robotiq.model.gripper import ModelTransport
from drivers.takktile.driver import TakkTileDriver
from drivers.takktile.model.board import BoardModel
from drivers.takktile.model.link import ModelLink
from drivers.ur.driver import ArmDriver
from grasp.run.clock import VirtualClock
from scenarios.campaign.config import load_config
from scenarios.rigs.calibration import calibration
from scenarios.rigs.simulated import make_cell
from tests import conformance
from tests.conformance import Bench


class Wire:
    """The connection of a driver to its model; when cut, every call raises LinkLost."""

    def __init__(self, inner: Any) -> None:
        self._inner, self.is_cut = inner, False

    def cut(self) -> None:
        self.is_cut = True

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._inner, name)
        if not callable(found):
            return found

        def call(*args: Any, **given: Any) -> Any:
            if self.is_cut:
                raise LinkLost("cut", "connect it")
            return found(*args, **given)

        return call


class Cell:
    """The device models without an object, in virtual time."""

    def __init__(self) -> None:
        self.config = load_config("can", "simulated", "energy", None, ["hand.activation_s=0.5"])
        self.cell = make_cell(self.config, 0)
        self.fingertips = ModelLink(self.cell.board, self.config.tactile, self.cell.advance)
        self.clock = VirtualClock(self.fingertips.advance)

    def bench(self, device: Any, cut: Callable[[], object] | None = None) -> Bench[Any]:
        def wait(seconds: float) -> None:
            self.clock.sleep_until_ns(self.clock.now_ns + round(seconds * 1e9))

        return Bench(device, lambda: self.clock.now_ns, wait, cut)

    def gripper(self) -> tuple[RobotiqDriver, Wire]:
        wire = Wire(ModelTransport(self.cell.gripper))
        return RobotiqDriver(wire, self.config.gripper, calibration(self.config)), wire


@pytest.fixture
def cell() -> Cell:
    return Cell()


class TestRobotiq(conformance.GripperConformance):
    @pytest.fixture
    def bench(self, cell: Cell) -> Bench[Gripper]:
        gripper, wire = cell.gripper()
        return cell.bench(gripper, wire.cut)


class TestUniversalRobots(conformance.ArmConformance):
    @pytest.fixture
    def bench(self, cell: Cell) -> Bench[Arm]:
        wire = Wire(cell.cell.arm)
        return cell.bench(ArmDriver(wire, cell.config.arm), wire.cut)


class TestTakkTile(conformance.FingertipConformance):
    @pytest.fixture
    def bench(self, cell: Cell) -> Iterator[Bench[TactileSensor]]:
        """A board with rest codes until it is pressed."""
        codes = np.full(18, 450, np.int16)
        warm = np.full(18, 500, np.int16)
        board = BoardModel(cell.config.board, lambda t_ns: lambda: (codes.copy(), warm))
        link = ModelLink(board, cell.config.tactile)
        clock = VirtualClock(link.advance)

        def press() -> None:
            codes[:6] -= 100

        driver = TakkTileDriver(link, cell.config.tactile).start()
        yield Bench(
            driver, lambda: clock.now_ns,
            lambda s: clock.sleep_until_ns(clock.now_ns + round(s * 1e9)), board.unplug, press,
        )  # fmt: skip


# What the kit is for


def nothing(verb: Any) -> Callable[..., None]:
    return lambda *args: None
