"""Three scenes by which contact models and integrators are compared, and every method's answer."""

import math
import time
from collections.abc import Callable

import msgspec
import numpy as np

from scenarios.world.blow import Blow
from scenarios.world.contact import Floats, finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder import comparators, reference
from scenarios.world.ladder.comparators import Method
from scenarios.world.ladder.levels import SceneOutcome, simulate
from scenarios.world.ladder.scene import ArmRise, Closing, Grip, Scene, Vibration, squeeze
from scenarios.world.objects import GraspObject
from scenarios.world.world_settings import Level

PADS = ContactSettings(shear_stiffness_npm=7000.0, relaxation_fraction=0.0)
BODY = GraspObject(
    name="yardstick", grip_counts=(55, 55, 55), mass_kg=0.3, friction_static=0.5,
    friction_kinetic=0.4, wall_stiffness_npm=2e5, half_width_m=0.0356,
)  # fmt: skip


def lift(pads: ContactSettings = PADS, duration_s: float = 1.6) -> Scene:
    """Thumb 2 to 10 N at 110 N/s from 0.3 s on; arm 0.5 m/s2 to 0.1 m/s."""
    rise_npm = finger_stiffness(pads, BODY) * 2 / 3
    closing = Closing(start_s=0.3, speed_mps=110.0 / rise_npm, force_stop_n=10.0)
    return Scene(
        name="lift", duration_s=duration_s, body=BODY, contact=pads, on_table=True,
        arm=ArmRise(speed_mps=0.1, acceleration_mps2=0.5),
        grip=Grip(travel_m=squeeze(BODY, pads, 1.0, 1.0), closing=closing),
    )  # fmt: skip


def tap() -> Scene:
    """A blow of 0.2 N s within 8 ms on the top, 20 mm beside the middle of a 10 N grip."""
    blow = Blow(impulse_n_s=0.2, duration_s=8e-3, offset_m=0.02)
    return msgspec.structs.replace(
        vibration(), name="tap", tap=blow, vibration=None, duration_s=0.4
    )


def vibration() -> Scene:
    """A 10 N grip shaken at 20 Hz: the peak load is 0.82 of the kinetic cone, nothing may slip."""
    return Scene(
        name="vibration", duration_s=1.0, body=BODY, contact=PADS,
        grip=Grip(travel_m=squeeze(BODY, PADS, 5.0, 5.0)),
        vibration=Vibration(acceleration_mps2=12.0, frequency_hz=20.0),
    )  # fmt: skip


class CostPoint(msgspec.Struct, frozen=True):
    """One run: what it cost and how far off it was."""

    scene: str
    curve: str
    step_s: float
    cost_us: float  # processor time of the thread, least of several runs
    error_m: float  # of the tape mark against the reference; NaN: diverged


Runner = Callable[[Scene, float], Floats]


def _mark(outcome: SceneOutcome) -> Floats:
    return np.array(outcome.mark_m)


def at_level(level: Level, points: int = 6) -> Runner:
    """Backward Euler at one level."""
    return lambda scene, step_s: _mark(simulate(scene, level, step_s, points))


def extrapolated(level: Level, points: int = 6) -> Runner:
    """Two steps, extrapolated: what the planner runs. The step is the coarser one."""

    def run(scene: Scene, step_s: float) -> Floats:
        coarse = _mark(simulate(scene, level, step_s, points))
        return 2 * _mark(simulate(scene, level, 0.5 * step_s, points)) - coarse

    return run


def explicit(order: int, level: Level) -> Runner:
    """The law of the ladder by explicit Euler (order 1) or RK4 (order 4)."""
    return lambda scene, step_s: _mark(reference.explicit(scene, level, step_s, order))


def other_law(method: Method) -> Runner:
    """LuGre or regularised Coulomb."""
    return lambda scene, step_s: _mark(comparators.run(scene, method, step_s))


def exact(scene: Scene) -> Floats:
    """The reference: adaptive, and the brush of 12 x 12 points where something turns."""
    if scene.tap is not None and scene.tap.offset_m != 0.0:
        return _mark(reference.adaptive(scene, Level.BRUSH, 1e-10, 12))
    return _mark(reference.adaptive(scene, Level.SLIDER, 1e-12))


def measure(
    scene: Scene, curve: str, run: Runner, step_s: float, truth: Floats, repeats: int = 5
) -> CostPoint:
    """Error and cost of one method at one step; the first run, which may compile, is not timed."""
    error = float(np.linalg.norm(run(scene, step_s) - truth))
    least = math.inf
    for _ in range(repeats):
        start = time.thread_time()
        run(scene, step_s)
        least = min(least, time.thread_time() - start)
    return CostPoint(scene.name, curve, step_s, least * 1e6, error)
