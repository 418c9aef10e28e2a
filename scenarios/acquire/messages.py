"""What an acquisition records beside the channels of every run."""

import msgspec

from grasp.messages import (
    ARM,
    TACTILE,
    TRUTH,
    ArmMessage,
    TactileMessage,
    Write,
    arm_message,
    tactile_message,
)
from scenarios.acquire.press import PressCommand
from scenarios.acquire.session import Sample
from scenarios.world.truth import PressedTruth

PRESS = "/press"


class PressMessage(msgspec.Struct, frozen=True):
    """One step of the press controller: what it estimated, and what the arm was told."""

    phase: str
    force_n: float  # estimated by the fingertip
    asked: PressCommand


CHANNELS: dict[str, type[msgspec.Struct]] = {
    TACTILE: TactileMessage,
    ARM: ArmMessage,
    PRESS: PressMessage,
    TRUTH: PressedTruth,
}


def write_sample(write: Write, sample: Sample) -> None:
    """All messages of one sample."""
    t_ns = sample.t_ns
    write(TACTILE, t_ns, tactile_message(sample.frame))
    write(ARM, t_ns, arm_message(sample.arm))
    write(PRESS, t_ns, PressMessage(sample.phase.value, sample.force_n, sample.asked))
    if sample.truth is not None:
        write(TRUTH, t_ns, sample.truth)
