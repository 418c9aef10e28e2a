"""Random taps and lifts, on which the planner's choices are judged. Ranges as in the scenes' own
settings; an object is heavy enough to slip in a lift and light enough to be held after it."""

import msgspec
import numpy as np

from scenarios.world.blow import Blow
from scenarios.world.contact import GRAVITY_MPS2, finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.scene import (
    ArmRise,
    Closing,
    Grip,
    Scene,
    squeeze,
)
from scenarios.world.objects import GraspObject

TAP_S, LIFT_S = 0.4, 1.2
ELASTIC = ContactSettings(relaxation_fraction=0.0)


def random_tap(rng: np.random.Generator) -> Scene:
    """A blow on the top or the side, half of each through the middle of the grip."""
    side, off_centre = rng.random() < 0.5, rng.random() < 0.5
    body = _body(rng)
    force_n = rng.uniform(6.0, 12.0)
    load_n = rng.uniform(0.25, 0.85) * body.friction_kinetic * 2 * force_n
    body = _weighing(body, load_n / GRAVITY_MPS2)
    offset = rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.04) if off_centre else 0.0
    tap = Blow(
        impulse_n_s=rng.uniform(0.05, 0.3), duration_s=rng.uniform(2e-3, 16e-3),
        direction="side" if side else "top", offset_m=offset,
    )  # fmt: skip
    travel = squeeze(body, ELASTIC, 0.5 * force_n, 0.5 * force_n)
    body = _slender(rng, body)
    return Scene(
        name="tap", duration_s=TAP_S, body=body, contact=ELASTIC, grip=Grip(travel_m=travel),
        tap=tap,
    )  # fmt: skip


def random_lift(rng: np.random.Generator) -> Scene:
    """Too weak a grasp that is tightened in time; half with the weight beside the grip."""
    body = _weighing(_body(rng), rng.uniform(0.25, 0.8))
    start_n = rng.uniform(0.2, 0.8) * body.mass_kg * GRAVITY_MPS2 / body.friction_static
    final_n = body.mass_kg * GRAVITY_MPS2 / body.friction_kinetic / rng.uniform(0.4, 0.9)
    off_centre = rng.random() < 0.5
    aside = rng.choice([-1.0, 1.0]) * rng.uniform(0.002, 0.01) if off_centre else 0.0
    share = rng.uniform(0.35, 0.65) if off_centre and rng.random() < 0.5 else 0.5
    b_n, c_n = 0.5 * start_n * share, 0.5 * start_n * (1.0 - share)
    slope = finger_stiffness(ELASTIC, body) * 2 / 3  # of the thumb's force while it closes alone
    closing = Closing(
        start_s=rng.uniform(0.1, 0.5), speed_mps=min(0.11, rng.uniform(40.0, 200.0) / slope),
        force_stop_n=0.5 * final_n,
    )  # fmt: skip
    body = _slender(rng, body, aside)
    return Scene(
        name="lift", duration_s=LIFT_S, body=body, contact=ELASTIC, on_table=True,
        grip=Grip(travel_m=squeeze(body, ELASTIC, b_n, c_n), closing=closing),
        arm=ArmRise(speed_mps=rng.uniform(0.05, 0.1), acceleration_mps2=rng.uniform(0.3, 1.2)),
    )  # fmt: skip


def _body(rng: np.random.Generator) -> GraspObject:
    friction = rng.uniform(0.5, 1.0)
    return GraspObject(
        name="random", grip_counts=(55, 55, 55), mass_kg=1.0, friction_static=friction,
        friction_kinetic=friction * rng.uniform(0.75, 1.0), wall_stiffness_npm=2e5,
        half_width_m=0.0356, body_above_grip_m=0.5,
    )  # fmt: skip


def _weighing(body: GraspObject, mass_kg: float) -> GraspObject:
    return msgspec.structs.replace(body, mass_kg=mass_kg)


def _slender(rng: np.random.Generator, body: GraspObject, aside_m: float = 0.0) -> GraspObject:
    """With a radius of gyration of 40 to 90 mm, and the weight so far beside the grip."""
    radius = rng.uniform(0.04, 0.09)
    return msgspec.structs.replace(body, radius_of_gyration_m=radius, centre_aside_m=aside_m)
