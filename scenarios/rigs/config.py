"""Settings of a rig: its devices, their wires and models, and the world that is simulated on it."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from drivers.errors import ConfigError
from drivers.interfaces import FINGERS, KIT_TAXELS
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.driver import DriverSettings as GripperSettings
from drivers.robotiq.modbus import ModbusSettings
from drivers.robotiq.model.hand import HandSettings
from drivers.takktile.model.board import BoardModelSettings
from drivers.takktile.settings import TakkTileSettings, UsbSettings
from drivers.ur.driver import ArmSettings
from drivers.ur.link.client import UrSettings
from drivers.ur.model import ArmModelSettings
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

ConfigT = TypeVar("ConfigT", bound=msgspec.Struct)
CUT = 2.5  # deviations, at which a normal draw of a seed is cut
# Entry points of devices that other packages offer. Each is a function of the settings for it and
# of a clock (nanoseconds, monotonic); it gives a context manager of what keeps to a protocol of
# drivers.interfaces, connected inside.
GROUPS = {"gripper": "grasp.grippers", "arm": "grasp.arms", "fingertips": "grasp.fingertips"}
Scalar = bool | int | float | str
PackageSettings = Annotated[dict[str, Scalar], Meta(description="what its package opens it with")]


@cache
def offered_devices(device: str) -> dict[str, EntryPoint]:
    """Devices of one kind that installed packages offer, by name."""
    return {each.name: each for each in entry_points(group=GROUPS[device])}


class OwnDeviceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Devices of other packages in place of ours, by the names of their entry points. They count as
    real: they are opened on the rig hardware alone."""

    gripper: Annotated[str, Meta(description="of grasp.grippers; empty: Robotiq 3-Finger")] = ""
    arm: Annotated[str, Meta(description="of grasp.arms; empty: Universal Robots")] = ""
    fingertips: Annotated[str, Meta(description="of grasp.fingertips; empty: TakkTile")] = ""
    gripper_settings: PackageSettings = msgspec.field(default_factory=dict)
    arm_settings: PackageSettings = msgspec.field(default_factory=dict)
    fingertips_settings: PackageSettings = msgspec.field(default_factory=dict)

    @property
    def chosen(self) -> dict[str, str]:
        """Names of the devices that are not ours, by kind."""
        named = zip(GROUPS, (self.gripper, self.arm, self.fingertips), strict=True)
        return {device: name for device, name in named if name}

    def settings(self, device: str) -> dict[str, Scalar]:
        given = (self.gripper_settings, self.arm_settings, self.fingertips_settings)
        return dict(zip(GROUPS, given, strict=True))[device]

    def called(self, device: str) -> str:
        """The name and settings of a device, for locks and messages."""
        given = ",".join(f"{key}={value}" for key, value in sorted(self.settings(device).items()))
        return f"{self.chosen[device]}({given})"

    def check_offered(self) -> None:
        """Raises ConfigError for a name that no installed package offers."""
        for device, name in self.chosen.items():
            if name not in (known := offered_devices(device)):
                offers = ", ".join(known) or f"none is installed (entry points {GROUPS[device]})"
                raise ConfigError("devices", device, f"unknown: {name!r}", offers)


class VariationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Spreads between trials, all assumed; zero switches one off."""

    friction_cv: Annotated[float, Meta(ge=0, le=0.3, description="of both frictions")] = 0.08
    mass_cv: Annotated[float, Meta(ge=0, le=0.3, description="of the mass, relative")] = 0.02
    finger_scatter_m: Annotated[
        float, Meta(ge=0, le=0.005, description="deviation of where a finger stops")
    ] = 0.00008
    start_height_m: Annotated[
        float, Meta(ge=0, le=0.02, description="deviation of the grip's height on the object")
    ] = 0.002
    force_stop_fraction: Annotated[
        float, Meta(ge=0, le=0.5, description="motors stop up to this below their calibrated force")
    ] = 0.05
    width_error_m: Annotated[
        float, Meta(ge=-0.02, le=0.02, description="the object is so much wider a side, always")
    ] = 0.0
    aside_m: Annotated[
        float, Meta(ge=0, le=0.02, description="deviation of the weight beside the grip's middle")
    ] = 0.002
    command_latency_s: Annotated[
        float, Meta(ge=0, le=0.2, description="added command-to-motor latency, 0 to this")
    ] = 0.01


def wider(body: GraspObject, settings: VariationSettings) -> GraspObject:
    """As wide as it is in every trial."""
    width_m = body.half_width_m + settings.width_error_m
    return msgspec.structs.replace(body, half_width_m=width_m)


class RigConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Arm and fingertips, which every rig has: drivers, wires and models."""

    rig: str
    devices: OwnDeviceSettings = OwnDeviceSettings()
    arm: ArmSettings = ArmSettings()
    tactile: TakkTileSettings = TakkTileSettings()
    usb: UsbSettings = UsbSettings()
    ur: UrSettings = UrSettings()
    board: BoardModelSettings = BoardModelSettings()
    arm_model: ArmModelSettings = ArmModelSettings()
    fingertip: FingertipSettings = FingertipSettings()

    @property
    def real(self) -> bool:
        """Whether its devices are a lab's own."""
        return self.rig == "hardware"

    def __post_init__(self) -> None:
        if not self.real and self.devices.chosen:
            device, name = next(iter(self.devices.chosen.items()))
            raise ValueError(
                f"devices.{device}: {name!r} is of another package and counts as real: it is "
                f"opened on the rig hardware alone, not on {self.rig}"
            )
        felt = len(self.fingertip.taxels_mm) or KIT_TAXELS
        if felt != self.tactile.taxels:
            raise ValueError(
                f"fingertip.taxels_mm: {felt} taxels, but tactile.cells has {self.tactile.taxels} "
                "a finger"
            )
        if not self.real and len(self.board.cells) != FINGERS * felt:
            raise ValueError(
                f"board.cells: {len(self.board.cells)} cells, but {FINGERS} fingers of {felt}"
            )


class GraspRigConfig(RigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """With a hand, and an object to grasp."""

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
                f"object.half_width_m with variation.width_error_m: {half_m * 1e3:g} mm, and the "
                f"hand opens {HALF_APERTURE_M * 1e3:g} mm a side"
            )


class PressRigConfig(RigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Without a hand: one fingertip points down on a fixed surface."""

    surface: FixedSurface
    finger: Annotated[
        int, Meta(ge=0, le=2, description="which is pressed: A, B, C are 0, 1, 2")
    ] = 0
    press: PressSettings = PressSettings()


AnyRigConfig = GraspRigConfig | PressRigConfig


def part(config: msgspec.Struct, cls: type[ConfigT]) -> ConfigT:
    """Those sections of a configuration that a class declares."""
    return cls(**{name: getattr(config, name) for name in cls.__struct_fields__})
