"""Loading of a detector by its name."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import msgspec

from detector.energy import EnergyDetector, EnergySettings
from detector.interface import Motion, SlipDetector
from detector.network import NetworkSettings, StreamingNetwork, find_network, load_network
from detector.network_file import is_weights, packaged_networks, weights_digest, weights_path
from detector.plugins import PluginSettings, code_digest, is_plugin, load_plugin
from detector.psd import PsdDetector, PsdFairDetector, PsdFairSettings, PsdSettings
from drivers.errors import UsageError
from drivers.interfaces import KIT_TAXELS

DetectorSettings = EnergySettings | PsdSettings | PsdFairSettings | NetworkSettings | PluginSettings


class Formula(NamedTuple):
    """A detector without weights."""

    section: str  # its section of the settings
    settings: type[msgspec.Struct]
    make: Callable[[Any, int, int], SlipDetector]


FORMULAS = {
    "energy": Formula("energy", EnergySettings, EnergyDetector),
    "psd": Formula("psd", PsdSettings, PsdDetector),
    "psd-fair": Formula("psd_fair", PsdFairSettings, PsdFairDetector),
}
NETWORK = "network"  # section of packaged networks and of the user's weights
PLUGIN = "plugin"
_OTHERS: dict[str, type[msgspec.Struct]] = {NETWORK: NetworkSettings, PLUGIN: PluginSettings}
SECTIONS = frozenset({*_OTHERS, *(formula.section for formula in FORMULAS.values())})
DETECTORS = (*FORMULAS, *packaged_networks())


def section_of(name: str) -> str:
    """Section of the settings of the named detector."""
    if name in FORMULAS:
        return FORMULAS[name].section
    return PLUGIN if name not in DETECTORS and is_plugin(name) else NETWORK


def settings_of(name: str, sections: Any) -> DetectorSettings:
    """Settings of the named detector, from an object with all sections."""
    section: Any = getattr(sections, section_of(name))
    if section_of(name) == PLUGIN:
        return PluginSettings(tuple(sorted(section.items())), code_digest(name))
    settings: DetectorSettings = section
    return settings


def fingerprint_of(name: str, section: Mapping[str, Any]) -> dict[str, Any]:
    """Settings that determine the detector's output, with file contents instead of paths: the
    digest of a network's weights or of a plugin's code."""
    if section_of(name) == NETWORK:
        return {"weights": weights_digest(weights_path(section["weights"] or name))}
    return {"code": code_digest(name), **section} if section_of(name) == PLUGIN else dict(section)


@cache
def memory_of(name: str, settings: DetectorSettings, taxels: int = KIT_TAXELS) -> int:
    """``memory`` of the detector that ``load_detector`` returns; raises the same errors. A network
    is read and not compiled."""
    if isinstance(settings, NetworkSettings) and name in DETECTORS:
        return find_network(name, settings, taxels)[0].memory
    return load_detector(name, settings, 1, taxels).memory


def load_detector(
    name: str,
    settings: Mapping[str, Any] | DetectorSettings,
    fingers: int,
    taxels: int = KIT_TAXELS,
) -> SlipDetector:
    """Load the named detector, reset, for this number of fingers and of taxels per finger.

    The name is a packaged detector, one of an installed package, `FILE.py:NAME` or `FILE.onnx`;
    any other name is a network whose file ``weights`` gives. Raises UsageError for an unknown name
    or another layout, msgspec.ValidationError for settings out of range, and BadFile for a damaged
    or foreign network file or a faulty plugin.
    """
    formula = FORMULAS.get(name)
    expected: type[Any] = formula.settings if formula else _OTHERS[section_of(name)]
    chosen: Any = settings
    if isinstance(settings, Mapping):
        chosen = msgspec.convert(dict(settings), expected)
    if not isinstance(chosen, expected):
        raise ValueError(f"{name} takes {expected.__name__}, not {type(chosen).__name__}")
    if formula:
        return formula.make(chosen, fingers, taxels)
    if isinstance(chosen, PluginSettings):
        return load_plugin(name, chosen, fingers, taxels)
    if name not in DETECTORS and not chosen.weights and not is_weights(name):
        raise UsageError(f"unknown detector {name!r}", f"one of: {', '.join(DETECTORS)}")
    return load_network(name, chosen, fingers, taxels)


def motion_reader(detector: SlipDetector) -> Callable[[], Motion | None]:
    """Reader of the estimated fingertip motion; it returns None without auxiliary outputs."""
    return detector.motion if isinstance(detector, StreamingNetwork) else lambda: None
