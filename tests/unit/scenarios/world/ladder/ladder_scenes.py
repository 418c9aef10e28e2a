"""Scenes that the tests of the contact ladder share."""

from typing import Any

import msgspec

from scenarios.world.blow import Blow
from scenarios.world.contact import finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.scene import ArmRise, Closing, Grip, Scene, squeeze
from scenarios.world.objects import GraspObject

SOFT = ContactSettings(shear_stiffness_npm=7000.0, relaxation_fraction=0.0)


def changed(struct: Any, **fields: object) -> Any:
    return msgspec.structs.replace(struct, **fields)


def body(**fields: object) -> GraspObject:
    plain = {
        "name": "test", "grip_counts": (55, 55, 55), "mass_kg": 0.3, "friction_static": 0.5,
        "friction_kinetic": 0.4, "wall_stiffness_npm": 2e5, "half_width_m": 0.0356,
    }  # fmt: skip
    return GraspObject(**{**plain, **fields})  # type: ignore[arg-type]


def lift(contact: ContactSettings = SOFT, **fields: Any) -> Scene:
    """Thumb 2 to 10 N at 110 N/s from 0.3 s on, arm 0.5 m/s2 to 0.1 m/s: the scene of the survey
    whose rigid solution is 23.266913 mm."""
    what = body()
    rise_npm = finger_stiffness(contact, what) * 2 / 3
    closing = Closing(start_s=0.3, speed_mps=110.0 / rise_npm, force_stop_n=10.0)
    plain = Scene(
        name="lift", duration_s=1.6, body=what, contact=contact, on_table=True,
        arm=ArmRise(speed_mps=0.1, acceleration_mps2=0.5),
        grip=Grip(travel_m=squeeze(what, contact, 1.0, 1.0), closing=closing),
    )  # fmt: skip
    return changed(plain, **fields)


def held(contact: ContactSettings = SOFT, thumb_n: float = 10.0, **fields: object) -> Scene:
    """In the air from the first instant, nothing else happening."""
    what: Any = fields.get("body", body(friction_kinetic=0.5))
    grip = Grip(travel_m=squeeze(what, contact, thumb_n / 2, thumb_n / 2))
    plain = Scene(name="held", duration_s=0.4, body=what, contact=contact, grip=grip)
    return changed(plain, **fields)


def tap(
    offset_m: float = 0.0,
    direction: str = "top",
    impulse_n_s: float = 0.2,
    duration_s: float = 8e-3,
) -> Blow:
    return Blow(
        impulse_n_s=impulse_n_s, duration_s=duration_s, offset_m=offset_m,
        direction=direction,  # type: ignore[arg-type]
    )  # fmt: skip
