"""A scene states the terms that it needs as frozen data; the levels build those and nothing else.

Plane of motion: y across the closing axis, z up, rotation from y to z. The origin is the middle of
the grip at the start; the hand moves along z only.
"""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from scenarios.world.blow import Blow
from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats, finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.objects import GraspObject
from scenarios.world.scene_terms import PullSettings

Three = tuple[float, float, float]


class Closing(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Fingers that close until their own force stop, one finger at a time."""

    start_s: Annotated[float, Meta(ge=0.0, description="latency included")]
    speed_mps: Annotated[float, Meta(gt=0.0, le=0.11, description="of one finger; manual 110 mm/s")]
    force_stop_n: Annotated[float, Meta(gt=0.0, le=60.0, description="at the tip of each motor")]
    fingers: Literal["thumb", "all"] = "thumb"


class Grip(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Normal forces follow from where the fingers are and from the compliances."""

    travel_m: Three
    closing: Closing | None = None


class ArmRise(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Arm from rest to a constant speed upwards, for the whole scene."""

    speed_mps: Annotated[float, Meta(gt=0.0, le=1.0, description="paper's training: 0.05-0.1")]
    acceleration_mps2: Annotated[float, Meta(gt=0.0, le=5.0, description="assumed, 0.3-1.2")]


class Vibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sinusoidal motion of the hand along z, already going on when the scene begins."""

    acceleration_mps2: Annotated[float, Meta(gt=0.0, le=50.0, description="peak")]
    frequency_hz: Annotated[float, Meta(ge=1.0, le=500.0)]

    @property
    def rate(self) -> float:
        """Angular frequency, rad/s."""
        return 2 * math.pi * self.frequency_hz


class Scene(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that happens to one object between three fingers. None: there is no such term."""

    name: str
    duration_s: Annotated[float, Meta(gt=0.0, le=60.0)]
    body: GraspObject
    contact: ContactSettings
    grip: Grip
    on_table: bool = False  # else the hand holds the object from the first instant
    sharing: Literal["by_force", "equal"] = "by_force"  # of the weight then, between the fingers
    arm: ArmRise | None = None
    tap: Blow | None = None
    pull: PullSettings | None = None  # ``after_s``: since the scene began
    vibration: Vibration | None = None
    mark_height_m: Annotated[
        float, Meta(ge=-0.2, le=0.3, description="tape mark above the grip, where slip is read")
    ] = 0.05

    def __post_init__(self) -> None:
        along = self.tap is not None and self.tap.direction == "closing"
        if along and self.grip.closing is not None:
            raise ValueError("fingers that close are no part of a blow along the closing axis")

    @property
    def mass_kg(self) -> float:
        return self.body.total_kg

    def closing_vector(self) -> Floats:
        """Closing as the compiled levels take it, (8,): see laws.follow."""
        out = np.zeros(2 + 2 * FINGERS)
        closing = self.grip.closing
        if closing is None:
            out[0] = math.inf
            return out
        out[:2] = closing.start_s, closing.force_stop_n
        out[2] = closing.speed_mps
        out[3:5] = closing.speed_mps if closing.fingers == "all" else 0.0
        return out

    def initial_stretch(self, normal_n: Floats) -> Floats:
        """Shear of each pad, (3,), m, that carries the weight at the start; zeros on a table."""
        if self.on_table or normal_n.sum() == 0.0:
            return np.zeros(FINGERS)
        touching = normal_n > 0.0
        share = normal_n if self.sharing == "by_force" else touching.astype(float)
        weight_n = self.mass_kg * GRAVITY_MPS2
        stretch: Floats = weight_n * share / share.sum() / self.contact.shear_stiffness_npm
        return stretch


def squeeze(body: GraspObject, contact: ContactSettings, b_n: float, c_n: float) -> Three:
    """Finger travel, m, at which B and C press with b_n and c_n and the thumb with their sum."""
    k = finger_stiffness(contact, body)
    touch = contact.half_aperture_m - body.half_width_m
    return touch + (b_n + c_n) / k, touch + b_n / k, touch + c_n / k
