"""What a lift's slip distance owes to each term of its scene, as in docs/physics.md."""

import math
from typing import Any

import msgspec
import pytest

from scenarios.world.ladder.levels import simulate
from scenarios.world.ladder.scene import Scene
from scenarios.world.world_settings import Level
from tests.unit.scenarios.world.ladder.ladder_scenes import SOFT, changed, lift

STEP_S = 2e-5
RULER_MM = 1e-3


def slip_mm(scene: Scene, level: Level = Level.SLIDER) -> float:
    """At the tape mark, extrapolated from two steps; infinite once the object is lost."""
    coarse, fine = (simulate(scene, level, step_s) for step_s in (STEP_S, 0.5 * STEP_S))
    return 1e3 * (2 * fine.slip_m - coarse.slip_m) if fine.held else math.inf


def closing(**fields: Any) -> Scene:
    """The lift with another end of its grip."""
    grip = lift().grip
    return lift(grip=changed(grip, closing=changed(grip.closing, **fields)))


def pads(**fields: Any) -> Scene:
    return lift(msgspec.structs.replace(SOFT, **fields))


def body(**fields: Any) -> Scene:
    return lift(body=changed(lift().body, **fields))


CHANGES: dict[str, tuple[Scene, Level]] = {
    "no table": (lift(on_table=False), Level.SLIDER),
    "arm starts ten times as hard": (lift(arm=changed(lift().arm, acceleration_mps2=5.0)),
                                  Level.SLIDER),
    "thumb at its full 110 mm/s": (closing(speed_mps=0.11), Level.SLIDER),
    "thumb closes 10 ms later": (closing(start_s=0.31), Level.SLIDER),
    "pads relax by a tenth": (pads(relaxation_fraction=0.1), Level.SLIDER),
    "rigid (L0)": (lift(), Level.RIGID),
    "pads of 1e5 N/m": (pads(shear_stiffness_npm=1e5), Level.SLIDER),
    "no damper": (pads(shear_damping_nspm=0.0), Level.SLIDER),
    "weight 5 mm aside, L4": (body(centre_aside_m=0.005), Level.BRUSH),
    "static friction equal to kinetic": (body(friction_static=0.4), Level.SLIDER),
    "L4 instead of L1, centred": (lift(), Level.BRUSH),
}  # fmt: skip


@pytest.mark.bench
def test_what_a_lift_owes_to_each_of_its_terms() -> None:
    whole = slip_mm(lift())
    print(f"\nL1: {whole:.2f} mm\n| change | mm |\n|---|---|")
    for name, (scene, level) in CHANGES.items():
        changed_mm = slip_mm(scene, level) - whole
        told = f"{changed_mm:+.3f}" if math.isfinite(changed_mm) else "falls out of the hand"
        print(f"| {name} | {told} |")
    assert abs(slip_mm(lift(), Level.BRUSH) - whole) < RULER_MM  # nothing turns it
