"""A scene states the terms that it needs as frozen data; the levels build those and nothing else.

Plane of motion: y across the closing axis, z up, rotation counter-clockwise as seen by the thumb's
opponents. The origin is the middle of the grip at the start; the hand moves along z only.
"""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from scenarios.world.contact import FINGERS, GRAVITY_MPS2, Floats, finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.objects import GraspObject

Three = tuple[float, float, float]


class Plane(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a rotation in the hand needs to know. Levels L0 and L1 ignore it."""

    inertia_kgm2: Annotated[
        float,
        Meta(gt=0.0, le=0.1, description="about the closing axis; assumed, can 65 mm x 0.3 m"),
    ] = 2.5e-3
    centre_of_mass_y_m: Annotated[
        float, Meta(ge=-0.1, le=0.1, description="beside the middle of the grip; assumed 0")
    ] = 0.0
    centre_of_mass_z_m: Annotated[
        float, Meta(ge=-0.2, le=0.2, description="above the middle of the grip; assumed 0")
    ] = 0.0
    finger_spacing_m: Annotated[
        float, Meta(ge=0.0, le=0.1, description="of B and C; assumed, 40-75 mm")
    ] = 0.06
    mark_height_m: Annotated[
        float, Meta(ge=-0.2, le=0.3, description="tape mark above the grip, where slip is read")
    ] = 0.05


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


class TapPulse(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Half-sine blow of a mallet: on the top, downwards, or on the side, along y."""

    impulse_n_s: Annotated[float, Meta(ge=0.0, le=2.0, description="assumed, 0.08-0.45 N s")]
    duration_s: Annotated[float, Meta(gt=0.0, le=0.1, description="assumed, 2-16 ms")]
    at_s: Annotated[float, Meta(ge=0.0)] = 0.01
    direction: Literal["top", "side"] = "top"
    offset_m: Annotated[
        float, Meta(ge=-0.2, le=0.2, description="from the grip's middle: beside it, or above it")
    ] = 0.0


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
    plane: Plane = Plane()
    on_table: bool = False  # else the hand holds the object from the first instant
    sharing: Literal["by_force", "equal"] = "by_force"  # of the weight then, between the fingers
    arm: ArmRise | None = None
    tap: TapPulse | None = None
    vibration: Vibration | None = None

    @property
    def mass_kg(self) -> float:
        return self.body.mass_kg + self.body.added_mass_kg

    def finger_places(self) -> Floats:
        """Middle of each pad, (3, 2), m: the thumb opposes the middle between B and C."""
        half = 0.5 * self.plane.finger_spacing_m
        return np.array([[0.0, 0.0], [-half, 0.0], [half, 0.0]])

    def closing_vector(self) -> Floats:
        """Closing as the compiled levels take it, (8,): see compliant.follow."""
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
