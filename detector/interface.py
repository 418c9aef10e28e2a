"""What every slip detector is to its users, and how one is made from its name."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from detector.auxiliary_outputs import Motion
from detector.energy import EnergyDetector, EnergySettings
from detector.network import NetworkSettings, StreamingNetwork, load_network
from detector.network_file import is_weights, packaged_networks, weights_digest, weights_path
from detector.plugins import OwnSettings, code_digest, is_own, load_plugin
from detector.psd import PsdDetector, PsdFairDetector, PsdFairSettings, PsdSettings
from drivers.errors import UsageError
from drivers.interfaces import KIT_TAXELS


class SlipDetector(Protocol):
    """A causal stream: one frame of all fingertips in, one probability of slip per finger out.

    It reads no clock: frames are taken to be 10 ms apart, and a missed one is repeated by whoever
    feeds it. A probability above ``threshold`` is a sample that reads as slip. What was felt
    ``memory`` samples ago plays no part in an answer any more; 0: it fades, and never ends.
    """

    name: str
    threshold: float
    memory: int

    def reset(self) -> None:
        """Forget all frames."""

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take counts (fingers, taxels), raw minus rest, pressing negative; give (fingers,)."""


DetectorSettings = EnergySettings | PsdSettings | PsdFairSettings | NetworkSettings | OwnSettings


class Formula(NamedTuple):
    """A detector without weights."""

    section: str  # of the settings
    settings: type[msgspec.Struct]
    make: Callable[[Any, int, int], SlipDetector]


FORMULAS = {
    "energy": Formula("energy", EnergySettings, EnergyDetector),
    "psd": Formula("psd", PsdSettings, PsdDetector),
    "psd-fair": Formula("psd_fair", PsdFairSettings, PsdFairDetector),
}
NETWORK = "network"  # the section of packaged networks, and of weights of one's own
OWN = "own"  # of code of one's own
_OTHERS: dict[str, type[msgspec.Struct]] = {NETWORK: NetworkSettings, OWN: OwnSettings}
SECTIONS = frozenset({*_OTHERS, *(formula.section for formula in FORMULAS.values())})
DETECTORS = (*FORMULAS, *packaged_networks())


def section_of(name: str) -> str:
    """The section of the settings that the named detector takes."""
    if name in FORMULAS:
        return FORMULAS[name].section
    return OWN if name not in DETECTORS and is_own(name) else NETWORK


def settings_of(name: str, sections: Any) -> DetectorSettings:
    """The settings of the named detector, of an object that has all sections."""
    section: Any = getattr(sections, section_of(name))
    if section_of(name) == OWN:
        return OwnSettings(tuple(sorted(section.items())), code_digest(name))
    settings: DetectorSettings = section
    return settings


def fingerprint_of(name: str, section: Mapping[str, Any]) -> dict[str, Any]:
    """What of its section decides what the detector gives: of a network or of code of one's own
    what is in the file, wherever that lies."""
    if section_of(name) == NETWORK:
        return {"weights": weights_digest(weights_path(section["weights"] or name))}
    return {"code": code_digest(name), **section} if section_of(name) == OWN else dict(section)


@cache
def memory_of(name: str, settings: DetectorSettings, taxels: int = KIT_TAXELS) -> int:
    """``memory`` of the detector that ``load_detector`` makes of this; raises what that raises."""
    return load_detector(name, settings, 1, taxels).memory


def load_detector(
    name: str,
    settings: Mapping[str, Any] | DetectorSettings,
    fingers: int,
    taxels: int = KIT_TAXELS,
) -> SlipDetector:
    """Make the named detector, reset, for so many fingers of so many taxels.

    A name is that of a packaged one, of one that an installed package offers, `FILE.py:NAME`, or
    `FILE.onnx`. Another one is taken for a network of one's own if ``weights`` says where it is.
    Raises UsageError for an unknown name and for one that was made for another layout,
    msgspec.ValidationError for settings out of range, BadFile for a network whose file is damaged
    or foreign, and for code that does not what it should.
    """
    formula = FORMULAS.get(name)
    wanted: type[Any] = formula.settings if formula else _OTHERS[section_of(name)]
    made: Any = settings
    if isinstance(settings, Mapping):
        made = msgspec.convert(dict(settings), wanted)
    if not isinstance(made, wanted):
        raise ValueError(f"{name} takes {wanted.__name__}, not {type(made).__name__}")
    if formula:
        return formula.make(made, fingers, taxels)
    if isinstance(made, OwnSettings):
        return load_plugin(name, made, fingers, taxels)
    if name not in DETECTORS and not made.weights and not is_weights(name):
        raise UsageError(f"unknown detector {name!r}", f"one of: {', '.join(DETECTORS)}")
    return load_network(name, made, fingers, taxels)


def motion_told_by(detector: SlipDetector) -> Callable[[], Motion | None]:
    """Asks a detector how the fingertips move; None of one without auxiliary outputs."""
    return detector.motion if isinstance(detector, StreamingNetwork) else lambda: None
