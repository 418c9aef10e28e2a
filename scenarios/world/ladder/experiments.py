"""Scenes of the experiments for the contact ladder, the same as a run's (``runs``) with numbers of
their own: what a run takes from its trial's settings, from its seeds and from a search for the blow
is stated here, so that the planner can be asked where there is neither hand nor controller.
"""

from collections.abc import Callable
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from scenarios.world.blow import Blow
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.ladder.runs import REACTION_S, RunScene
from scenarios.world.ladder.scene import ArmRise, Scene, Vibration, squeeze
from scenarios.world.objects import GraspObject

TAP_S = 0.47  # longer than a run's corner: what a blow set swinging hardly moves any more


class SceneSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the scenes add to object and pads. All assumed; nothing here is measured."""

    first_thumb_n: Annotated[
        float, Meta(gt=0.0, le=10.0, description="before slip; assumed, 0.8-3 N")
    ] = 2.0
    final_thumb_n: Annotated[float, Meta(gt=0.0, le=60.0, description="paper, tap: 10 N")] = 10.0
    reaction_s: Annotated[
        float,
        Meta(ge=0.0, le=2.0, description="start of the rise to first closing; assumed, 0.1-0.6"),
    ] = 0.5 * sum(REACTION_S)
    closing_mps: Annotated[
        float, Meta(gt=0.0, le=0.11, description="the guard's bound for a rigid object")
    ] = 0.063
    arm_mps: Annotated[float, Meta(gt=0.0, le=1.0, description="assumed, 0.1-0.25")] = 0.1
    arm_mps2: Annotated[float, Meta(gt=0.0, le=5.0, description="assumed, 0.3-1.2")] = 0.5
    direction: Annotated[
        Literal["top", "side", "closing"],
        Meta(description="of a tap; closing: along that axis, as hard as on the top"),
    ] = "top"
    top_impulse_n_s: Annotated[float, Meta(gt=0.0, le=2.0, description="assumed, 0.08-0.45")] = 0.2
    side_impulse_n_s: Annotated[float, Meta(gt=0.0, le=2.0, description="assumed, 0.08-0.45")] = (
        0.12
    )
    blow_s: Annotated[float, Meta(gt=0.0, le=0.1, description="assumed, 2-16 ms")] = 8e-3
    top_offset_m: Annotated[
        float, Meta(ge=-0.1, le=0.1, description="of the blow, beside the grip; assumed, 0-40 mm")
    ] = 0.02
    side_offset_m: Annotated[
        float, Meta(ge=-0.1, le=0.2, description="of the blow, above the grip; assumed, 0-60 mm")
    ] = 0.04
    shake_mps2: Annotated[float, Meta(gt=0.0, le=50.0, description="peak; assumed, 2-10")] = 4.9
    shake_hz: Annotated[float, Meta(ge=1.0, le=500.0, description="assumed, 5-60")] = 20.0


class World(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sections of the configuration that a scene is made of."""

    object: GraspObject
    contact: ContactSettings = ContactSettings()
    scene: SceneSettings = SceneSettings()


def lift(world: World) -> Scene:
    """Too weak a grasp on the table, an arm that rises, a thumb that closes after the reaction."""
    return _described(world).lift()


def tap(world: World) -> Scene:
    """A blow on a held object: on its top, beside the middle of the grip, on its side, above it, or
    along the closing axis."""
    chosen = world.scene
    impulse_n_s, offset_m = {
        "top": (chosen.top_impulse_n_s, chosen.top_offset_m),
        "side": (chosen.side_impulse_n_s, chosen.side_offset_m),
        "closing": (chosen.top_impulse_n_s, 0.0),
    }[chosen.direction]
    blow = Blow(
        direction=chosen.direction, impulse_n_s=impulse_n_s, duration_s=chosen.blow_s,
        offset_m=offset_m,
    )  # fmt: skip
    return msgspec.structs.replace(_described(world).tap(blow), duration_s=TAP_S)


def hold(world: World) -> Scene:
    """A held object whose hand shakes."""
    shake = Vibration(acceleration_mps2=world.scene.shake_mps2, frequency_hz=world.scene.shake_hz)
    return _described(world).shaken(shake)


def _described(world: World) -> RunScene:
    """As a run's scene, with one reaction, and nothing that a seed draws."""
    body, contact, chosen = world.object, world.contact, world.scene
    first, final = 0.5 * chosen.first_thumb_n, 0.5 * chosen.final_thumb_n
    return RunScene(
        body=body, contact=contact, first_travel_m=squeeze(body, contact, first, first),
        full_grip_n=(chosen.final_thumb_n, final, final), closing_mps=chosen.closing_mps,
        arm=ArmRise(speed_mps=chosen.arm_mps, acceleration_mps2=chosen.arm_mps2),
        reaction_s=(chosen.reaction_s, chosen.reaction_s),
    )  # fmt: skip


SCENES: dict[str, Callable[[World], Scene]] = {"lift": lift, "tap": tap, "hold": hold}
