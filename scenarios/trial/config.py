"""Settings that every kind of trial has, and the hash of those that a result depends on."""

import hashlib
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Self

import msgspec
from msgspec import Meta

from detector.decision import RuleSettings
from detector.energy import EnergySettings
from detector.interface import SlipDetector
from detector.loading import (
    NETWORK,
    SECTIONS,
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
from grasp.control.controller_settings import ControllerSettings, LoopSettings
from grasp.control.guard import GuardSettings
from grasp.control.monitors.settings import MonitorSettings
from grasp.control.slip_monitor import SlipSettings
from grasp.run.realtime import RealTimeSettings
from grasp.settings import config_dir, load, read_toml
from scenarios.rigs.config import HARDWARE, GraspRigConfig
from scenarios.world.settings import ContactLevels, ContactTable

DEFAULT_PROFILE = "default"

# No result depends on these: names of files that are resolved here, descriptive texts, and the
# real-time priority. The values of a calibration are hashed, not its name or the readings behind
# it.
UNHASHED = ("profile", "source", "usb", "realtime")
UNHASHED_KEYS = {
    "gripper": ("calibration",),
    "calibration": ("name", "pressed_bytes", "presses"),
    "object": ("description",),
    "modbus": ("host", "port", "serial_port", "slave"),
    "ur": ("host",),
}
# Nor on addresses in simulation, nor on device models on hardware. `contact` counts on both: the
# search for the impulse of a tap uses it.
UNUSED = {
    "simulated": ("modbus", "ur"),
    HARDWARE: (
        "board", "arm_model", "fingertip", "hand", "variation", "pull", "damage", "world",
    ),
}  # fmt: skip


class SourceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Source of the values that the user calibrated, as text; that of the hand's calibration is
    `calibration.source`."""

    counts_per_newton: Annotated[
        str, Meta(description="source of guard.counts_per_newton, by grasp calibrate force")
    ] = ""
    rule: Annotated[str, Meta(description="source of [rule], by grasp calibrate noise")] = ""

    def in_words(self) -> list[str]:
        """One line for each known source."""
        sources = {"counts per newton": self.counts_per_newton, "decision rule": self.rule}
        return [f"{what} by: {source}" for what, source in sources.items() if source]


class TrialConfig(GraspRigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rig and control of one trial; ``rig``, ``profile`` and ``detector_name`` are names.

    Only the section of the selected detector is used.
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
    plugin: dict[str, Scalar] = msgspec.field(default_factory=dict)  # of a detector plugin
    loop: LoopSettings = LoopSettings()
    realtime: RealTimeSettings = RealTimeSettings()

    @property
    def detector_section(self) -> str:
        """Name of the settings section of the selected detector."""
        return section_of(self.detector_name)

    @property
    def detector_label(self) -> str:
        """Name of the detector in results, with the weights where they are not its own."""
        weights = self.network.weights if self.detector_section == NETWORK else ""
        return f"{self.detector_name} ({weights})" if weights else self.detector_name

    def make_detector(self, fingers: int, taxels: int | None = None) -> SlipDetector:
        """The selected detector for ``taxels`` a fingertip, by default this hand's.

        Raises BadFile for a network's damaged file, UsageError for one that was trained on another
        taxel layout."""
        settings = settings_of(self.detector_name, self)
        return load_detector(self.detector_name, settings, fingers, taxels or self.tactile.taxels)

    @property
    def memory_s(self) -> float:
        """Length of the selected detector's input window, s; 0 for one with a decaying memory.
        Raises BadFile as ``make_detector``."""
        settings = settings_of(self.detector_name, self)
        return memory_of(self.detector_name, settings, self.tactile.taxels) * self.loop.period_s

    def scene(self, seed: int) -> str | None:
        """The row of the contact level table for that trial; None for settings of no experiment."""
        return None

    def physics(self, seed: int) -> ContactLevels | None:
        """Contact levels and time steps of that trial, from the table or from the settings that
        override it. None on hardware, and for settings of no experiment."""
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
        """The settings to open a rig with: contact levels and steps of that trial filled in."""
        found, replace = self.physics(seed), msgspec.structs.replace
        if found is None:
            return self
        world = replace(self.world, level=found.level, impact_level=found.impact_level)
        contact = replace(self.contact, step_s=found.step_s, impact_step_s=found.impact_step_s)
        return replace(self, world=world, contact=contact)

    def digest(self) -> str:
        """Hash of every setting that a result depends on: equal hash and seed mean equal runs."""
        return digest_of(msgspec.to_builtins(self))

    def detector_hash(self) -> str:
        """Hash of the slip decision alone: weights or formula of the detector, and rule."""
        section = self.detector_section
        table = msgspec.to_builtins({section: getattr(self, section), "rule": self.rule})
        return _hashed({**table, section: fingerprint_of(self.detector_name, table[section])})


@cache
def contact_table() -> ContactTable:
    """The packaged contact levels, by scene. Raises ConfigError."""
    return load(ContactTable, [read_toml(config_dir() / "contact_levels.toml")])


def digest_of(settings: Mapping[str, Any]) -> str:
    """``TrialConfig.digest`` of settings read from a recording."""
    name, rig = settings["detector_name"], settings["rig"]
    section = section_of(name)
    hidden = {*UNHASHED, *UNUSED.get(rig, ()), *(SECTIONS - {section})}
    table = {key: value for key, value in sorted(settings.items()) if key not in hidden}
    table[section] = fingerprint_of(name, settings[section])
    if is_plugin_file(name) or is_weights(name):
        del table["detector_name"]  # a path: its content is hashed above
    # of devices from other packages their classes, not their addresses
    devices = {k: v for k, v in table.pop("devices", {}).items() if isinstance(v, str) and v}
    if devices:
        table["devices"] = devices
    for part, keys in UNHASHED_KEYS.items():
        if table.get(part):  # a new hand has no calibration yet
            table[part] = {k: v for k, v in table[part].items() if k not in keys}
    return _hashed(table)


def _hashed(table: Mapping[str, Any]) -> str:
    return hashlib.sha256(msgspec.json.encode(table)).hexdigest()[:16]
