"""Settings of a rig: its devices, their links and models, and the simulated world."""

from functools import cache
from typing import TYPE_CHECKING, Annotated, TypeVar

import msgspec
from msgspec import Meta

from drivers.errors import ConfigError
from drivers.interfaces import FINGERS, KIT_TAXELS
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.model.hand import HandSettings
from drivers.robotiq.settings import DriverSettings as GripperSettings
from drivers.robotiq.settings import ModbusSettings
from drivers.takktile.settings import BoardModelSettings, TakkTileSettings, UsbSettings
from drivers.ur.settings import ArmModelSettings, ArmSettings, UrSettings
from scenarios.world.objects import GraspObject
from scenarios.world.settings import (
    HALF_APERTURE_M,
    ContactSettings,
    DamageSettings,
    FingertipSettings,
    FixedSurface,
    PressSettings,
    PullSettings,
    WorldSettings,
)

if TYPE_CHECKING:  # slow to import, and rarely needed
    from importlib.metadata import EntryPoint

ConfigT = TypeVar("ConfigT", bound=msgspec.Struct)
HARDWARE = "hardware"  # the rig of real devices
CUT_SIGMAS = 2.5  # normal variates are clipped at this many standard deviations
# Entry points of devices of other packages. Each is a function of its settings and of a clock
# (monotonic, ns) that returns a context manager of a connected device with a protocol of
# drivers.interfaces.
GROUPS = {"gripper": "grasp.grippers", "arm": "grasp.arms", "fingertips": "grasp.fingertips"}
Scalar = bool | int | float | str
PackageSettings = Annotated[
    dict[str, Scalar], Meta(description="settings for the package of that device")
]


@cache
def plugin_devices(device: str) -> dict[str, "EntryPoint"]:
    """Entry points of one kind of device in installed packages, by name."""
    from importlib.metadata import entry_points

    return {each.name: each for each in entry_points(group=GROUPS[device])}


class PluginDeviceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Devices of other packages, by the names of their entry points. They count as real: only the
    rig hardware opens them."""

    gripper: Annotated[
        str, Meta(description="entry point in grasp.grippers; empty: Robotiq 3-Finger")
    ] = ""
    arm: Annotated[str, Meta(description="entry point in grasp.arms; empty: Universal Robots")] = ""
    fingertips: Annotated[
        str, Meta(description="entry point in grasp.fingertips; empty: TakkTile")
    ] = ""
    gripper_settings: PackageSettings = msgspec.field(default_factory=dict)
    arm_settings: PackageSettings = msgspec.field(default_factory=dict)
    fingertips_settings: PackageSettings = msgspec.field(default_factory=dict)

    @property
    def chosen(self) -> dict[str, str]:
        """Names of the devices of other packages, by kind."""
        named = zip(GROUPS, (self.gripper, self.arm, self.fingertips), strict=True)
        return {device: name for device, name in named if name}

    def settings(self, device: str) -> dict[str, Scalar]:
        given = (self.gripper_settings, self.arm_settings, self.fingertips_settings)
        return dict(zip(GROUPS, given, strict=True))[device]

    def label(self, device: str) -> str:
        """Name and settings of a device, for locks and messages."""
        given = ",".join(f"{key}={value}" for key, value in sorted(self.settings(device).items()))
        return f"{self.chosen[device]}({given})"

    def check_installed(self) -> None:
        """Raises ConfigError for a name without an entry point."""
        for device, name in self.chosen.items():
            if name not in (known := plugin_devices(device)):
                allowed = ", ".join(known) or f"none is installed (entry points {GROUPS[device]})"
                raise ConfigError("devices", device, f"unknown: {name!r}", allowed)


class VariationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Standard deviations between trials, all assumed; zero switches one off."""

    friction_cv: Annotated[
        float, Meta(ge=0, le=0.3, description="relative standard deviation of friction")
    ] = 0.08
    mass_cv: Annotated[
        float, Meta(ge=0, le=0.3, description="relative standard deviation of the object's mass")
    ] = 0.02
    finger_scatter_m: Annotated[
        float, Meta(ge=0, le=0.005, description="standard deviation of a finger's stop position")
    ] = 0.00008
    start_height_m: Annotated[
        float, Meta(ge=0, le=0.02, description="standard deviation of the grip height")
    ] = 0.002
    force_stop_fraction: Annotated[
        float,
        Meta(
            ge=0, le=0.5, description="largest fraction by which motors stop below calibrated force"
        ),
    ] = 0.05
    width_error_m: Annotated[
        float,
        Meta(ge=-0.02, le=0.02, description="added to the object's half width in every trial"),
    ] = 0.0
    aside_m: Annotated[
        float, Meta(ge=0, le=0.02, description="standard deviation of the centre of mass, sideways")
    ] = 0.002
    command_latency_s: Annotated[
        float, Meta(ge=0, le=0.2, description="largest added command-to-motor latency (uniform)")
    ] = 0.01


