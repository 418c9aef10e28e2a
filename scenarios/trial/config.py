"""Settings of a trial whatever it tries, and the digest of those that a result depends on."""

import hashlib
from collections.abc import Mapping
from functools import cache
from typing import Any, Self

import msgspec

from detector.decision import RuleSettings
from detector.energy import EnergySettings
from detector.interface import (
    NETWORK,
    SECTIONS,
    SlipDetector,
    fingerprint_of,
    load_detector,
    memory_of,
    section_of,
    settings_of,
)
from detector.network import NetworkSettings
from detector.network_file import is_weights
from detector.plugins import Scalar, is_plugin_file
from detector.psd import PsdFairSettings, PsdSettings
from grasp.controller_settings import ControllerSettings, LoopSettings
from grasp.guard import GuardSettings
from grasp.monitors.settings import MonitorSettings
from grasp.realtime import RealTimeSettings
from grasp.settings import config_dir, load, read_toml
from grasp.slip_monitor import SlipSettings
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.permission import HARDWARE
from scenarios.world.settings import ContactLevels, ContactTable

DEFAULT_PROFILE = "default"

# No result depends on these: names of settings that are resolved here, texts for people, and how
# the machine is asked to be quick; figures that a calibration was made from are hashed themselves.
UNHASHED = ("profile", "source", "usb", "realtime")
UNHASHED_KEYS = {
    "gripper": ("calibration",),
    "calibration": ("name", "pressed_bytes", "presses"),
    "object": ("description",),
    "modbus": ("host", "port", "serial_port", "slave"),
    "ur": ("host",),
}
# Nor on wires in simulation, nor on models on hardware; but `contact` says how hard a tap shall be.
UNUSED = {
    "simulated": ("modbus", "ur"),
    HARDWARE: (
        "board", "arm_model", "fingertip", "hand", "variation", "pull", "damage", "world",
    ),
}  # fmt: skip


class SourceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How figures of one's own were come by, for people alone; of the hand, `calibration.source`
    says it."""

    counts_per_newton: str = ""  # of guard.counts_per_newton, by `grasp calibrate force`
    rule: str = ""  # of rule, by `grasp calibrate noise`

    def in_words(self) -> list[str]:
        """A line for each that is known."""
        sources = {"counts a newton": self.counts_per_newton, "rule on slip": self.rule}
        return [f"{what} by: {source}" for what, source in sources.items() if source]


class TrialConfig(GraspRigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rig and control of one trial; ``rig``, ``profile`` and ``detector_name`` are names.

    Of the sections of detectors, the one counts that the detector asked for takes.
    """

    profile: str = DEFAULT_PROFILE
    detector_name: str
    controller: ControllerSettings = ControllerSettings()
    guard: GuardSettings = GuardSettings()
    source: SourceSettings = SourceSettings()
    monitors: MonitorSettings = MonitorSettings()
    slip: SlipSettings = SlipSettings()
    rule: RuleSettings = RuleSettings()
    energy: EnergySettings = EnergySettings()
    psd: PsdSettings = PsdSettings()
    psd_fair: PsdFairSettings = PsdFairSettings()
    network: NetworkSettings = NetworkSettings()
    plugin: dict[str, Scalar] = msgspec.field(
        default_factory=dict
    )  # arguments of a detector plugin
    loop: LoopSettings = LoopSettings()
    realtime: RealTimeSettings = RealTimeSettings()

    @property
    def detector_section(self) -> str:
        """Of the settings that the detector asked for takes."""
        return section_of(self.detector_name)

    @property
    def detector_label(self) -> str:
        """Its name as results give it: with the weights, where they are another's."""
        weights = self.network.weights if self.detector_section == NETWORK else ""
        return f"{self.detector_name} ({weights})" if weights else self.detector_name

    def make_detector(self, fingers: int, taxels: int | None = None) -> SlipDetector:
        """The detector asked for, for this hand's taxels or so many; raises BadFile for a network's
        damaged file, UsageError for one that was trained on another layout."""
        settings = settings_of(self.detector_name, self)
        return load_detector(self.detector_name, settings, fingers, taxels or self.tactile.taxels)

    @property
    def memory_s(self) -> float:
        """How long the detector asked for remembers; 0 for one whose memory fades. Raises BadFile
        as ``make_detector``."""
        settings = settings_of(self.detector_name, self)
        return memory_of(self.detector_name, settings, self.tactile.taxels) * self.loop.period_s

    def scene(self, seed: int) -> str | None:
        """The row of the table of contact levels for that trial; None where no experiment is
        known."""
        return None

    def physics(self, seed: int) -> ContactLevels | None:
        """Contact levels and steps of that trial: by the table, or what settings say instead. None
        on hardware, and where no experiment is known."""
        scene = self.scene(seed)
        if scene is None or self.real:
            return None
        table, world, contact = contact_table(), self.world, self.contact
        rows: list[ContactLevels] = [getattr(table, scene)]
        rows += [table.aside] if self.object.centre_aside_m != 0.0 else []
        rows += [table.pull] if self.pull.force_n > 0.0 else []
        level, impact_level = max(row.level for row in rows), max(row.impact_level for row in rows)
        if world.level != "auto":
            level = impact_level = world.level
        if world.impact_level != "auto":
            impact_level = world.impact_level
        step_s = min(contact.step_s, *(row.step_s for row in rows))
        impact_step_s = min(contact.impact_step_s, *(row.impact_step_s for row in rows))
        return ContactLevels(
            level=level,
            step_s=step_s,
            impact_level=max(level, impact_level),
            impact_step_s=impact_step_s,
        )

    def built_for(self, seed: int) -> Self:
        """The settings that a rig is opened with: those levels and steps put in."""
        found, replace = self.physics(seed), msgspec.structs.replace
        if found is None:
            return self
        world = replace(self.world, level=found.level, impact_level=found.impact_level)
        contact = replace(self.contact, step_s=found.step_s, impact_step_s=found.impact_step_s)
        return replace(self, world=world, contact=contact)

    def digest(self) -> str:
        """Hash of all that a result depends on: equal digests and seeds mean equal runs."""
        return digest_of(msgspec.to_builtins(self))

    def detector_hash(self) -> str:
        """Fingerprint of what decides on slip: weights or formula, and rule. Equal in trials
        that differ otherwise."""
        section = self.detector_section
        table = msgspec.to_builtins({section: getattr(self, section), "rule": self.rule})
        return _hashed({**table, section: fingerprint_of(self.detector_name, table[section])})


@cache
def contact_table() -> ContactTable:
    """The packaged contact levels, by scene. Raises ConfigError."""
    return load(ContactTable, [read_toml(config_dir() / "contact_levels.toml")])


def digest_of(settings: Mapping[str, Any]) -> str:
    """``TrialConfig.digest`` of settings as a recording carries them."""
    name, rig = settings["detector_name"], settings["rig"]
    section = section_of(name)
    hidden = {*UNHASHED, *UNUSED.get(rig, ()), *(SECTIONS - {section})}
    table = {key: value for key, value in sorted(settings.items()) if key not in hidden}
    table[section] = fingerprint_of(name, settings[section])
    if is_plugin_file(name) or is_weights(name):
        del table["detector_name"]  # wherever it lies
    # of devices of other packages which they are, not where; nothing where all are ours
    devices = {k: v for k, v in table.pop("devices", {}).items() if isinstance(v, str) and v}
    if devices:
        table["devices"] = devices
    for part, keys in UNHASHED_KEYS.items():
        if table.get(part):  # hardware has no calibration at first
            table[part] = {k: v for k, v in table[part].items() if k not in keys}
    return _hashed(table)


def _hashed(table: Mapping[str, Any]) -> str:
    return hashlib.sha256(msgspec.json.encode(table)).hexdigest()[:16]
