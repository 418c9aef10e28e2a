"""What the recording of an acquisition holds for viewers that draw by themselves, as a trial's: a
log of its phases, where the fingertip stands, the taxels as a grid."""

import math

import msgspec

from grasp.foxglove import INFO, FrameTransform, FrameTransforms, Grid, Log, Time
from grasp.messages import Write
from scenarios.acquire.config import AcquireConfig
from scenarios.acquire.press import PressPhase
from scenarios.acquire.session import Sample
from scenarios.trial.pictures import EVERY, LOG, TAXELS, TRANSFORMS, grid, point

CHANNELS: dict[str, type[msgspec.Struct]] = {LOG: Log, TRANSFORMS: FrameTransforms, TAXELS: Grid}


class PressPictures:
    """Of one session; ``write`` each sample into a recording."""

    def __init__(self, config: AcquireConfig, unix_ns: int) -> None:
        """``unix_ns``: when the session's clock stood at nought."""
        self._taxels_mm = config.fingertip.taxels_mm
        self._unix_ns = unix_ns
        self._samples = 0
        self._phase: PressPhase | None = None

    def write(self, write: Write, sample: Sample) -> None:
        """A line when a phase begins; the rest at every tenth sample."""
        now = Time.of(self._unix_ns + sample.t_ns)
        if sample.phase is not self._phase:
            self._phase = sample.phase
            write(LOG, sample.t_ns, Log(now, INFO, sample.phase.value, "phase"))
        self._samples += 1
        if self._samples % EVERY != 1 or not all(map(math.isfinite, sample.arm.position_m)):
            return
        hand = FrameTransform(now, "world", "hand", point(*sample.arm.position_m))
        write(TRANSFORMS, sample.t_ns, FrameTransforms([hand]))
        write(TAXELS, sample.t_ns, grid(now, sample.frame.counts, self._taxels_mm))
