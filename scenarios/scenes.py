"""Scenes of the experiments for the contact ladder: the trial's own object, pads and arm, without
its controller. The reaction comes at a stated time; what the loop does is `grasp run`'s affair."""

from collections.abc import Callable

import msgspec

from scenarios.world.contact import FINGERS, GRAVITY_MPS2, finger_stiffness
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.scene import (
    ArmRise,
    Closing,
    Grip,
    Plane,
    Scene,
    TapPulse,
    Vibration,
    squeeze,
)
from scenarios.world.objects import GraspObject

RADIUS_OF_GYRATION_M = 0.09  # of an object 0.3 m tall; assumed, 0.04-0.12
REACTION_S = 0.35  # from the start of the rise to the first closing; assumed, as `grasp run` shows
THUMB_N, LIMIT_N = 2.0, 10.0  # first and final force of the thumb (paper: 10 N in the tap)


class World(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sections of the configuration that a scene is made of."""

    object: GraspObject
    contact: ContactSettings = ContactSettings()


def plane_of(body: GraspObject, aside_m: float = 0.0) -> Plane:
    mass = body.mass_kg + body.added_mass_kg
    return Plane(inertia_kgm2=mass * RADIUS_OF_GYRATION_M**2, centre_of_mass_y_m=aside_m)


def lift(body: GraspObject, contact: ContactSettings, aside_m: float = 0.0) -> Scene:
    """Too weak a grasp on the table, an arm that rises, a thumb that closes 350 ms later."""
    rise_npm = finger_stiffness(contact, body) * 2 / FINGERS
    closing = Closing(start_s=REACTION_S, speed_mps=min(0.063, 110.0 / rise_npm),
                      force_stop_n=LIMIT_N)  # fmt: skip
    return Scene(
        name="lift", duration_s=1.6, body=body, contact=contact, on_table=True,
        grip=Grip(travel_m=squeeze(body, contact, 0.5 * THUMB_N, 0.5 * THUMB_N), closing=closing),
        plane=plane_of(body, aside_m), arm=ArmRise(speed_mps=0.1, acceleration_mps2=0.5),
    )  # fmt: skip


def tap(body: GraspObject, contact: ContactSettings, aside_m: float = 0.0) -> Scene:
    """A blow of 0.2 N s on the top of a held object, 20 mm beside the middle of the grip."""
    blow = TapPulse(impulse_ns=0.2, duration_s=8e-3, at_s=0.05, offset_m=0.02)
    return _held("tap", body, contact, aside_m, 0.5, blow)


def side_tap(body: GraspObject, contact: ContactSettings, aside_m: float = 0.0) -> Scene:
    """A blow of 0.12 N s on the side of a held object, 40 mm above the middle of the grip."""
    blow = TapPulse(impulse_ns=0.12, duration_s=8e-3, at_s=0.05, offset_m=0.04, direction="side")
    return _held("side-tap", body, contact, aside_m, 0.5, blow)


def hold(body: GraspObject, contact: ContactSettings, aside_m: float = 0.0) -> Scene:
    """A held object whose hand shakes at 20 Hz with 0.5 g."""
    shake = Vibration(acceleration_mps2=0.5 * GRAVITY_MPS2, frequency_hz=20.0)
    return _held("hold", body, contact, aside_m, 1.0, None, shake)


def _held(
    name: str, body: GraspObject, contact: ContactSettings, aside_m: float, duration_s: float,
    blow: TapPulse | None, shake: Vibration | None = None,
) -> Scene:  # fmt: skip
    half = 0.5 * LIMIT_N
    return Scene(
        name=name, duration_s=duration_s, body=body, contact=contact,
        grip=Grip(travel_m=squeeze(body, contact, half, half)),
        plane=plane_of(body, aside_m), tap=blow, vibration=shake,
    )  # fmt: skip


SCENES: dict[str, Callable[[GraspObject, ContactSettings, float], Scene]] = {
    "lift": lift, "tap": tap, "side-tap": side_tap, "hold": hold,
}  # fmt: skip