def wider(body: GraspObject, settings: VariationSettings) -> GraspObject:
    """The object with the width error of every trial."""
    width_m = body.half_width_m + settings.width_error_m
    return msgspec.structs.replace(body, half_width_m=width_m)


class RigConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of arm and fingertips on any rig: drivers, links and models."""

    rig: str
    devices: PluginDeviceSettings = PluginDeviceSettings()
    arm: ArmSettings = ArmSettings()
    tactile: TakkTileSettings = TakkTileSettings()
    usb: UsbSettings = UsbSettings()
    ur: UrSettings = UrSettings()
    board: BoardModelSettings = BoardModelSettings()
    arm_model: ArmModelSettings = ArmModelSettings()
    fingertip: FingertipSettings = FingertipSettings()

    @property
    def real(self) -> bool:
        """Whether its devices are real."""
        return self.rig == HARDWARE

    def __post_init__(self) -> None:
        if not self.real and self.devices.chosen:
            device, name = next(iter(self.devices.chosen.items()))
            raise ValueError(
                f"devices.{device}: {name!r} of another package counts as real: only the rig "
                f"hardware opens it, not {self.rig}"
            )
        taxels = len(self.fingertip.taxels_mm) or KIT_TAXELS
        if taxels != self.tactile.taxels:
            raise ValueError(
                f"fingertip.taxels_mm: {taxels} taxels, but tactile.cells has "
                f"{self.tactile.taxels} per finger"
            )
        if not self.real and len(self.board.cells) != FINGERS * taxels:
            raise ValueError(
                f"board.cells: {len(self.board.cells)} cells for {FINGERS} x {taxels} taxels"
            )


class GraspRigConfig(RigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a rig with a hand and an object to grasp."""

    object: GraspObject
    gripper: GripperSettings = GripperSettings()
    calibration: GripperCalibration | None = None  # from the file that gripper.calibration names
    modbus: ModbusSettings = ModbusSettings()
    hand: HandSettings = HandSettings()
    contact: ContactSettings = ContactSettings()
    variation: VariationSettings = VariationSettings()
    world: WorldSettings = WorldSettings()
    pull: PullSettings = PullSettings()
    damage: DamageSettings = DamageSettings()

    def __post_init__(self) -> None:
        super().__post_init__()
        half_m = wider(self.object, self.variation).half_width_m
        if not self.real and not 0.0 < half_m < HALF_APERTURE_M:
            raise ValueError(
                f"object.half_width_m plus variation.width_error_m: {half_m * 1e3:g} mm; allowed: "
                f"above 0, below the {HALF_APERTURE_M * 1e3:g} mm that the hand opens per side"
            )


class PressRigConfig(RigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a rig without a hand: one fingertip is pressed down on a fixed surface."""

    surface: FixedSurface
    finger: Annotated[
        int, Meta(ge=0, le=2, description="pressed fingertip: A, B, C are 0, 1, 2")
    ] = 0
    press: PressSettings = PressSettings()


AnyRigConfig = GraspRigConfig | PressRigConfig


def part(config: msgspec.Struct, cls: type[ConfigT]) -> ConfigT:
    """The sections of a configuration that ``cls`` declares."""
    return cls(**{name: getattr(config, name) for name in cls.__struct_fields__})
