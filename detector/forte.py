"""The detector of FORTE (arXiv 2506.18960), brought to 100 Hz: band power that rises.

There the strongest component between 10 and 50 Hz of the last 0.2 s, in decibels a channel, is
followed; slip is where it has risen without a break for 30 ms, by how much it varied meanwhile,
averaged over a finger's channels. Their fingers are read at 2 kHz and the level anew every 2 ms;
here every sample gives a level, so 30 ms are three of them.
"""

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from detector.psd import SampleWindow, probability_of
from drivers.interfaces import KIT_TAXELS, PERIOD_S

BAND_HZ = (10.0, 50.0)
LEAST_RISE_DB = 0.1  # from one level to the next
NOISE_POWER = 1.0  # counts^2, added to every level: what rounding and noise are at rest


class ForteSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How long the detector looks, and which rise reads as slip."""

    window: Annotated[
        int, Meta(ge=10, le=100, description="samples of a spectrum; theirs: 0.2 s")
    ] = 20
    rise: Annotated[
        int, Meta(ge=2, le=50, description="levels that rise one after the other; theirs: 30 ms")
    ] = 3
    threshold_db2: Annotated[
        float, Meta(ge=0.001, le=1000.0, description="variance of these levels of probability 0.5, "
                    "dB^2, mean of a finger's taxels; theirs: 2")
    ] = 2.0  # fmt: skip
    steepness: Annotated[
        float, Meta(ge=0.1, le=20.0, description="log-odds gained per e-fold; assumed")
    ] = 4.0


class ForteDetector:
    """Variance of band levels while they rise, as a probability.

    A rise is remembered as long as the window of a spectrum: a slip that goes on rises no more.
    """

    name = "forte"
    threshold = 0.5

    def __init__(self, settings: ForteSettings, fingers: int, taxels: int = KIT_TAXELS) -> None:
        self.settings = settings
        self.memory = 2 * settings.window + settings.rise - 2
        self._window = SampleWindow(fingers, settings.window, taxels)
        frequencies = np.fft.rfftfreq(settings.window, PERIOD_S)
        self._band = (frequencies >= BAND_HZ[0]) & (frequencies <= BAND_HZ[1])
        taper = np.hanning(settings.window + 2)[1:-1]
        self._taper = (taper / np.linalg.norm(taper))[:, None]
        self._levels = np.zeros((fingers, settings.rise, taxels))
        self._rises = np.zeros((fingers, settings.window))
        self.reset()

    def reset(self) -> None:
        self._window.reset()
        self._rises[:] = 0.0
        self._started = False

    def update(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Take one frame (fingers, taxels); give (fingers,) probabilities."""
        self._window.add(counts)
        self._levels[:, :-1] = self._levels[:, 1:]
        self._levels[:, -1] = self._level_db()
        if not self._started:  # the first frame stands for those before it
            self._levels[:] = self._levels[:, -1:]
            self._started = True
        rising = (np.diff(self._levels, axis=1) > LEAST_RISE_DB).all(axis=1)
        varied = self._levels.var(axis=1)
        self._rises[:, :-1] = self._rises[:, 1:]
        self._rises[:, -1] = np.where(rising, varied, 0.0).mean(axis=1)
        s = self.settings
        return probability_of(self._rises.max(axis=1), s.threshold_db2, s.steepness)

    def _level_db(self) -> NDArray[np.float64]:
        """Strongest component of the band (fingers, taxels)."""
        samples = self._window.samples
        swing = (samples - samples.mean(axis=1, keepdims=True)) * self._taper
        power = np.square(np.abs(np.fft.rfft(swing, axis=1)[:, self._band])).max(axis=1)
        level: NDArray[np.float64] = 10.0 * np.log10(power + NOISE_POWER)
        return level
