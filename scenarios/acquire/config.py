"""Settings of an acquisition, merged from layers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from drivers.errors import ConfigError
from grasp.run.realtime import RealTimeSettings
from grasp.settings import Layer, file_of, item_layer, load, without_chosen
from scenarios.acquire.press import PressControlSettings
from scenarios.rigs.calibration import Files, rig_layers, user_layers
from scenarios.rigs.config import PressRigConfig
from scenarios.world.objects import within

C = TypeVar("C", bound=msgspec.Struct)


class SamplingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sampling of a simulated board; hardware loses samples by itself."""

    lost_share: Annotated[float, within(0.0, 0.5)] = 0.0025  # repeated samples; real: 1/400


# The arm presses where a lift has its table, and must follow the acceleration of strokes.
ARM = {
    "workspace_low_m": [-0.05, -0.05, -0.02],
    "workspace_high_m": [0.05, 0.05, 0.05],
    "max_acceleration_mps2": 4.0,
}


class AcquireConfig(PressRigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one acquisition; ``load_acquire_config`` sets the arm's as in ARM."""

    control: PressControlSettings = PressControlSettings()
    sampling: SamplingSettings = SamplingSettings()
    realtime: RealTimeSettings = RealTimeSettings()


def load_acquire_config(
    surface: str, rig: str, files: Files = None, assignments: Sequence[str] = ()
) -> AcquireConfig:
    """Class defaults <- ARM <- rig <- surface <- files (or $GRASP_CONFIG) <- assignments.

    Settings of other scenarios in the rig and in files are ignored. Raises ConfigError for an
    unknown name and for the first setting that is not allowed.
    """
    like, of_rig = rig_layers(rig)
    layers = [
        Layer("acquisition", {"arm": dict(ARM)}),
        *map(_of_this_scenario, of_rig),
        without_chosen(item_layer("surfaces", "surface", surface)),
    ]
    *of_files, assigned = user_layers(files, assignments)
    layers += [*map(_of_this_scenario, of_files), assigned, Layer("command line", {"rig": like})]
    return load(AcquireConfig, layers)


def _of_this_scenario(layer: Layer) -> Layer:
    known = AcquireConfig.__struct_fields__
    return Layer(layer.source, {key: table for key, table in layer.table.items() if key in known})


def layout_file(name: str) -> Path | None:
    """Settings file of a layout of taxels, by path or name in config/layouts; None: the kit's."""
    return file_of("layouts", name) if name else None


def with_values(config: C, values: Mapping[str, Any]) -> C:
    """The configuration with some settings (`section.key`) replaced. Raises ConfigError."""
    tree = msgspec.to_builtins(config)
    for key, value in values.items():
        section, _, name = key.partition(".")
        if name not in tree.get(section, {}):
            raise ConfigError("randomise", key, "no such setting", "section.key of a setting")
        tree[section][name] = value
    return load(type(config), [Layer("randomise", tree)])
