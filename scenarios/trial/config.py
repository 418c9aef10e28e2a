"""What a trial can be told whatever it tries: the rig, and what controls it. From layers."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec
from msgspec import Meta

from detector.decision import RuleSettings
from detector.energy import EnergySettings
from detector.interface import DetectorSettings, SlipDetector, load_detector, memory_of
from detector.network import NetworkSettings
from detector.network_file import is_weights, weights_digest, weights_path
from detector.plugins import MARK, OwnSettings, Scalar, code_digest, is_code, is_own, offered
from detector.psd import PsdFairSettings, PsdSettings
from drivers.errors import ConfigError
from grasp.controller_settings import ControllerSettings
from grasp.guard import GuardSettings
from grasp.loop_settings import LoopSettings
from grasp.monitors.settings import MonitorSettings
from grasp.realtime import RealTimeSettings
from grasp.settings import (
    CHOSEN,
    Layer,
    fingerprint,
    named_layer,
    names,
    not_chosen,
    own_files,
    own_name,
    read_toml,
    thing_layer,
)
from grasp.slip_monitor import SlipSettings
from scenarios.rigs.calibration import (
    Files,
    calibration_layers,
    own_layers,
    rig_layers,
)
from scenarios.rigs.config import GraspRigConfig
from scenarios.rigs.permission import HARDWARE
from scenarios.world.settings import ContactLevels

DEFAULT_PROFILE = "default"
# detectors that are formulas, and their sections
FORMULAS = {"energy": "energy", "psd": "psd", "psd-fair": "psd_fair"}
NETWORK = "network"  # the section of packaged networks, and of weights of one's own
OWN = "own"  # of code of one's own

# What no result depends on: where devices are, names of settings that are resolved here, what only
# people read, and how the machine is asked to be quick. Without wires, nor how they are used; on
# hardware, no model.
UNHASHED = ("profile", "files", "source", "usb", "realtime")
EVIDENCE = ("pressed_bytes", "presses", "reason")  # for figures that are hashed themselves
NAMES = {
    "gripper": ("calibration",),
    "calibration": ("name", *EVIDENCE),
    "object": ("description",),
}
ADDRESSES = {"modbus": ("host", "port", "serial_port", "slave"), "ur": ("host",)}
# Of devices and scene; `contact` is none of these: it says how hard a tap shall be.
MODELS = ("board", "arm_model", "fingertip", "hand", "variation", "pull", "damage", "world")


class SourceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How figures of one's own were come by, and when: of the hand, `calibration.source` says it.
    Nothing reads it but people."""

    counts_per_newton: Annotated[
        str, Meta(description="of guard.counts_per_newton, as `grasp calibrate force` writes it")
    ] = ""
    rule: Annotated[str, Meta(description="of rule, as `grasp calibrate noise` writes it")] = ""

    def in_words(self) -> list[str]:
        """A line for each that is known."""
        told = {"counts a newton": self.counts_per_newton, "rule on slip": self.rule}
        return [f"{what} by: {source}" for what, source in told.items() if source]


