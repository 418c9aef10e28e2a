"""What differs from trial to trial with the seed: drawn from stated distributions, all assumed.

Drawn here: where the object is gripped, where each finger stops, friction, mass and
where it lies, the force at which
motors stop, and the gripper's timing. The fingertips draw their own rest counts, patch positions,
textures and noise (``scenarios.world.fingertip``), a tap its strength and moment
(``scenarios.tap.mallet``). "Normal" is cut at 2.5 deviations.
"""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from drivers.robotiq.model.hand import HandSettings
from scenarios.world.objects import GraspObject

CUT = 2.5  # deviations; no seed draws further


class VariationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Spreads between trials; zero switches one off."""

    friction_cv: Annotated[
        float, Meta(ge=0, le=0.3, description="relative deviation of both frictions; assumed")
    ] = 0.08
    mass_cv: Annotated[
        float, Meta(ge=0, le=0.3, description="relative deviation of the mass; assumed")
    ] = 0.02
    finger_scatter_m: Annotated[
        float, Meta(ge=0, le=0.005, description="deviation of where a finger stops; assumed")
    ] = 0.00008
    start_height_m: Annotated[
        float,
        Meta(ge=0, le=0.02, description="deviation of the grip's height on the object; assumed"),
    ] = 0.002
    force_stop_fraction: Annotated[
        float,
        Meta(
            ge=0,
            le=0.5,
            description="motors stop at up to this fraction below their calibrated force, which "
            "is taken for the highest that they reach; assumed",
        ),
    ] = 0.05
    width_error_m: Annotated[
        float,
        Meta(
            ge=-0.02,
            le=0.02,
            description="the object is this much wider a side than its finger positions were "
            "chosen for; no spread, the same in every trial",
        ),
    ] = 0.0
    aside_m: Annotated[
        float,
        Meta(
            ge=0,
            le=0.02,
            description="deviation of where the weight lies beside the grip's middle; assumed",
        ),
    ] = 0.002
    command_latency_s: Annotated[
        float, Meta(ge=0, le=0.2, description="added command-to-motor latency, 0 to this; assumed")
    ] = 0.01


class Draw(msgspec.Struct, frozen=True):
    """One draw."""

    body: GraspObject
    hand: HandSettings
    finger_offset_m: NDArray[np.float64]  # (3,) added travel of each finger


def wider(body: GraspObject, settings: VariationSettings) -> GraspObject:
    """As wide as it is in every trial."""
    width_m = body.half_width_m + settings.width_error_m
    return msgspec.structs.replace(body, half_width_m=width_m)


def draw(
    settings: VariationSettings, body: GraspObject, hand: HandSettings, rng: np.random.Generator
) -> Draw:
    """Object and hand of one trial. Draws the same numbers whatever the spreads are.

    Normal: friction, mass, start height, weight aside and each finger's stop; uniform: latency,
    refresh phase and force stop.
    """
    friction, mass = np.clip(rng.standard_normal(2), -CUT, CUT).tolist()
    scatter = np.clip(rng.standard_normal(3), -CUT, CUT)
    latency, phase = rng.uniform(size=2).tolist()
    height = float(np.clip(rng.standard_normal(), -CUT, CUT))
    weak = float(rng.uniform())
    aside = float(np.clip(rng.standard_normal(), -CUT, CUT))
    rub = 1 + settings.friction_cv * friction
    varied_body = msgspec.structs.replace(
        wider(body, settings),
        friction_static=body.friction_static * rub,
        friction_kinetic=body.friction_kinetic * rub,
        mass_kg=body.mass_kg * (1 + settings.mass_cv * mass),
        added_mass_kg=body.added_mass_kg * (1 + settings.mass_cv * mass),
        centre_aside_m=body.centre_aside_m + settings.aside_m * aside,
        grip_height_m=body.grip_height_m + settings.start_height_m * height,
        body_above_grip_m=body.body_above_grip_m - settings.start_height_m * height,
    )
    varied_hand = msgspec.structs.replace(
        hand,
        command_latency_s=hand.command_latency_s + settings.command_latency_s * latency,
        tick_phase_s=phase / hand.refresh_hz,
        least_force_n=hand.least_force_n * (1 - settings.force_stop_fraction * weak),
    )
    return Draw(varied_body, varied_hand, settings.finger_scatter_m * scatter)
