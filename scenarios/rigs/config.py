"""Everything that a lift or a tap can be told, one section a room, put together from layers."""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import msgspec

from detector.decision import RuleSettings
from detector.energy import EnergySettings
from detector.interface import DetectorSettings, SlipDetector, load_detector
from detector.network import NetworkSettings
from detector.psd import PsdFairSettings, PsdSettings
from drivers.robotiq.calibration import GripperCalibration
from drivers.robotiq.driver import DriverSettings as GripperSettings
from drivers.robotiq.link.modbus import ModbusSettings
from drivers.robotiq.model.gripper import HandSettings
from drivers.takktile.model.board import BoardModelSettings
from drivers.takktile.settings import TakkTileSettings, UsbSettings
from drivers.ur.driver import ArmSettings
from drivers.ur.link.client import UrSettings
from drivers.ur.model import ArmModelSettings
from grasp.controller import ControllerSettings
from grasp.guard import GuardSettings
from grasp.loop import LoopSettings
from grasp.realtime import RealTimeSettings
from grasp.settings import Layer, assignment_layer, load, named_layer, read_toml
from grasp.slip import SlipSettings
from scenarios.lift.scoring import ScoringSettings
from scenarios.rigs.calibration import calibration_layers
from scenarios.rigs.variation import VariationSettings
from scenarios.tap.settings import TapScoringSettings, TapSettings
from scenarios.world.contact_settings import ContactSettings
from scenarios.world.fingertip import FingertipSettings
from scenarios.world.objects import GraspObject

DEFAULT_PROFILE = "default"


class RunConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Resolved settings of one trial, lift or tap; ``rig``, ``profile``, ``detector_name``: names.

    Of the sections `detector` (the scalar's), `psd`, `psd_fair` and `network`, the one counts that
    the detector asked for takes.
    """

    rig: str
    profile: str = DEFAULT_PROFILE
    detector_name: str
    object: GraspObject
    controller: ControllerSettings = ControllerSettings()
    guard: GuardSettings = GuardSettings()
    slip: SlipSettings = SlipSettings()
    rule: RuleSettings = RuleSettings()
    detector: EnergySettings = EnergySettings()
    psd: PsdSettings = PsdSettings()
    psd_fair: PsdFairSettings = PsdFairSettings()
    network: NetworkSettings = NetworkSettings()
    loop: LoopSettings = LoopSettings()
    realtime: RealTimeSettings = RealTimeSettings()
    gripper: GripperSettings = GripperSettings()
    calibration: GripperCalibration | None = None  # from the file that gripper.calibration names
    arm: ArmSettings = ArmSettings()
    tactile: TakkTileSettings = TakkTileSettings()
    modbus: ModbusSettings = ModbusSettings()
    usb: UsbSettings = UsbSettings()
    ur: UrSettings = UrSettings(host="192.168.1.10")  # assumed; a lab names its own
    hand: HandSettings = HandSettings()
    board: BoardModelSettings = BoardModelSettings()
    arm_model: ArmModelSettings = ArmModelSettings()
    contact: ContactSettings = ContactSettings()
    fingertip: FingertipSettings = FingertipSettings()
    variation: VariationSettings = VariationSettings()
    scoring: ScoringSettings = ScoringSettings()
    tap: TapSettings = TapSettings()
    tap_scoring: TapScoringSettings = TapScoringSettings()

    def digest(self) -> str:
        """Hash of the resolved settings: equal digests and seeds mean equal runs."""
        return hashlib.sha256(msgspec.json.encode(self)).hexdigest()[:16]

    def make_detector(self, fingers: int) -> SlipDetector:
        """The detector asked for; raises BadFile for a network's damaged file."""
        formulas: dict[str, DetectorSettings] = {
            "energy": self.detector, "psd": self.psd, "psd-fair": self.psd_fair,
        }  # fmt: skip
        settings = formulas.get(self.detector_name, self.network)
        return load_detector(self.detector_name, settings, fingers)


def load_config(
    object_name: str,
    rig: str,
    detector: str | None = None,
    file: Path | None = None,
    assignments: Sequence[str] = (),
    profile: str = DEFAULT_PROFILE,
) -> RunConfig:
    """Class defaults <- rig <- profile <- object <- detector <- file (or $GRASP_CONFIG) <-
    assignments. Without a name of its own, the detector is the profile's.

    Raises ConfigError for an unknown name or the first setting that is not allowed.
    """
    whole = named_layer("profiles", profile)
    detector = detector or str(whole.table["detector_name"])
    layers = [
        named_layer("rigs", rig),
        whole,
        named_layer("objects", object_name),
        Layer("command line", {"rig": rig, "profile": profile, "detector_name": detector}),
        named_layer("detectors", detector),
    ]
    chosen = file or (Path(os.environ["GRASP_CONFIG"]) if "GRASP_CONFIG" in os.environ else None)
    if chosen is not None:
        layers.append(read_toml(chosen))
    layers.append(assignment_layer(assignments))
    return load(RunConfig, [*calibration_layers(layers), *layers])
