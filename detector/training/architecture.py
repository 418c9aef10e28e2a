"""Which networks there are, apart from torch: what training, export and their tests share."""

from typing import Literal

import msgspec

from detector.layout import check_layout
from drivers.interfaces import KIT_TAXELS

WINDOW = 100  # samples: one second, the paper's
NORM_EPS = 1e-3  # of the authors' layer norms

Input = Literal["counts", "changes", "shifts"]

EVERY: tuple[Input, ...] = ("shifts", "changes", "counts")

# a shift is how far a taxel stands from its own mean of SHIFT_MEAN samples, SHIFT_LAG ago: what a
# slip leaves behind, however short it was, as long as the mean has not followed
SHIFT_LAG, SHIFT_MEAN = 9, 30
SHIFT_SCALE_COUNTS = 8.0  # of the asinh: linear for noise, a logarithm for blows
SHIFT_REACH = SHIFT_LAG + SHIFT_MEAN - 1  # samples before the newest


class Architecture(msgspec.Struct, frozen=True, kw_only=True):
    """What distinguishes one network from another; stored with its weights."""

    family: Literal["tcn", "gru", "freq-cnn"]
    taxels: int = KIT_TAXELS  # of a fingertip; a freq-cnn's image has the kit's
    inputs: tuple[Input, ...] = ("counts",)
    kernel: int = 8
    dilations: tuple[int, ...] = (1, 2, 4, 8)
    channels: int = 12
    head: int = 24
    dropout: float = 0.2  # the authors'
    outputs: int = 2  # 2: softmax of static and slip, 1: log-odds
    streaming: bool = False  # dense outputs, explicit state; otherwise the window's last step
    window: int = WINDOW  # samples that a tcn sees which is no stream
    norm: bool = True  # of a tcn: layer norm, as the paper has it
    gated: bool = False  # of a tcn: one gated convolution a block, a linear head on all of them
    held: int = 1  # of a gated tcn: samples whose greatest features its head hears

    @property
    def receptive_field(self) -> int:
        """Inputs that one output of a `tcn` depends on; a block has two convolutions, or a gated
        one."""
        convolutions = 1 if self.gated else 2
        return self.held + convolutions * (self.kernel - 1) * sum(self.dilations)

    @property
    def memory(self) -> int:
        """Samples that one output of a `tcn` depends on."""
        reach = SHIFT_REACH if "shifts" in self.inputs else int("changes" in self.inputs)
        return self.receptive_field + reach


def shift_taps() -> tuple[int, ...]:
    """What a shift is of the changes up to now, the newest last, each times SHIFT_MEAN.

    A sample less an earlier one is the sum of the changes between them, so no count of the past is
    needed, and the past before a reset is no change. Whole numbers: any order of summation agrees.
    """
    ages = range(SHIFT_REACH - 1, -1, -1)
    return tuple(SHIFT_MEAN if age < SHIFT_LAG else SHIFT_REACH - age for age in ages)


def of_layout(name: str, taxels: int) -> Architecture:
    """The named network for fingertips of so many taxels; raises UsageError where its image of
    taxels has no place for them."""
    arch = ARCHITECTURES[name]
    if arch.family == "freq-cnn":
        check_layout(name, arch.taxels, taxels)
    return msgspec.structs.replace(arch, taxels=taxels)


ARCHITECTURES = {
    # 10,070 parameters; its receptive field of 211 exceeds the window, so the zero padding counts
    "tcn-paper": Architecture(family="tcn"),
    # 99 samples at most: window and stream are equal. What is heard is held as long as a blow is
    # slip (`sequences.BLOW_SAMPLES`): so the fingers of a hand, struck one after another, agree
    "tcn": Architecture(
        family="tcn",
        gated=True,
        inputs=EVERY,
        kernel=3,
        dilations=(1, 2, 4, 8, 8),
        channels=17,
        held=15,
        dropout=0.0,
        outputs=1,
        streaming=True,
    ),
    "gru": Architecture(family="gru", inputs=EVERY, channels=32, outputs=1, streaming=True),
    "freq-cnn-paper": Architecture(family="freq-cnn"),
}
