"""Probes for the effect of driver settings: the drivers on simulated links."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.errors import Refused, Stale
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.model.gripper import HandSettings
from drivers.robotiq.settings import DriverSettings
from drivers.takktile.settings import TakkTileSettings
from drivers.ur.driver import ArmDriver, ArmSample
from drivers.ur.settings import ArmSettings
from tests.calibrations import PAPER
from tests.unit.drivers.robotiq.conftest import Rig
from tests.unit.drivers.takktile.test_driver import Bench

MS = 1_000_000
ZERO = (0.0, 0.0, 0.0)


# Arm: a link that stays at rest and records the commands


class StationaryArm:
    def __init__(self) -> None:
        self.sample = ArmSample(0, ZERO, ZERO, moving=False, protective_stop=False)
        self.stopped = False
        self.braked_mps2 = 0.0

    def move_l(self, *_: object) -> bool:
        return True

    def speed_l(self, *_: object) -> bool:
        return True

    def stop_l(self, deceleration_mps2: float, now_ns: int) -> None:
        self.stopped, self.braked_mps2 = True, deceleration_mps2

    def set_payload(self, mass_kg: float) -> None: ...

    def read(self, now_ns: int) -> ArmSample:
        return self.sample


def arm_driver(**settings: Any) -> tuple[ArmDriver, StationaryArm]:
    link = StationaryArm()
    wide = {"workspace_low_m": (-1.0,) * 3, "workspace_high_m": (1.0,) * 3, "max_jump_m": 1.0}
    driver = ArmDriver(link, ArmSettings(**{**wide, **settings}))
    driver.poll(0)
    return driver, link


def accepted(command: Callable[[], object]) -> bool:
    try:
        command()
    except Refused:
        return False
    return True


def moves(to: tuple[float, float, float], speed: float = 0.1, ramp: float = 0.5, **s: Any) -> bool:
    return accepted(lambda: arm_driver(**s)[0].move_to(to, speed, ramp))


def moves_along_any(x: float, **settings: Any) -> bool:
    """Whether a move is accepted; the same result on all three axes."""
    verdicts = {
        moves((x if axis == 0 else 0.0, x if axis == 1 else 0.0, x if axis == 2 else 0.0),
              **settings)
        for axis in range(3)
    }  # fmt: skip
    assert len(verdicts) == 1
    return verdicts.pop()


def hardest_stop_mps2(v: float) -> float:
    driver, link = arm_driver(max_stop_mps2=v)
    driver.stop(9.0)
    return link.braked_mps2


def trusted(v: float, age_s: float) -> bool:
    driver, _ = arm_driver(stale_after_s=v)
    try:
        driver.poll(round(age_s * 1e9))
    except Stale:
        return False
    return True


# Fingertips


def rest_taken(codes: int | None = None, noise: int = 0, **settings: Any) -> bool:
    bench = Bench(TakkTileSettings(**settings))
    if codes is not None:
        bench.codes = np.full(18, codes, np.int16)
    bench.noise = np.full(18, noise, np.int16)
    return accepted(bench.take_rest)


def missed_until_stale(v: int) -> int:
    bench = Bench(TakkTileSettings(stale_after_missed=v)).take_rest()
    bench.board.time_out(50)
    while not bench.frame.stale:
        bench.poll()
    return bench.frame.missed


def still_new(v: float, age_ms: float) -> bool:
    """Whether a sample that was converted so long ago is accepted."""

    def bench() -> Bench:
        return Bench(TakkTileSettings(max_age_ms=v)).take_rest()

    usual, late = bench(), bench()
    usual.poll()
    late.link.advance(usual.now_ns)  # the same sample has arrived
    late.driver.poll(usual.frame.sampled_ns + round(age_ms * MS))
    return late.frame.missed == 0


# Gripper: a hand with trusted positions is held by targets, any other by stopping it


def hand(at_counts: int, **settings: Any) -> Rig:
    """A hand on its way to a position, at full speed."""
    made = Rig(HandSettings(), PAPER, settings=DriverSettings(**settings))
    made.driver.move_to((at_counts,) * 3, 0.11, 10.0)
    return made


def between_writes_s(value: float) -> float:
    """Shortest time between two writes of constantly changing commands."""
    made = hand(50, write_interval_s=value)
    for counts in range(50, 250):
        made.driver.move_to((counts,) * 3, 0.11, 10.0)
        made.advance(1)
        made.driver.poll(made.now_ns)
    return float(np.diff(made.written_ns).min()) * 1e-9


def reads_before_a_write(value: int, old_s: float) -> bool:
    """Whether a status of that age is read again before a command goes out."""
    made = Rig(HandSettings(), PAPER, settings=DriverSettings(refresh_hz=value))
    made.step(2)
    before = made.driver.statistics.reads
    made.driver.move_to((50, 50, 50), 0.11, 10.0)
    made.driver.poll(made.now_ns + round(old_s * 1e9))
    return made.driver.statistics.reads > before + 1


# Calibration of the gripper


def calibrated(**figures: float) -> GripperCalibration:
    return GripperCalibration(name="own", source="measured", **{"least_force_n": 5.0, **figures})


def exponent_of_force(v: float) -> float:
    """Exponent of force over byte, from the force at a fifth of the range."""
    own = calibrated(force_exponent=v)
    share = (own.force_n(51) - own.force_n(0)) / (own.force_n(255) - own.force_n(0))
    return math.log(share) / math.log(51 / 255)


def speed_of_a_count_mps(v: float) -> float:
    own = calibrated(speed_step_mps=v)
    assert own.speed_byte_at_most(own.least_speed_mps + 100.5 * v) == 100
    return (own.speed_mps(255) - own.speed_mps(0)) / 255
