"""Everything that an acquisition can be told, one section a room, put together from layers."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from drivers.interfaces import PERIOD_S
from grasp.realtime import RealTimeSettings
from grasp.settings import Layer, load, not_chosen, thing_layer
from scenarios.acquire.press import PressControlSettings
from scenarios.rigs.calibration import Files, own_layers, rig_layers
from scenarios.rigs.config import PressRigConfig
from scenarios.world.contact_settings import GROSS_SLIP_MPS


class SamplingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Pace of the samples and of the labels. Jitter and losses are simulated; hardware has its
    own."""

    period_s: Annotated[float, Meta(ge=0.005, le=0.1, description="paper: 100 Hz")] = PERIOD_S
    jitter_s: Annotated[
        float, Meta(ge=0.0, le=0.002, description="deviation of a sample's time; the authors' "
                    "clip: 0.7 ms of a period, which is the difference of two")
    ] = 0.0005  # fmt: skip
    lost_share: Annotated[
        float, Meta(ge=0.0, le=0.5, description="of samples, repeated by the driver; clip: 1/400")
    ] = 0.0025
    slip_mps: Annotated[
        float, Meta(ge=0.0, le=0.1, description="label bound; paper, section III-B: 3 mm/s")
    ] = GROSS_SLIP_MPS
    slip_radps: Annotated[
        float, Meta(ge=0.0, le=2.0, description="label bound; paper, section III-B: 0.2 rad/s")
    ] = 0.2


class SessionSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Waits of a session, and how the arm leaves."""

    rest_timeout_s: Annotated[
        float, Meta(ge=0.5, le=60.0, description="for the rest counts; assumed")
    ] = 5.0
    loaded_rest_max_std_counts: Annotated[
        float, Meta(ge=1.0, le=1023.0, description="of a taxel, while rest counts are taken under "
                    "control.residual_n; assumed: whatever a pressed fingertip may do")
    ] = 200.0  # fmt: skip
    touch_timeout_s: Annotated[
        float, Meta(ge=1.0, le=300.0, description="from the start until something is touched, rest "
                    "counts included; assumed: 5 s, and 10 cm at control.approach_mps")
    ] = 15.0  # fmt: skip
    kept_after_s: Annotated[
        float, Meta(ge=0.0, le=10.0, description="from touch on samples are kept, and rest counts "
                    "under load are taken; assumed: half of control.settle_s")
    ] = 0.75  # fmt: skip
    retreat_mps: Annotated[
        float, Meta(ge=0.001, le=0.5, description="back to where it began; assumed")
    ] = 0.05
    stop_mps2: Annotated[
        float, Meta(ge=0.1, le=10.0, description="of the arm, when it stops and retreats; assumed")
    ] = 1.0
    stand_s: Annotated[
        float, Meta(ge=0.1, le=30.0, description="a stop is repeated so long, until the arm is "
                    "seen to stand; assumed")
    ] = 1.0  # fmt: skip


# The arm presses where a lift has its table, and follows strokes that accelerate themselves.
ARM = {
    "workspace_low_m": [-0.05, -0.05, -0.02],
    "workspace_high_m": [0.05, 0.05, 0.05],
    "max_acceleration_mps2": 4.0,
}


class AcquireConfig(PressRigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one acquisition; the arm's as in ARM, by ``load_acquire_config``."""

    control: PressControlSettings = PressControlSettings()
    sampling: SamplingSettings = SamplingSettings()
    session: SessionSettings = SessionSettings()
    realtime: RealTimeSettings = RealTimeSettings()


def load_acquire_config(
    surface: str, rig: str, files: Files = None, assignments: Sequence[str] = ()
) -> AcquireConfig:
    """Class defaults <- ARM <- rig <- surface <- files (or $GRASP_CONFIG) <- assignments.

    Of the rig's settings and of a file those of other scenarios are left out. Raises ConfigError
    for an unknown name or the first setting that is not allowed.
    """
    like, of_rig = rig_layers(rig)
    layers = [
        Layer("acquisition", {"arm": dict(ARM)}),
        *map(_of_this_scenario, of_rig),
        not_chosen(thing_layer("surfaces", "surface", surface)),
    ]
    *own, assigned = own_layers(files, assignments)
    layers += [*map(_of_this_scenario, own), assigned, Layer("command line", {"rig": like})]
    return load(AcquireConfig, layers)


def _of_this_scenario(layer: Layer) -> Layer:
    known = AcquireConfig.__struct_fields__
    return Layer(layer.source, {key: table for key, table in layer.table.items() if key in known})