class TrialConfig(GraspRigConfig, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rig and control of one trial; ``rig``, ``profile`` and ``detector_name`` are names.

    Of the sections `energy`, `psd`, `psd_fair`, `network` and `own`, the one counts that the
    detector asked for takes.
    """

    profile: str = DEFAULT_PROFILE
    files: dict[str, str] = msgspec.field(default_factory=dict)  # one's own, and a fingerprint
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
    own: Annotated[
        dict[str, Scalar],
        Meta(description="what a detector of one's own is made with, by name: its own affair"),
    ] = msgspec.field(default_factory=dict)
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
        layout = taxels or self.tactile.taxels
        return load_detector(self.detector_name, self._of_detector, fingers, layout)

    @property
    def memory_s(self) -> float:
        """How long the detector asked for remembers; 0 for one whose memory fades. Raises BadFile
        as ``make_detector``."""
        return (
            memory_of(self.detector_name, self._of_detector, self.tactile.taxels)
            * self.loop.period_s
        )

    @property
    def _of_detector(self) -> DetectorSettings:
        if self.detector_section == OWN:
            return OwnSettings(tuple(sorted(self.own.items())), code_digest(self.detector_name))
        settings: DetectorSettings = getattr(self, self.detector_section)
        return settings

    def physics(self, seed: int) -> ContactLevels | None:
        """Contact levels of that trial; None on hardware, and where no scenario is known."""
        return None

    def built_for(self, seed: int) -> Self:
        """The settings that a rig is opened with: those levels and steps put in."""
        found = self.physics(seed)
        if found is None:
            return self
        replace = msgspec.structs.replace
        steps = {"step_s": found.step_s, "blow_step_s": found.blow_step_s}
        return replace(
            self,
            world=replace(self.world, level=found.level, blow_level=found.blow_level),
            contact=replace(self.contact, **steps),
        )

    def digest(self) -> str:
        """Hash of all that a result depends on: equal digests and seeds mean equal runs."""
        return digest_of(msgspec.to_builtins(self))

    def detector_hash(self) -> str:
        """Fingerprint of what decides on slip: weights or formula, and rule. Equal in trials
        that differ otherwise."""
        table = _read(msgspec.to_builtins(self))
        return _hashed({key: table[key] for key in (self.detector_section, "rule")})


def section_of(detector: str) -> str:
    """The section of the settings that a detector takes."""
    if detector in FORMULAS or is_weights(detector) or detector in names("detectors"):
        return FORMULAS.get(detector, NETWORK)
    return OWN if is_own(detector) else NETWORK


def detector_layers(word: str) -> list[Layer]:
    """What is set for a detector: its file of config/detectors; of one's own its fingerprint, and
    the `.toml` of the same name beside it, if there is one. Raises ConfigError for an unknown
    name."""
    if is_code(word) or is_weights(word):
        file = Path(word.rpartition(":")[0] if is_code(word) else word)
        beside = file.with_suffix(".toml")
        code = Layer(str(file), {}, _fingerprint(file))
        if not os.path.lexists(beside):
            return [code]
        return [code, _of_detector(read_toml(beside))]
    if word in offered() and word not in names("detectors"):
        return []
    return [named_layer("detectors", word, (*offered(), f"FILE{MARK}NAME", "FILE.onnx"))]


def _of_detector(beside: Layer) -> Layer:
    """The layer, if it speaks of a rule and of detectors alone: a file that is read because another
    lies beside it sets no limit, and no device. Raises ConfigError."""
    allowed = ("rule", OWN, NETWORK, *FORMULAS.values())
    for section in beside.table:
        if section not in allowed:
            problem = "is not of a detector: what lies beside one sets its rule"
            remedy = f"[rule] and [{OWN}]; all else by --config"
            raise ConfigError(beside.source, section, problem, remedy)
    return beside


def digest_of(settings: Mapping[str, Any]) -> str:
    """``TrialConfig.digest`` of settings as a recording carries them."""
    unused = {"simulated": ADDRESSES, HARDWARE: MODELS}.get(settings["rig"], ())
    hidden = {*UNHASHED, *unused}
    table = {key: value for key, value in sorted(_read(settings).items()) if key not in hidden}
    _keep_names_alone(table)
    for section, keys in (NAMES | ADDRESSES).items():
        if table.get(section):  # hardware has no calibration at first
            table[section] = {k: v for k, v in table[section].items() if k not in keys}
    return _hashed(table)


def _keep_names_alone(table: dict[str, Any]) -> None:
    """Of devices of other packages which they are, not where; nothing where all are ours."""
    named = {k: v for k, v in table.pop("devices", {}).items() if isinstance(v, str) and v}
    if named:
        table["devices"] = named


def _fingerprint(file: Path) -> str:
    """Of what a file holds; empty where none can be read: who loads it says so."""
    try:
        return fingerprint(file.read_bytes()) if file.is_file() else ""
    except OSError:
        return ""


def _read(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Without the sections of other detectors, a network or code by what is in its file."""
    name = settings["detector_name"]
    others = _sections_of_others(name)
    table = {key: value for key, value in settings.items() if key not in others}
    if is_code(name) or is_weights(name):
        del table["detector_name"]  # wherever it lies
    if NETWORK in table:
        chosen = table[NETWORK]["weights"] or name
        table[NETWORK] = {"weights": weights_digest(weights_path(chosen))}
    if OWN in table:
        table[OWN] = {"code": code_digest(name), **table[OWN]}
    return table


def _hashed(table: Mapping[str, Any]) -> str:
    return hashlib.sha256(msgspec.json.encode(table)).hexdigest()[:16]


def _sections_of_others(detector: str) -> set[str]:
    return {*FORMULAS.values(), NETWORK, OWN} - {section_of(detector)}


def check_read(
    detector: str, rule: RuleSettings, controller: ControllerSettings, own: Sequence[Layer]
) -> None:
    """Raises ConfigError where the user's own layers set what that detector, its rule or the
    chosen answer to slip does not read."""
    check_answer_and_rule(rule, controller, own)
    for layer in own:
        for section in sorted(_sections_of_others(detector) & layer.table.keys()):
            said = layer.table[section]
            key = next(iter(said), "") if isinstance(said, dict) else ""
            raise ConfigError(
                layer.source, f"{section}.{key}".rstrip("."), f"is not read by {detector}",
                f"[{section_of(detector)}] alone, or another --detector",
            )  # fmt: skip


def check_answer_and_rule(
    rule: RuleSettings, controller: ControllerSettings, own: Sequence[Layer]
) -> None:
    """Raises ConfigError where the user's own layers set what that rule or the chosen answer to
    slip does not read, whatever the detector."""
    for layer in own:
        for key in sorted(controller.unread.keys() & layer.table.get("controller", {}).keys()):
            chosen = controller.unread[key]
            raise ConfigError(
                layer.source, f"controller.{key}", f"is not read by {chosen}",
                f"leave it out, or set another {chosen.partition(' ')[0]}",
            )  # fmt: skip
        for key in sorted(rule.unread & layer.table.get("rule", {}).keys()):
            raise ConfigError(
                layer.source, f"rule.{key}",
                f"is not read by a rule of kind {rule.kind} and fusion {rule.fusion}",
                "leave it out, or set rule.kind or rule.fusion",
            )  # fmt: skip


def trial_layers(
    object_name: str | Layer,
    rig: str,
    detector: str | None = None,
    files: Files = None,
    assignments: Sequence[str] = (),
    profile: str = DEFAULT_PROFILE,
) -> list[Layer]:
    """Class defaults <- rig <- profile <- object (or as it is) <- detector <- files (or
    $GRASP_CONFIG), later ones on top <- assignments; rig, object and detector by name or path.
    Without a name of its own, the detector is the profile's.

    Raises ConfigError for an unknown name, and where a file or an assignment says one.
    """
    whole = named_layer("profiles", profile)
    if not isinstance(object_name, Layer):
        object_name = thing_layer("objects", "object", object_name)
    if detector is None:
        detector = str(whole.table["detector_name"])
    chosen = object_name.table.get("object", {}).get("name")
    like, of_rig = rig_layers(rig)
    layers = [
        *of_rig,
        not_chosen(whole, {key: CHOSEN[key] for key in ("rig", "profile", "files")}),
        not_chosen(object_name),
        *map(not_chosen, detector_layers(detector)),
        *(own_name(own, "objects", "object", chosen) for own in own_layers(files, assignments)),
    ]
    layers = [*calibration_layers(layers), *layers]
    told = {"rig": like, "profile": profile, "detector_name": detector, "files": own_files(layers)}
    return [*layers, Layer("command line", told)]
